"""A German cart lists, tries and probes devices in German; the words of a device itself stay as they are."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.drivers.samples import Frame, PoseStatus, Stamp
from probewatch.tools.commands.probe import _MEND, Measured, complaints, findings
from probewatch.tools.german.devices import _WORDS, GERMAN_OF_DEVICES, GERMAN_OF_MENDING, device_text
from probewatch.tools.shared import named_cart
from tests.support.answers import answered
from tests.support.boards import running_board
from tests.support.german import other_fields
from tests.support.recordings import SIZE_PX, items
from tests.support.rigs import lines
from tests.tools.commands.test_devices import add_gpio, add_usb_serial, link, put
from tests.tools.commands.test_probe import MS, placed, pose

TOOLS = Path(__file__).parents[3]
FOLDERS = ("tools", "drivers")


@pytest.fixture(autouse=True)
def cart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    file = tmp_path / "cart.toml"
    file.write_text('[alarm]\nlanguage = "de"\n')
    monkeypatch.setenv(named_cart.ENVIRONMENT, str(file))
    return file


def sources() -> Iterator[str]:
    for folder in FOLDERS:
        for file in (TOOLS / folder).rglob("*.py"):
            if "german" not in file.parts:
                yield file.read_text(encoding="utf-8")


def test_each_text_has_the_same_fields_and_is_said() -> None:
    said = " ".join(re.sub(r'"\s*\n?\s*f?"', "", source) for source in sources())
    composed = ("contact energised in", "contact released in", "Poses", "Pictures")
    assert other_fields(GERMAN_OF_DEVICES) == []
    for english in GERMAN_OF_DEVICES:
        pieces = [one.strip(" .?()") for one in re.split(r"{\w+}|[:,;]|\. ", english) if re.search("[a-z]{3}", one)]
        assert english in composed or all(piece in said for piece in pieces), english


def test_each_status_and_what_to_do_about_it_has_its_german() -> None:
    assert {status.value for status in PoseStatus if status is not PoseStatus.OK} <= set(_WORDS)
    assert set(_MEND.values()) <= set(GERMAN_OF_MENDING)


def measured() -> Iterator[Measured]:
    near = [placed(pose(number, number * 10), (0.1, 0.0, -0.2)) for number in range(30)]
    lost = [pose(n, n * 200 + (70 if n % 2 else 0), status, reason="x7") for n, status in enumerate(PoseStatus, 30)]
    yield Measured([*near, *lost], [0] * len([*near, *lost]))
    loose = [Frame(Stamp(n * 400 * MS, 100 * MS), 3 * n, np.zeros((24, 32), np.uint8)) for n in range(20)]
    yield Measured([*loose], [frame.stamp.t_ns for frame in loose])


def said_of_them() -> Iterator[str]:
    for one in measured():
        yield from (text for row in findings(one) for text in row)
        yield from complaints(one)


@pytest.mark.parametrize("text", sorted(set(said_of_them())))
def test_what_was_measured_is_told_in_german(text: str) -> None:
    if re.search("[a-z]{3}", text):
        assert device_text(text, "de") != text
    assert device_text(text, "en") == text


def test_what_is_connected_is_told_in_german(tmp_path: Path) -> None:
    """It was English beside German commands."""
    root = tmp_path / "root"
    add_usb_serial(root, "ttyUSB0", "usb-FTDI")
    add_gpio(root, "gpiochip0", "gpio-sim.0", "pins")
    put(root / "proc/42/comm", "minicom\n")
    link(root / "proc/42/fd/3", "/dev/ttyUSB0")
    assert [line.split("\t") for line in answered("devices", "--root", root).stdout.splitlines()] == [
        ["Art", "Pfad", "Knoten", "was es ist", "Zustand"],
        [
            "serielle Schnittstelle",
            "/dev/serial/by-id/usb-FTDI",
            "/dev/ttyUSB0",
            "FTDI FT232R USB UART A1B2C3",
            "benutzt von minicom (42)",
        ],
        ["GPIO-Chip", "/dev/gpiochip0", "/dev/gpiochip0", "pins, 32 Leitungen", "frei"],
    ]
    assert answered("devices", "--root", tmp_path / "none").stdout.startswith("Keine serielle Schnittstelle, kein")


def test_a_recording_is_probed_in_german(tmp_path: Path) -> None:
    write_metaimage(tmp_path / "a.mha", items(5), SIZE_PX)
    shown = answered("probe", f"replay:{tmp_path}/a.mha?start_s=0.3", "--seconds", "5")
    assert (shown.returncode, shown.stderr) == (0, "")
    lines = shown.stdout.splitlines()
    assert [line for line in lines if line in ("Posen", "Bilder")] == ["Posen", "Bilder"]
    assert lines.count("die Aufzeichnung ist zu Ende") == 2
    assert sum(line.startswith(("gut", "mangelhaft, siehe die Zeilen mit !")) for line in lines) == 2
    assert [line for line in lines if re.search(r"\b(the|is|of|per|can|be)\b", line)] == []


@pytest.mark.parametrize("scheme", lines())
def test_a_tracker_is_probed_in_german(scheme: str, tmp_path: Path) -> None:
    with lines()[scheme].open(tmp_path, 1.0) as (url, _):
        shown = answered("probe", url, "--only", "poses", "--seconds", "0.5")
    assert shown.stderr == ""
    assert [one for one in shown.stdout.splitlines() if re.search(r"\b(the|is|of|per|can|be|answers)\b", one)] == []


@pytest.mark.parametrize(
    ("remark", "german"),
    [
        (
            "the second marker body (P9) was not seen for 7 s: whether either has moved is not watched",
            "der zweite Markerkörper (P9) wurde seit 7 s nicht gesehen: ob sich einer bewegt hat, wird nicht überwacht",
        ),
        (
            "MJPG comes 5 times a second by the word of the device. format=YUYV or format=NV12 may come more often, or "
            "a smaller size=",
            "MJPG kommt nach Angabe des Geräts 5-mal in der Sekunde. format=YUYV oder format=NV12 kommt vielleicht "
            "öfter, oder ein kleineres size=",
        ),
        (
            "P6-00000: ok, markers within 0.31 mm of the definition, marker C LOOSE by 0.31 mm",
            "P6-00000: in Ordnung, Marker auf 0.31 mm bei der Definition, Marker C LOSE um 0.31 mm",
        ),
        ("no IMAGE 'x' came; the server sends nothing", "kein IMAGE 'x' kam; der Server sendet nichts"),
    ],
)
def test_what_a_driver_says_of_its_device_is_told_in_german(remark: str, german: str) -> None:
    assert device_text(remark, "de") == german


def test_an_output_is_probed_in_german(tmp_path: Path) -> None:
    with running_board(tmp_path / "board", HostClock()):
        refused = answered("probe", f"relay:{tmp_path}/board")
        clicked = answered("probe", f"relay:{tmp_path}/board", "--click")
    assert "ein Ausgang wird geprüft, indem sein Kontakt schaltet. --click angeben, während" in refused.stderr
    assert [line.split(":")[0] for line in clicked.stdout.splitlines() if line.startswith("Kontakt")] == [
        "Kontakt angezogen in",
        "Kontakt abgefallen in",
    ]


def test_why_nothing_came_is_told_in_german(tmp_path: Path) -> None:
    refused = answered("probe", "ndi:/dev/none-of-these").stderr
    assert "/dev/none-of-these: keine solche serielle Schnittstelle. Das Kabel einstecken, oder" in refused
