"""What is wrong in a configuration, or in an answer to `configure`, is German on a German cart, whole or not."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from probewatch.tools.commands.check import mistakes_in
from probewatch.tools.german.configuration import (
    GERMAN_OF_CONFIGURING,
    GERMAN_OF_MISTAKES,
    GERMAN_OF_URLS,
    refusal_text,
)
from probewatch.tools.shared.named_cart import CONFIG
from tests.support.answers import answered
from tests.support.german import other_fields
from tests.tools.german.test_errors import whole_texts

TABLE = {**GERMAN_OF_MISTAKES, **GERMAN_OF_URLS, **GERMAN_OF_CONFIGURING}
OF_OTHERS = ("input should ", "tuple should ", "No such file", "Permission denied", "Is a directory")
"""How texts of pydantic and of the system begin."""
GOOD = """configured = true
[video]
url = "v4l2:/dev/video0"
[tracker]
url = "ndi:/dev/ttyUSB0"
[[output]]
url = "relay:/dev/ttyUSB1"
[alarm]
language = "de"
"""


@pytest.fixture
def cart(tmp_path: Path) -> Path:
    file = tmp_path / "cart.toml"
    file.write_text(f'{GOOD}folder = "{tmp_path}/log"\n[control]\nsocket = "{tmp_path}/control"\n')
    return file


def changed(cart: Path, old: str, new: str) -> Path:
    cart.write_text(cart.read_text().replace(old, new))
    return cart


def test_each_text_has_the_same_fields() -> None:
    assert other_fields(TABLE) == []


def test_nothing_is_translated_that_nobody_says() -> None:
    said = whole_texts()

    def pieces() -> Iterator[tuple[str, str]]:
        for english in TABLE:
            for piece in re.split(
                r"'?{\w+}'?|[().,:;?=\"]|(?<=Use )|(?<=it is )|(?= from)|(?=a configuration)", english
            ):
                if re.search("[a-z]{3}", piece) and not english.startswith(OF_OTHERS):
                    yield english, piece.strip(" .,:?'")

    assert not [(english, piece) for english, piece in pieces() if piece not in said]


@pytest.mark.parametrize(
    ("old", "new", "german"),
    [
        (
            "[alarm]",
            "[limits]\nscale_percent = -3\n[alarm]",
            "9: [limits] scale_percent = -3: muss mindestens 0.5 sein",
        ),
        ("[alarm]", "[limits]\nscale_percent = 99\n[alarm]", "9: [limits] scale_percent = 99: darf höchstens 30 sein"),
        ("[alarm]", "[limits]\nscale_percent = 'x'\n[alarm]", "9: [limits] scale_percent = 'x': muss eine Zahl sein"),
        ("[alarm]", "[limitz]\n[alarm]", "8: 'limitz' ist nicht bekannt. Gemeint 'limits'?"),
        (
            "[alarm]",
            "[alarm]\nvideo = 1",
            "9: [alarm] video ist hier nicht bekannt, es gehört in einen eigenen Abschnitt",
        ),
        ("[alarm]", "[alarm]\nzzz = 1", "9: [alarm] zzz ist nicht bekannt (bekannt: language, folder)"),
        ("true", "'yes'", "1: 'configured' = 'yes': muss true oder false sein"),
        ("[alarm]", "[limits]\nprofile = 'x'\n[alarm]", ": muss 'coarse', 'clinical' oder 'fine' sein"),
        ("[[output]]", "[output]", "6: 'output': muss eine Liste von Abschnitten sein, jeder geschrieben [[output]]"),
        ("v4l2:", "v4l3:", "v4l3:' ist keine bekannte Art von Gerät. Gemeint 'v4l2:/dev/video0'?"),
        ('[tracker]\nurl = "ndi:/dev/ttyUSB0"\n', "", ": 'tracker' fehlt"),
        (
            "ttyUSB0",
            "ttyUSB0?prbe=1",
            ": die Option 'prbe' gibt es nicht. Gemeint 'probe'? Möglich: probe, reference, ",
        ),
        ('USB1"', 'USB1"\nsignal = "red"', "kein Ausgang hat signal = 'contact'. Ohne ihn erfährt niemand von einem "),
    ],
)
def test_a_mistake_of_a_configuration_is_german(cart: Path, old: str, new: str, german: str) -> None:
    """It was pydantic's English beside German questions."""
    checked = answered("check", changed(cart, old, new))
    assert checked.returncode == 78
    assert german in checked.stderr
    assert len(checked.stderr.splitlines()) == 1
    english = answered("check", changed(cart, 'language = "de"', 'language = "en"')).stderr
    assert german not in english


def test_a_mistake_that_has_no_german_is_english_beside_those_that_have(cart: Path) -> None:
    lines = 'level = "loud"\nlevl = 1'
    said = answered("check", changed(cart, "[alarm]", f"[log]\n{lines}\n[alarm]\nx = [1]")).stderr.splitlines()
    assert [line.partition(": ")[2] for line in said] == [
        "[log] level = 'loud': muss 'debug', 'info', 'warning' oder 'error' sein",
        "[log] levl ist nicht bekannt. Gemeint 'level'?",
        "[alarm] x ist nicht bekannt (bekannt: language, folder)",
    ]
    assert refusal_text("[alarm] folder: is sad") is None
    assert refusal_text("Use a number that you like") is None
    assert refusal_text("job 'x' is not known") is None


