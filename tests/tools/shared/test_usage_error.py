"""A usage error on a German cart is German as a whole, or English as a whole."""

from pathlib import Path

import click
import pytest

from probewatch.tools.cli import probewatch
from probewatch.tools.shared import named_cart
from probewatch.tools.shared.usage_error import show_usage_error
from tests.support.answers import answered


@pytest.fixture
def cart(tmp_path: Path) -> Path:
    file = tmp_path / "cart.toml"
    file.write_text('[alarm]\nlanguage = "de"\n')
    return file


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("status", "--wach"), "Die Option '--wach' gibt es nicht. Gemeint '--watch'?"),
        (("status", "--nothing-like-it"), "Die Option '--nothing-like-it' gibt es nicht."),
        (("stats",), "Den Befehl 'stats' gibt es nicht. Gemeint 'status'?"),
        (("calibration", "sho"), "Den Befehl 'sho' gibt es nicht. Gemeint 'show'?"),
        (("calibration", "back"), "Das Argument 'NUMBER' fehlt."),
        (("calibration", "back", "x"), "Ungültiger Wert für 'NUMBER': 'x' ist keine ganze Zahl."),
        (("probe",), "Das Argument 'URL' fehlt, wie "),
        (("probe", "sim:x", "more"), "Unerwartetes Argument (more)"),
        (("probe", "sim:x", "--seconds", "0"), "Ungültiger Wert für '--seconds': 0.0 liegt nicht im Bereich "),
        (("probe", "sim:x", "--only", "all"), "Ungültiger Wert für '--only': 'all' ist keines von 'poses', 'pictures'"),
        (("probe", "sim:x", "--only"), "Die Option '--only' braucht einen Wert: poses, pictures"),
        (("report", "--folder"), "Die Option '--folder' braucht einen Wert."),
        (("report", "--pdf=1"), "Die Option '--pdf' nimmt keinen Wert."),
        (("report", "--of", "noon"), "Ungültiger Wert für '--of': 'noon' ist kein Tag des Kalenders, "),
        (("report", "--folder", __file__), f"Ungültiger Wert für '--folder': '{__file__}' ist eine Datei, kein Ordner"),
        (("pause", "9h"), "'9h' ist keine Zeit für eine Pause: 1 bis 120 Sekunden, wie 30 oder 1m. Länger: --off"),
        (("pause", "--on", "--off", "x"), "--on und --off schließen einander aus"),
        (("pause", "--off", "--on"), "Die Option '--off' braucht einen Wert, und '--on' ist eine Option. Als ihr"),
        (("report", "day"), "Unerwartetes Argument (day)"),
        (("configure", "--profile", "x"), "Ungültiger Wert für '--profile': 'x' ist keines von 'coarse', "),
        (("demo", "--fault", "xx"), "Ungültiger Wert für '--fault': 'xx' ist kein bekannter Fehler. Möglich: bend-"),
        (
            ("demo", "--fault", "flip"),
            "'flip' ist kein bekannter Fehler. Gemeint 'flip-lateral' oder 'flip-vertical'? ",
        ),
        (("export", "x.mcap", "--to", "mp4", "--output", "a.avi"), "--output a.avi endet nicht auf .mp4"),
        (("metrics", "--no-http"), "--no-http braucht --textfile"),
        (("mqtt", "--broker", "x", "--cart", ""), "Ungültiger Wert für '--cart': darf nicht leer sein"),
        (
            ("calibration", "import", "x", "--output", "y.toml", "--image-size", "4"),
            "Die Option '--image-size' braucht 2 Werte.",
        ),
        (("log", "--state", "hlt"), "Ungültiger Wert für '--state': 'hlt' ist nicht bekannt. Gemeint 'halt'?"),
    ],
)
def test_a_refused_command_line_is_told_in_german(
    cart: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], said: str
) -> None:
    """Its usage, its help and why were English beside German commands."""
    monkeypatch.setenv(named_cart.ENVIRONMENT, str(cart))
    shown = answered(*words)
    assert (shown.returncode, shown.stdout) == (2, "")
    *above, error = shown.stderr.splitlines()
    assert [line.split(" ")[0] for line in above] in ([], ["Aufruf:", "Hilfe:", ""]), "an option without a value"
    assert error.startswith("Fehler: ")
    assert said in error
    assert " or " not in error


def test_what_is_refused_of_a_recording_is_german(
    cart: Path, session: Path, calibration: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("probewatch.tools.report.pdf._browser", lambda: "chromium")
    monkeypatch.setenv(named_cart.ENVIRONMENT, str(cart))
    judged = ("--calibration", calibration)
    for words, said in (
        ((session,), "Die Option '--calibration' fehlt: nur eine Blackbox bringt ihre eigene mit"),
        ((session, *judged, "--inject", "depth@99"), "--inject depth@99 beginnt nach der Aufzeichnung, die bei 3.1 s"),
        ((session, *judged, "--inject", "depth@x"), "'x' ist keine Zeit in Sekunden nach dem Anfang der Aufzeichnung"),
        ((session, *judged, "--pdf", "a.pdf"), "--pdf druckt die Seite von --html"),
        ((session, "r.json", *judged), "'r.json' ist keine Aufzeichnung; --json gibt den Bericht aus: --json > r.json"),
        (("x.mha", *judged), "nicht lesbar: keine solche Datei. Namen und Ordner prüfen"),
    ):
        assert said in answered("replay", *words).stderr


def test_the_cart_is_that_of_the_words(cart: Path, tmp_path: Path) -> None:
    for words in (("--config", cart), (f"--config={cart}",)):
        assert "Fehler: Die Option '--x' gibt es nicht." in answered("status", *words, "--x").stderr
    assert "Fehler: Die Option '--x' gibt es nicht." in answered("configure", cart, "--x").stderr
    assert "Error: No such option '--x'." in answered("status", "--config", tmp_path / "none", "--x").stderr


def test_what_has_no_german_is_english_whole(
    cart: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(named_cart.ENVIRONMENT, str(cart))
    context = click.Context(probewatch, info_name="probewatch")
    odd = click.BadParameter("it is odd", context, param_hint="'--job'")
    show_usage_error(odd, probewatch, ["fleet", "--job", "a b"])
    shown = capsys.readouterr().err
    assert shown.startswith("Usage: ")
    assert "Error: Invalid value for '--job': it is odd" in shown
    assert "Commands" in answered().stdout + answered().stderr
