"""The questions for the devices of `probewatch configure`: what is asked again, and with which reason."""

import struct
from pathlib import Path

import pytest

from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.registry import split_url
from probewatch.drivers.trackers.ndi.rom import ROM_BYTES, rom_sum
from probewatch.tools.shared.device_question import DeviceQuestion, Respondent

_TOOL_QUESTION = "tool definition file (.rom) of the probe's markers, or 'wired'"
_WITNESS_QUESTION = "the same of a second marker body on the probe, or 'none'"


class Answers(Respondent):
    """Somebody who gives these answers, one to each question, and keeps the questions."""

    def __init__(self, *answers: str) -> None:
        super().__init__()
        self.is_there = True
        self._answers, self.asked = list(answers), list[str]()

    def ask(self, question: str, default: str, option: str) -> str:
        self.asked.append(question)
        return self._answers.pop(0) or default


def tool_definition(file: Path, part_number: bytes = b"") -> Path:
    image = bytearray(ROM_BYTES)
    image[:4] = b"NDI\0"
    image[0x250 : 0x250 + len(part_number)] = part_number
    image[4:6] = struct.pack("<H", rom_sum(image))
    file.write_bytes(image)
    return file


def test_a_tool_definition_is_named_whatever_its_path(tmp_path: Path) -> None:
    rom = tool_definition(tmp_path / "my probe+50%&x.rom")
    tracker = DeviceQuestion("tracker", None, "", None)
    url = tracker.with_files("ndi:/dev/ttyUSB0", Answers(str(rom), "none"))
    assert split_url(url)[2] == {"probe": str(rom)}
    second = tool_definition(tmp_path / "second.rom", b"8700339")
    both = tracker.with_files("ndi:/dev/ttyUSB0", Answers(str(rom), str(second)))
    assert split_url(both)[2] == {"probe": str(rom), "witness": str(second)}
    assert tracker.with_files(url, Answers()) == url


def test_one_tool_named_twice_is_told_at_once_and_asked_for_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rom = str(tool_definition(tmp_path / "a.rom"))
    tracker = DeviceQuestion("tracker", None, "", None)
    url = tracker.with_files("ndi:/dev/ttyUSB0", Answers(rom, rom, "none"))
    assert split_url(url)[2] == {"probe": rom}
    assert f"witness={rom} is the same tool as probe={rom}" in capsys.readouterr().out


def test_a_wrong_tool_definition_is_told_and_asked_for_again_not_the_tracker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rom = tool_definition(tmp_path / "right.rom")
    monkeypatch.setenv("HOME", str(tmp_path))
    (other := tmp_path / "other.rom").write_bytes(b"PK" * 400)
    tracker = DeviceQuestion("tracker", None, "", None)
    person = Answers("ndi+tcp://vega", str(tmp_path / "absent.rom"), str(tmp_path), str(other), "~/right.rom", "none")
    assert split_url(tracker.url(person, lambda: iter(())))[2] == {"probe": str(rom)}
    assert person.asked == ["the tracker", *[_TOOL_QUESTION] * 4, _WITNESS_QUESTION]
    told = capsys.readouterr().out
    for why in ("(No such file or directory)", "it is a folder, not a file", "not an NDI tool definition file"):
        assert why in told


def test_a_number_that_is_not_in_the_list_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    person = Answers("7", "2")
    found = [("relay:/dev/ttyUSB0", "one"), ("relay:/dev/ttyUSB1", "other")]
    assert DeviceQuestion("output", None, "", None).url(person, lambda: iter(found)) == "relay:/dev/ttyUSB1"
    assert "7 is not in the list, give 1 to 2" in capsys.readouterr().out


def test_a_german_person_is_asked_in_german_and_told_why_not(capsys: pytest.CaptureFixture[str]) -> None:
    """The technician's first command was English whatever the language of the cart."""

    def lost(url: str, _: str) -> None:
        raise DeviceLost("no such video device", url, "Check the grabber's plug")

    person = Answers("3", "v4l2:/dev/video9")
    person.language = "de"
    person.agrees = lambda *asked: bool(person.asked.append(asked[0]) or True)  # type: ignore[method-assign]
    url = DeviceQuestion("video", None, "", lost).url(person, lambda: iter([("v4l2:/dev/video0", "a grabber")]))
    assert url == "v4l2:/dev/video9"
    assert person.asked == ["das Bild des Ultraschallgeräts"] * 2 + ["Trotzdem verwenden?"]
    said = capsys.readouterr().out
    assert "Das Bild des Ultraschallgeräts: eine Nummer, oder eine URL wie v4l2:" in said
    assert "! 3 ist nicht in der Liste, 1 bis 1 angeben; oder eine URL" in said
    assert "! v4l2:/dev/video9: kein solches Videogerät. Den Stecker des Framegrabbers prüfen" in said
