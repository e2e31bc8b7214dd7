"""Translates the operator's texts: one table a language, from the English text. English needs none. The names of faults
and their checks are in their rows (`appliance.supervision.faults`), everything else is here.

A text that is composed while the service runs is translated clause by clause, and stays English as a whole where one of
its clauses is unknown: half a sentence in each language is worse than either.
"""

import re
from collections.abc import Mapping

from probewatch.appliance.supervision.faults import FAULT_ROWS

GERMAN = {text: german for row in FAULT_ROWS.values() for text, german in row.translations().items()} | {
    "Self-test": "Selbsttest",
    "Wait a few seconds": "Einige Sekunden warten",
    "Waiting for devices": "Warten auf Geräte",
    "Switch on the scanner and the tracker": "Ultraschallgerät und Tracker einschalten",
    "Calibration not verified": "Kalibrierung nicht bestätigt",
    "Move the probe over tissue in view of the tracker": "Sonde im Sichtfeld des Trackers über Gewebe bewegen",
    "within its limit again; good once it has stayed so for some seconds: {names}": (
        "wieder innerhalb der Grenze; gut, sobald es einige Sekunden so bleibt: {names}"
    ),
    "Scan it: 'recalibrate --live --solve all'; or 'calibration use FILE'": (
        "Scannen: 'recalibrate --live --solve all'; oder 'calibration use DATEI'"
    ),
    "Calibration has expired: 'probewatch recalibrate --live'": (
        "Kalibrierung ist abgelaufen: 'probewatch recalibrate --live'"
    ),
    "Check the tracker's position sensor; then 'probewatch ack --bump'": (
        "Positionssensor des Trackers prüfen; dann 'probewatch ack --bump'"
    ),
    "Check frame rate, stamps and whose calibration is in force": (
        "Bildrate und Zeitstempel prüfen, und wessen Kalibrierung gilt"
    ),
    "Calibration verified": "Kalibrierung bestätigt",
    "by earlier motion": "durch frühere Bewegung",
    "in part by earlier motion": "teils durch frühere Bewegung",
    "None needed": "Nichts zu tun",
    "Do not rely on the overlay": "Der Überlagerung nicht vertrauen",
    "Check the cause; wait a few seconds": "Ursache ansehen; einige Sekunden warten",
    "HALT: calibration is wrong": "HALT: Kalibrierung ist falsch",
    "Stop; fix the cause, verify, acknowledge": "Anhalten; Ursache beheben, prüfen, quittieren",
    "HALT: recalibrate the probe": "HALT: Sonde neu kalibrieren",
    "Stop; fix the cause or recalibrate; acknowledge": "Anhalten; Ursache beheben oder kalibrieren; quittieren",
    "Recalibrating": "Kalibrierung läuft",
    "Finish the scan, then move the probe over tissue to verify": "Aufnahme beenden, dann Sonde über Gewebe bewegen",
    "Device lost: not watching": "Gerät fehlt: keine Überwachung",
    "Reconnect it; monitoring resumes by itself": "Gerät wieder anschließen; die Überwachung läuft von selbst an",
    "Internal fault: not watching": "Interner Fehler: keine Überwachung",
    "Wait for it to restart, else restart the cart": "Neustart abwarten; sonst den Wagen neu starten",
    "self-test": "Selbsttest",
    "waiting for devices": "Warten auf Geräte",
    "not verified": "nicht bestätigt",
    "monitoring": "überwacht",
    "warning": "Warnung",
    "halt": "Halt",
    "recalibration requested": "Neukalibrierung verlangt",
    "recalibrating": "Kalibrierung läuft",
    "device lost": "Gerät fehlt",
    "internal fault": "interner Fehler",
    "the last verification is too old; move the probe over tissue": (
        "die letzte Bestätigung ist zu alt; Sonde über Gewebe bewegen"
    ),
    "the times of picture or pose fall behind; check scanner, tracker and their server": (
        "die Zeiten von Bild oder Pose bleiben zurück; Scanner, Tracker und deren Server prüfen"
    ),
    "verified only before a disturbance; move the probe over tissue": (
        "nur vor einer Störung bestätigt; Sonde über Gewebe bewegen"
    ),
    "Probe on tissue": "Sonde auf Gewebe",
    "slide it sideways, 10 mm to and fro": "seitlich schieben, 10 mm hin und her",
    "press and release quickly, 6 mm": "schnell drücken und lösen, 6 mm",
    "rock it in the picture's plane, 8° each way": "in der Bildebene wippen, 8° nach jeder Seite",
    "twist it about its long axis, 8° each way": "um ihre Längsachse drehen, 8° nach jeder Seite",
    "fan it out of the picture's plane, 8° each way": "aus der Bildebene kippen, 8° nach jeder Seite",
    "calibration verified": "Kalibrierung bestätigt",
    "verified only in parts": "nur in Teilen bestätigt",
    "not shown yet: {names}": "noch nicht gezeigt: {names}",
    "the picture does not continue the one that was verified": "das Bild setzt das bestätigte nicht fort",
    "picture too shallow: {value} mm, over tissue that may give way {least} mm needed": (
        "Bild zu flach: {value} mm, über Gewebe, das nachgeben kann, {least} mm nötig"
    ),
    "too little tissue in the picture: {value} mm², where it may give way {least} mm² needed": (
        "zu wenig Gewebe im Bild: {value} mm², wo es nachgeben kann, {least} mm² nötig"
    ),
    "too little in-plane motion to show: {names}": "zu wenig Bewegung in der Bildebene für: {names}",
    "cause undecided, {margin} nat apart: {names}": "Ursache unentschieden, {margin} nat auseinander: {names}",
    "to decide: {motions}": "zur Unterscheidung: {motions}",
    "{name} is now {value} ± {sigma} {unit}, was {old} {unit}": (
        "{name} ist jetzt {value} ± {sigma} {unit}, war {old} {unit}"
    ),
    "latency_ms takes 0 to 500 ms: check frame rate, stamps and whose calibration is in force": (
        "latency_ms geht von 0 bis 500 ms: Bildrate und Zeitstempel prüfen, und wessen Kalibrierung gilt"
    ),
    "set latency_ms={value} in the tracker's URL and restart the service": (
        "latency_ms={value} in der URL des Trackers setzen und den Dienst neu starten"
    ),
    "write it with 'probewatch calibration recover' and take it with 'probewatch calibration use'": (
        "mit 'probewatch calibration recover' schreiben und mit 'probewatch calibration use' übernehmen"
    ),
    "motion alone does not recover this: recalibrate with 'probewatch recalibrate --live'": (
        "Bewegung allein stellt das nicht wieder her: mit 'probewatch recalibrate --live' neu kalibrieren"
    ),
    "picture and tracker disagree: {name} {ratio} × its limit": (
        "Bild und Tracker widersprechen sich: {name} beim {ratio}-Fachen der Grenze"
    ),
    "near its limit, not certain: {name} {value} ± {sigma} {unit}, limit {limit} {unit}": (
        "nahe an der Grenze, nicht sicher: {name} {value} ± {sigma} {unit}, Grenze {limit} {unit}"
    ),
    "beyond its limit, not certain: {name} {value} ± {sigma} {unit}, limit {limit} {unit}": (
        "jenseits der Grenze, nicht sicher: {name} {value} ± {sigma} {unit}, Grenze {limit} {unit}"
    ),
    "error of a point {value} mm, limit {limit} mm": "Fehler eines Punktes {value} mm, Grenze {limit} mm",
    "error of a point not known, limit {limit} mm": "Fehler eines Punktes unbekannt, Grenze {limit} mm",
    "{name} {value} {unit}, limit {limit} {unit}": "{name} {value} {unit}, Grenze {limit} {unit}",
    "{name} {value} {unit}, limit {limit} {unit}: waiting for it to be confirmed": (
        "{name} {value} {unit}, Grenze {limit} {unit}: noch zu bestätigen"
    ),
    "{name} {value} {unit}, limit {limit} {unit}: must be shown again by new motion": (
        "{name} {value} {unit}, Grenze {limit} {unit}: durch neue Bewegung neu zu zeigen"
    ),
    "error of a point up to {worst} mm, of half of them up to {median} mm (99.7 %)": (
        "Fehler eines Punktes bis {worst} mm, bei der Hälfte bis {median} mm (99.7 %)"
    ),
    "at {depth} mm depth up to {deep} mm": "in {depth} mm Tiefe bis {deep} mm",
    "limit {limit} mm": "Grenze {limit} mm",
    "limits: {profile}": "Grenzen: {profile}",
    "limits: {profile}, but for {beside}": "Grenzen: {profile}, außer {beside}",
    "error of a point not known": "Fehler eines Punktes unbekannt",
    "verified {age:.1f} s ago": "bestätigt vor {age:.1f} s",
    "not verified now": "jetzt nicht bestätigt",
    "contact closed (safe)": "Kontakt geschlossen (sicher)",
    "contact OPEN": "Kontakt OFFEN",
    "acknowledged": "quittiert",
    "not acknowledged": "nicht quittiert",
    "video {video:.1f}/s · tracker {tracker:.1f}/s · dropped: {frames} frames, {poses} poses": (
        "Video {video:.1f}/s · Tracker {tracker:.1f}/s · verworfen: {frames} Bilder, {poses} Posen"
    ),
    "sound paused": "Ton pausiert",
    "sound acknowledged": "Ton quittiert",
    "sound off": "Ton aus",
    "present motion does not show it; within its age, as no detector saw a change: {names}": (
        "von der jetzigen Bewegung nicht gezeigt; innerhalb seines Alters, da kein Detektor eine Änderung sah: {names}"
    ),
    "reference {number} · {origin} · {name} · {sha} · since {since} UTC": (
        "Referenz {number} · {origin} · {name} · {sha} · seit {since} UTC"
    ),
    "configuration": "Konfiguration",
    "recalibration": "Neukalibrierung",
    "went back to {number}": "zurück zu {number}",
    "file": "Datei",
    "file of reference {number}": "Datei der Referenz {number}",
    "SIMULATED": "SIMULIERT",
    "recorded: the tracker's position sensor was checked; an alert of a bump, if there was one, ends": (
        "vermerkt: der Positionssensor des Trackers wurde geprüft; die Meldung eines Stoßes, wenn es eine gab, endet"
    ),
    "this is another alarm; it has not been acknowledged yet": "das ist ein anderer Alarm; er ist noch nicht quittiert",
    "it ends once a calibration that has not expired is verified: recalibrate": (
        "er endet, sobald eine nicht abgelaufene Kalibrierung bestätigt ist: neu kalibrieren"
    ),
    "it ends once the calibration is verified again: move the probe over tissue, or recalibrate": (
        "er endet, sobald die Kalibrierung wieder bestätigt ist: Sonde über Gewebe bewegen, oder neu kalibrieren"
    ),
    "now": "jetzt",
    "there is nothing to acknowledge": "es gibt nichts zu quittieren",
    "not possible while": "nicht möglich im Zustand",
    "It ends by itself once its cause is mended; silent until then: probewatch pause": (
        "Er endet von selbst, sobald seine Ursache behoben ist; bis dahin stumm: probewatch pause"
    ),
    "already acknowledged, waiting until the calibration is verified again": (
        "schon quittiert; er endet, sobald die Kalibrierung wieder bestätigt ist"
    ),
    "this service has no lamp and no tone, only the contact; see [[output]] in its configuration": (
        "dieser Dienst hat weder Lampe noch Ton, nur den Kontakt; siehe [[output]] in seiner Konfiguration"
    ),
    "for five seconds these must light up or sound:": "fünf Sekunden lang müssen diese leuchten oder tönen:",
    "the alarm sound is on again": "der Alarmton ist wieder an",
    "the alarm is silent until 'probewatch pause --on'; it reminds once a minute": (
        "der Alarm ist stumm bis 'probewatch pause --on'; er erinnert einmal in der Minute"
    ),
    "the alarm sound is switched off already, and stays so until 'probewatch pause --on'": (
        "der Alarmton ist schon ausgeschaltet und bleibt es bis 'probewatch pause --on'"
    ),
    "the alarm is silent for {seconds} s": "der Alarm ist {seconds} s lang stumm",
    "this cart has no tone output": "dieser Wagen hat keinen Ton",
    "none of the {number} entries matches": "keiner der {number} Einträge passt",
    "{number} entries, the chain is whole": "{number} Einträge, die Kette ist heil",
    "the chain is NOT whole: copy the folder for whoever looks into it, then probewatch ack": (
        "die Kette ist NICHT heil: den Ordner für die Klärung kopieren, dann probewatch ack"
    ),
    "the chain is NOT whole: keep this folder as it is; probewatch ack is for the cart's own log": (
        "die Kette ist NICHT heil: diesen Ordner lassen, wie er ist; probewatch ack gilt dem des Wagens"
    ),
    "{number} entries written to {file}": "{number} Einträge nach {file} geschrieben",
    "latched": "gehalten",
    "by": "durch",
    "stopped": "beendet",
    "state": "Zustand",
    "request": "Anfrage",
    "proposal": "Vorschlag",
    "deg": "Grad",
    "axes": "Achsen",
    "nothing to compare: {name}": "nichts zu vergleichen: {name}",
}

