"""German of what `reload`, `self-test`, `report`, `calibration` and `recalibrate` print: one table, from the English
text or its template. What the service says, and `ack` and its like, is in `appliance.supervision.languages`; what a
scan says is read from the table of the page, tools/page/files/german.js.

JSON, records, options and what is refused stay English: programs and reports of errors rely on them.
"""

import json
import re
from functools import cache
from pathlib import Path

import click

from appliance.supervision.languages import GERMAN, Texts

GERMAN_OF_TOOLS = {
    "the service has taken its configuration": "der Dienst hat seine Konfiguration übernommen",
    "written: {file}": "geschrieben: {file}",
    # self-test: what is asked
    "Lay the probe down in view of the tracker, and leave it; then Enter": (
        "Die Sonde im Sichtfeld des Trackers ablegen und liegen lassen; dann Enter"
    ),
    "Now move the probe over tissue or a phantom; then Enter": (
        "Jetzt die Sonde über Gewebe oder ein Phantom bewegen; dann Enter"
    ),
    "at rest": "in Ruhe",
    "moving": "in Bewegung",
    "For {seconds} s every lamp is lit and the tone sounds. All seen and heard?": (
        "{seconds} s lang leuchtet jede Lampe und der Ton klingt. Alles gesehen und gehört?"
    ),
    "All green.": "Alles grün.",
    "{bad} of {number} are not green.": "{bad} von {number} sind nicht grün.",
    "kept: {file}": "aufbewahrt: {file}",
    "no result was stored": "kein Ergebnis wurde gespeichert",
    # self-test: its items
    "service": "Dienst",
    "latched alarm": "gehaltener Alarm",
    "estimator restarts": "Neustarts des Prüfprozesses",
    "video": "Video",
    "tracker": "Tracker",
    "output": "Ausgang",
    "feed": "Feed",
    "video rate": "Bilder je Sekunde",
    "video losses": "verlorene Bilder",
    "video stamps": "Zeiten der Bilder",
    "video regularity": "Gleichmaß der Bilder",
    "tracker rate": "Posen je Sekunde",
    "tracker losses": "verlorene Posen",
    "tracker stamps": "Zeiten der Posen",
    "tracker regularity": "Gleichmaß der Posen",
    "noise at rest": "Rauschen in Ruhe",
    "overlay mask": "Maske der Einblendungen",
    "lamps and tone": "Lampen und Ton",
    "alarm log": "Alarmprotokoll",
    "disk": "Festplatte",
    "clock": "Uhr",
    "reference": "Referenz",
    "reference in time": "Referenz rechtzeitig",
    "reference due": "Prüftermin",
    "configured calibration": "konfigurierte Kalibrierung",
    "first use": "erste Nutzung",
    "kept": "Aufbewahrung",
    # self-test: what was found
    "not known, as its device is lost": "unbekannt, da sein Gerät fehlt",
    "within its limit": "innerhalb der Grenze",
    "was beyond its limit, and is within it again": "war jenseits der Grenze und ist wieder innerhalb",
    "{value} {unit}, limit {limit}": "{value} {unit}, Grenze {limit}",
    "{value}, limit {limit}": "{value}, Grenze {limit}",
    "not known {unit}, limit {limit}": "unbekannt, Grenze {limit} {unit}",
    "{said}, version {version}": "{said}, Version {version}",
    "none": "keiner",
    "{said}, acknowledged": "{said}, quittiert",
    "{said}, not acknowledged": "{said}, nicht quittiert",
    "is written": "wird geschrieben",
    "not known": "unbekannt",
    "{size} GB free": "{size} GB frei",
    "{utc}, synchronised": "{utc}, synchronisiert",
    "{utc}, free-running": "{utc}, nicht synchronisiert",
    "{utc}, not known whether synchronised": "{utc}, ob synchronisiert, ist unbekannt",
    "number {number} of {utc}": "Nummer {number} vom {utc}",
    "it has expired since {day} {time} UTC": "sie ist abgelaufen seit {day} {time} UTC",
    "it is due since {day} {time} UTC": "sie ist fällig seit {day} {time} UTC",
    "the clock says {day}, before it came in force on {since}: set the clock": (
        "die Uhr sagt {day}, vor dem Tag ihres Inkrafttretens {since}: die Uhr stellen"
    ),
    "no date asked for ([calibration] due_days)": "kein Termin verlangt ([calibration] due_days)",
    "is in force": "ist in Kraft",
    "{number} samples came": "{number} Werte kamen",
    "{rate} / s, {least} / s at least": "{rate} / s, mindestens {least} / s",
    "{lost} %, at most {most} %": "{lost} %, höchstens {most} %",
    "no pose came": "keine Pose kam",
    "± {bound} ms, at most {most} ms": "± {bound} ms, höchstens {most} ms",
    "scatter {scatter} ms, at most {most} ms": "Streuung {scatter} ms, höchstens {most} ms",
    "longest pause {pause} ms, at most {most} ms": "längste Pause {pause} ms, höchstens {most} ms",
    "{seen} of {poses} poses saw the probe": "{seen} von {poses} Posen sahen die Sonde",
    "the probe moved by {moved} mm and {turned}": "die Sonde hat sich um {moved} mm und {turned} bewegt",
    "{noise} mm, {turn} (standard deviation, worst axis), at most {most} mm, {most_turn}": (
        "{noise} mm, {turn} (Standardabweichung, schlechteste Achse), höchstens {most} mm, {most_turn}"
    ),
    "not learnt: the picture has hardly changed": "nicht gelernt: das Bild hat sich kaum geändert",
    "{share} % of the picture is drawn or dark": "{share} % des Bildes sind Einblendung oder dunkel",
    "this cart has none, only the contact": "dieser Wagen hat keine, nur den Kontakt",
    "{text}: no operator confirmed them": "{text}: niemand hat sie bestätigt",
    "{text}: seen and heard by the operator": "{text}: gesehen und gehört",
    "{text}: not all seen or heard": "{text}: nicht alles gesehen oder gehört",
    "first use {value} {unit}": "erste Nutzung {value} {unit}",
    "compared with the self-test of {utc}, software {version}": (
        "verglichen mit dem Selbsttest vom {utc}, Software {version}"
    ),
    "this self-test is kept to compare later ones with": "dieser Selbsttest bleibt zum Vergleich mit späteren",
    "not kept to compare with: not all is green": "bleibt nicht zum Vergleich: nicht alles ist grün",
    # self-test: what to do
    "Mend it, or its cable": "Das Gerät oder sein Kabel instand setzen",
    "Mend that first, and repeat": "Erst das beheben, dann wiederholen",
    "See probewatch status": "Siehe probewatch status",
    "Wait some seconds, and test again": "Einige Sekunden warten und erneut testen",
    "Mend the cause; acknowledge": "Ursache beheben; quittieren",
    "probewatch log, journalctl -u probewatch": "Siehe probewatch log, journalctl -u probewatch",
    "Check the disk": "Die Festplatte prüfen",
    "Make room on the disk of the alarm log": "Auf der Festplatte des Alarmprotokolls Platz schaffen",
    "Set the clock: the log's dates are wrong": "Die Uhr stellen: die Daten im Protokoll sind falsch",
    "Calibrate: docs/first-calibration.md": "Kalibrieren: docs/first-calibration.md",
    "Move the probe over tissue until it is verified": "Sonde über Gewebe bewegen, bis sie bestätigt ist",
    "Recalibrate; where the clock is wrong, set it": "Neu kalibrieren; wo die Uhr falsch geht, sie stellen",
    "probewatch calibration": "Siehe probewatch calibration",
    "See that it runs and is connected": "Sehen, dass es läuft und angeschlossen ist",
    "Raise the device's rate": "Die Rate des Geräts erhöhen",
    "Check its cable, and what else runs": "Sein Kabel prüfen, und was sonst noch läuft",
    "Bring the probe into view, and repeat": "Die Sonde ins Sichtfeld bringen und wiederholen",
    "probewatch probe URL": "Siehe probewatch probe URL",
    "Lay the probe still in view of the tracker, and repeat": (
        "Die Sonde ruhig im Sichtfeld des Trackers ablegen und wiederholen"
    ),
    "Lay it down, do not hold it, and repeat": "Sie ablegen, nicht halten, und wiederholen",
    "Clean the markers; bring the probe nearer to the middle of the tracker's volume": (
        "Die Marker reinigen; die Sonde näher zur Mitte des Messvolumens bringen"
    ),
    "Move the probe over tissue while it is asked for, and repeat": (
        "Die Sonde über Gewebe bewegen, während es verlangt wird, und wiederholen"
    ),
    "Look at the picture: is it the scanner's, whole, and live?": (
        "Das Bild ansehen: ist es das des Ultraschallgeräts, ganz und live?"
    ),
    "Check lamps, tone and cables": "Lampen, Ton und Kabel prüfen",
    "probewatch status says why there is none: feed": "probewatch status sagt, warum es keinen gibt: feed",
    "Name a --folder that you may write to, or be in its group": (
        "Mit --folder einen beschreibbaren Ordner nennen, oder in dessen Gruppe sein"
    ),
    "Set the device as it was, or keep this one as first use: --baseline": (
        "Das Gerät wie damals einstellen, oder diesen als erste Nutzung behalten: --baseline"
    ),
    "Mend what is not green, and repeat": "Beheben, was nicht grün ist, und wiederholen",
}
"""Some keys are texts of the commands, which `told` fills in; others are recognised in what was made elsewhere, such as
the items of a self-test, whose record stays English.
"""

