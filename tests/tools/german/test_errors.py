"""What a German cart refuses is told in German, whole or not at all."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.appliance.storage.calibration_file import read_calibration
from probewatch.appliance.storage.reference_store import FOLDER, HISTORY, History, read_history, write_history
from probewatch.drivers.errors import ConfigurationError, DeviceLost, ProbewatchError
from probewatch.tools.german.calibrations import GERMAN_OF_CALIBRATIONS
from probewatch.tools.german.errors import GERMAN_OF_ERRORS
from probewatch.tools.german.translation import lost_text, tell_refused
from probewatch.tools.shared.recovered import recovered
from tests.support.answering import Answering
from tests.support.answers import answered

ROOT = Path(__file__).parents[3]
OF_THE_SYSTEM = ("no such file or directory", "No such file or directory", "Permission denied")
PUT_TOGETHER = ("it is a folder, not a file",)


def sources() -> Iterator[str]:
    for package in ("drivers", "appliance", "tools"):
        for file in (ROOT / package).rglob("*.py"):
            if file.parent.name != "german":
                yield file.read_text(encoding="utf-8")


def whole_texts() -> str:
    """Returns all sources, with the strings that are written in parts joined."""
    return " ".join(re.sub(r"""["']\s*\n?\s*f?["']""", "", source) for source in sources())


@pytest.mark.parametrize(
    ("table", "between"),
    [
        (set(GERMAN_OF_ERRORS) - {*OF_THE_SYSTEM, *PUT_TOGETHER}, r"{\w+}|[,():;.]"),
        (GERMAN_OF_CALIBRATIONS, r"{\w+}|^ImageToProbe |[][,():;.=\"…]"),
    ],
)
def test_nothing_is_translated_that_nobody_says(table: Iterable[str], between: str) -> None:
    said = whole_texts()
    for english in table:
        pieces = [piece for piece in re.split(between, english) if re.search("[a-z]{3}", piece)]
        assert all(piece.strip(" .?") in said for piece in pieces), english


@pytest.mark.parametrize(
    ("error", "german"),
    [
        (
            DeviceLost("the serial port is in use by another program", "/dev/x", "Close that program, then try again"),
            "/dev/x: ein anderes Programm benutzt die serielle Schnittstelle. Das andere Programm beenden, dann noch "
            "einmal versuchen",
        ),
        (
            ConfigurationError(
                "no service answers (connection refused)", "control", "Start it: probewatch run --config x"
            ),
            "control: kein Dienst antwortet (Verbindung abgelehnt). Ihn starten: probewatch run --config x",
        ),
        (
            ConfigurationError("is not what probewatch noise writes", "n.toml", "Learn it again: probewatch noise"),
            "n.toml: ist nicht das, was probewatch noise schreibt. Neu lernen: probewatch noise",
        ),
        (
            ConfigurationError(
                "cannot be written: it is a folder, not a file",
                "d",
                "Name a file in a folder that exists and may be written to",
            ),
            "d: nicht schreibbar: es ist ein Ordner, keine Datei. Eine Datei in einem Ordner nennen, den es gibt und "
            "der beschreibbar ist",
        ),
        (DeviceLost("no such serial port", "/dev/x", "Sing"), "/dev/x: no such serial port. Sing"),
        (DeviceLost("is tired", "/dev/x", "Check the grabber's plug"), "/dev/x: is tired. Check the grabber's plug"),
        (DeviceLost("the video device was unplugged", "self-test"), "self-test: das Videogerät wurde abgezogen"),
    ],
)
def test_an_error_is_told_whole_in_one_language(error: ProbewatchError, german: str) -> None:
    english = str(error)
    tell_refused(error, "en")
    assert str(error) == english
    tell_refused(error, "de")
    assert str(error) == german


def test_what_a_command_of_a_german_cart_refuses_is_german(tmp_path: Path) -> None:
    """It was English beside a German status."""
    AlarmLog(tmp_path / "alarms")
    cart = tmp_path / "cart.toml"
    cart.write_text(f'[alarm]\nlanguage = "de"\nfolder = "{tmp_path}/alarms"\n[control]\nsocket = "{tmp_path}/none"\n')
    refused = answered("calibration", "use", tmp_path / "nix.toml", "--config", cart)
    assert (refused.returncode, refused.stderr) == (
        78,
        f"probewatch: {tmp_path}/nix.toml: nicht lesbar: keine solche Datei. Namen und Rechte prüfen. Eine .toml oder "
        "eine .xml von PLUS angeben\n",
    )
    silent = answered("status", "--config", cart)
    assert (silent.returncode, silent.stderr) == (
        69,
        f"probewatch: {tmp_path}/none: kein Dienst antwortet (keine solche Datei). Ihn starten: probewatch run "
        f"--config {cart}\n",
    )


def test_what_recover_refuses_of_a_german_cart_is_german() -> None:
    proposal = {"image_to_probe": None, "text": "Verzögerung ist jetzt 90 ms"}
    for proposed, said in (
        (None, "der Dienst: schlägt nichts vor: kein Parameter ist als falsch gezeigt. Die Sonde über Gewebe bewegen"),
        (proposal, "der Dienst: schlägt keine Kalibrierung vor. Verzögerung ist jetzt 90 ms"),
    ):
        with pytest.raises(ConfigurationError) as refused:
            recovered({"proposal": proposed, "reference": {}, "language": "de"})
        tell_refused(refused.value, "de")
        assert str(refused.value).startswith(said)


IDENTITY = "image_to_probe = [[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"
OWN = 'format = "probewatch-calibration"\nversion = 1\nimage_size_px = [640, 480]\n'


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x89HDF\r\n",
        b"{}",
        b"1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n",
        (OWN + "image_to_probe = no").encode(),
        (OWN + IDENTITY).encode(),
        (OWN + IDENTITY.replace("1.0", "90.0")).encode(),
        (OWN + IDENTITY.replace("1.0", "0.0001")).encode(),
        (OWN + IDENTITY.replace("1.0", "0.2").replace("0, 0, 0, 1]]", "0, 0, 3, 1]]")).encode(),
        (OWN + IDENTITY.replace("1.0", "0.2").replace("0, 0, 1, 0]", "0, 0, -1, 0]")).encode(),
        (OWN + IDENTITY.replace("[1.0, 0, 0, 0]", "[0.2, 0, 0, 9000]").replace("1.0", "0.2")).encode(),
    ],
)
def test_why_a_file_is_no_calibration_is_german(content: bytes, tmp_path: Path) -> None:
    """It was English beside German questions."""
    file = tmp_path / "new.toml"
    file.write_bytes(content)
    with pytest.raises(ConfigurationError) as refused:
        read_calibration(file, None)
    what, remedy = refused.value.what, refused.value.remedy
    tell_refused(refused.value, "de")
    assert refused.value.what != what
    assert refused.value.remedy != remedy