LANGUAGES = {"en": {}, "de": GERMAN}


def translated(text: str, language: str) -> str:
    """Returns the text in one of LANGUAGES. Raises KeyError for a text that has no translation."""
    return text if language == "en" else LANGUAGES[language][text]


_FIELDS = {"name": ".+?", "names": ".+", "unit": ".*?", "motions": ".+", "said": ".+?", "text": ".+?", "what": ".+?"}
"""Regular expressions of the fields of a template; every other field is a number."""
_LISTS = {"name": ", ", "names": ", ", "motions": " + "}
"""Fields whose parts are texts of the table, and the separator between the parts."""
_NUMBER = r"[-+]?\d\S*"
_FORMAT = re.compile(r"(?<={)(\w+):[^{}]*(?=})")
"""Matches a field of a template that has a number's format; a text that is recognised has already been formatted."""


def _pattern(template: str) -> re.Pattern[str]:
    """Returns a pattern for the template as filled in; a field that occurs twice is the same both times."""
    seen: set[str] = set()

    def group(field: re.Match[str]) -> str:
        name = field[1]
        if name in seen:
            return f"(?P={name})"
        seen.add(name)
        return f"(?P<{name}>{_FIELDS.get(name, _NUMBER)})"

    return re.compile(re.sub(r"\\{(\w+)\\}", group, re.escape(template)))