def test_another_command_tells_it_in_one_line_and_so_does_what_the_service_has_left(cart: Path) -> None:
    changed(cart, "[alarm]", "[limits]\nscale_percent = -3\n[alarm]")
    said = (
        f"probewatch: {cart}: Zeile 9: [limits] scale_percent = -3: muss mindestens 0.5 sein. Berichtigen; "
        "config/probewatch.toml zeigt jeden Schlüssel"
    )
    assert answered("run", "--config", cart).stderr == f"{said}\n"
    left = answered("status", "--config", cart).stderr
    assert left.startswith(f"probewatch: {cart}: der Dienst überwacht nicht, seit 20")
    assert left.endswith(f"jeden Schlüssel; dann probewatch run --config {cart}\n")
    changed(cart, 'language = "de"', 'language = "de" x')
    assert "ist kein gültiges TOML" in answered("run", "--config", cart).stderr


def test_so_is_what_the_unit_cannot_see(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (told,) = mistakes_in(GOOD.replace("ttyUSB0", "ttyUSB0?probe=/root/a.rom@1"), CONFIG, "de")[1:]
    assert told.endswith(
        "/root/a.rom: der Dienst sieht sie nicht: seine Unit bekommt nichts von /root zu sehen. Sie nach "
        "/etc/probewatch kopieren, und dort nennen"
    )
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.rom").touch()
    refused = answered(
        "configure", tmp_path / "new.toml", "--language", "de", "--tracker", "ndi:/dev/ttyUSB0?log=a.rom"
    )
    assert "a.rom ist ein Pfad von diesem Ordner aus, und der Dienst startet in einem anderen. " in refused.stderr


@pytest.mark.parametrize(
    ("words", "german"),
    [
        (["--video", "v4l3:/dev/video0"], "'v4l3:' ist keine bekannte Art von Gerät. Gemeint 'v4l2:/dev/video0'?"),
        (["--video", "/dev/video0"], "sagt nicht, von welcher Art das Gerät ist. Gemeint 'v4l2:/dev/video0'?"),
        (["--video", "v4l2:video0"], "ist nicht der Pfad eines Geräts. v4l2:/dev/video0 oder "),
        (["--video", "v4l2:/dev/video0?crop=1"], "crop=1 ist kein Teil eines Bildes. crop=LINKS,OBEN,BREITE,HÖHE in "),
        (["--video", "v4l2:/dev/video0?orientation=X"], "orientation=X ist nicht bekannt. Möglich: MF, MN, UF oder UN"),
        (["--tracker", "ndi:"], "nennt kein Gerät. ndi: schreiben, und dann einen Pfad oder eine Adresse"),
        (["--tracker", "relay:/dev/ttyUSB0"], "'relay:' ist ein Alarmausgang, nicht ein Tracker. Möglich: igtl:, "),
        (["--tracker", "ndi:/dev/ttyUSB0?probe=/nix.rom"], "die Werkzeugdefinition ist nicht lesbar (keine solche "),
        (["--tracker", "ndi:/dev/ttyUSB0?baud=x"], "baud=x ist keine Geschwindigkeit dieser Tracker. Möglich: 9600, "),
        (["--tracker", "ndi:/dev/ttyUSB0?probe="], "die Option 'probe' hat keinen Wert. probe=WERT schreiben, oder "),
        (
            ["--tracker", "ndi:/dev/ttyUSB0?latency_ms=-1"],
            "latency_ms=-1 ist nicht brauchbar. Eine Zahl von 0 bis 500 ",
        ),
        (["--contact", "gpio:/dev/gpiochip0"], "nennt keine Leitung. ?line= und Nummer oder Namen anhängen, siehe "),
        (["--lamp", "blue", "tone:x"], "'blue' ist keine Lampe. Möglich: green, cyan, yellow, red, tone"),
        (
            ["--calibration", "/nix.toml"],
            "--calibration /nix.toml: nichts wurde geschrieben. Eine andere Datei nennen, ",
        ),
    ],
)
def test_what_configure_refuses_is_german(cart: Path, words: list[str], german: str) -> None:
    assert german in answered("configure", cart, *words, "--untried", "--yes").stderr


def test_configure_refuses_in_the_language_that_was_asked_for(cart: Path, tmp_path: Path) -> None:
    refused = answered("configure", tmp_path / "new.toml", "--language", "de", "--lamp", "blue", "tone:x")
    assert "'blue' ist keine Lampe" in refused.stderr
    broken = answered("configure", changed(cart, "true", "7")).stderr.splitlines()
    assert broken[0].endswith("muss true oder false sein")
    assert "ist ungültig und wurde nicht geändert. In einem Editor berichtigen" in broken[1]