@pytest.mark.parametrize("damage", ["", "{}", '{"check": 1}'])
def test_so_is_what_is_wrong_with_the_history_of_references(damage: str, tmp_path: Path) -> None:
    write_history(tmp_path, History(), {})
    (tmp_path / FOLDER / HISTORY).write_text(damage)
    with pytest.raises(ConfigurationError) as refused:
        read_history(tmp_path)
    tell_refused(refused.value, "de")
    assert "welche Kalibrierung gilt, ist nicht bekannt. Den Ordner" in str(refused.value)


def test_why_a_device_is_lost_is_german_in_the_status_of_a_german_cart(tmp_path: Path) -> None:
    why = "/dev/ttyUSB0: no such serial port. Plug the cable in, or correct the path in the configuration"
    with Answering(tmp_path / "control") as service:
        service.changes = {"language": "de", "lost": {"tracker ndi:/dev/ttyUSB0": why, "video": "x: is tired"}}
        shown = " ".join(answered("status", "--socket", service.path).stdout.split())
    assert "/dev/ttyUSB0: keine solche serielle Schnittstelle. Das Kabel einstecken, oder den Pfad in der" in shown
    assert "! video: x: is tired" in shown
    assert lost_text(why, "en") == why


@pytest.mark.parametrize(
    ("language", "said"),
    [
        ("en", "! once the position sensor was looked at: probewatch ack --bump"),
        ("de", "! sobald der Positionssensor angesehen wurde: probewatch ack --bump"),
    ],
)
def test_the_status_names_the_command_that_ends_the_alert_of_a_bump(tmp_path: Path, language: str, said: str) -> None:
    """Below a halt its remedy said to scan, which cannot help while every pose is a fault."""
    with Answering(tmp_path / "control") as service:
        service.changes = {"language": language, "remarks": ["the position sensor was bumped, too hot"]}
        shown = " ".join(answered("status", "--socket", service.path).stdout.split())
        service.changes = {"language": language, "remarks": ["too hot"]}
        healed = answered("status", "--socket", service.path).stdout
    assert said in shown
    assert "--bump" not in healed