class Texts:
    """Holds the texts of one language by the English text or its template, and the patterns that recognise them."""

    def __init__(self, table: Mapping[str, str]) -> None:
        self._table = {_FORMAT.sub(r"\1", english): _FORMAT.sub(r"\1", text) for english, text in table.items()}
        self._patterns = {english: _pattern(english) for english in self._table if re.search(r"{\w+}", english)}

    def translated(self, text: str) -> str:
        """Returns the text in the language, as a whole, else the English text itself."""
        table = self._table
        said = [table[text]] if text in table else [self._clause(clause) for clause in text.split("; ")]
        if None not in said:
            return "; ".join(filter(None, said))
        parts = text.split(" · ")
        told = [self.translated(part) for part in parts] if len(parts) > 1 else parts
        return text if any(one == part for one, part in zip(told, parts, strict=True)) else " · ".join(told)

    def _clause(self, clause: str) -> str | None:
        if clause in self._table:
            return self._table[clause]
        for english, pattern in self._patterns.items():
            parts = pattern.fullmatch(clause)
            if parts is not None and (filled := self._filled(self._table[english], parts.groupdict())) is not None:
                return filled
        return None

    def _filled(self, template: str, parts: Mapping[str, str]) -> str | None:
        """Returns the template with its fields filled in, None where the table lacks the name of a check or motion, or
        the text of `said`. Units that are words are translated; symbols and numbers stay.
        """
        table = self._table
        listed = {key: parts[key].split(joint) for key, joint in _LISTS.items() if key in parts}
        if not all(one in table for each in listed.values() for one in each):
            return None
        said = {key: _LISTS[key].join(table[one] for one in each) for key, each in listed.items()}
        if "said" in parts:
            inner = self._clause(parts["said"])
            if inner is None:
                return None
            said["said"] = inner
        unit = parts.get("unit", "")
        return template.format(**{**parts, **said, "unit": table.get(unit, unit)})


_TEXTS = {language: Texts(table) for language, table in LANGUAGES.items()}


def translated_text(text: str, language: str) -> str:
    """Returns a text of the running service in one of LANGUAGES, as a whole, else the English text itself."""
    return text if language == "en" else _TEXTS[language].translated(text)