_TEXTS = Texts({**GERMAN, **GERMAN_OF_TOOLS})
_PAGE = Path(__file__).parents[1] / "page" / "files" / "german.js"
_YES, _NO = ("j", "ja", "y", "yes"), ("n", "nein", "no", "")


def told(text: str, language: str, **fields: object) -> str:
    """Returns a text of GERMAN_OF_TOOLS in the language, filled in. Raises KeyError for one that has no translation."""
    german = GERMAN_OF_TOOLS[text]
    return (text if language == "en" else german).format(**fields)


def recognised(text: str, language: str) -> str:
    """Returns what a part of the program has said, in the language; English as a whole where it cannot be told whole in
    it.
    """
    if language == "en":
        return text
    said = _TEXTS.translated(text)
    return said if said != text else _of_page(text)


def _of_page(text: str) -> str:
    """Returns the German that the page has for it; the text itself where it has none."""
    table, patterns = _page()
    if text in table:
        return table[text]
    found = ((pattern.fullmatch(text), german) for pattern, german in patterns)
    return next((match.expand(german) for match, german in found if match is not None), text)


@cache
def _page() -> tuple[dict[str, str], list[tuple[re.Pattern[str], str]]]:
    """The page's table, and what it recognises by a regular expression, with the words to expand."""
    source = _PAGE.read_text(encoding="utf-8")
    whole = re.search(r"const GERMAN = (\{.*?\});", source, re.DOTALL)
    assert whole is not None
    rows = re.findall(r'^  \[/\^(.*)\$/, (".*")\],$', source, re.MULTILINE)
    return json.loads(whole[1]), [
        (re.compile(pattern), re.sub(r"\$(\d)", r"\\g<\1>", json.loads(german))) for pattern, german in rows
    ]


def confirmed(question: str, language: str) -> bool:
    """Asks a person; German takes j and n, and y as well. Raises click.Abort at Ctrl-C and at the end of the input."""
    if language == "en":
        return click.confirm(question)
    while True:
        answer = str(click.prompt(f"{question} [j/N]", default="", show_default=False)).strip().lower()
        if answer in (*_YES, *_NO):
            return answer in _YES
        click.echo("Bitte j oder n eingeben")
