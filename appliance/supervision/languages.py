"""The operator's texts in other languages: one table a language, from the English text. English needs none.

A text that is put together while the service runs is translated clause by clause, and stays English as a whole where
one of them is unknown: half a sentence in each language is worse than either.
"""

import re
from collections.abc import Mapping

GERMAN = {
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
    "Picture is mirrored": "Bild ist gespiegelt",
    "Reset the scanner's left/right and up/down flip": "Spiegelung am Ultraschallgerät zurückstellen",
    "Picture scale has changed": "Bildmaßstab ist verändert",
    "Set the scanner's depth and zoom as calibrated": "Tiefe und Zoom wie bei der Kalibrierung einstellen",
    "Set the scanner's depth and zoom as calibrated, else recalibrate": (
        "Tiefe und Zoom wie bei der Kalibrierung einstellen, sonst neu kalibrieren"
    ),
    "Marker body or tracker has turned": "Markerkörper oder Tracker ist verdreht",
    "Scan: if it verifies, the tracker moved; else clamp, 'calibration recover'": (
        "Schallen; wird bestätigt: Tracker; sonst Klemme, 'calibration recover'"
    ),
    "Scan: if it verifies, the tracker moved; else check clamp, recalibrate": (
        "Schallen; wird bestätigt: Tracker; sonst Klemme prüfen, neu kalibrieren"
    ),
    "Marker body or tracker has moved": "Markerkörper oder Tracker ist verrutscht",
    "Tracker and picture are out of step": "Tracker und Bild laufen auseinander",
    "Check frame rate; set latency_ms as proposed": "Bildrate prüfen; latency_ms wie vorgeschlagen setzen",
    "Tracker's axes do not fit": "Achsen des Trackers passen nicht",
    "Check the tool file and the tracker's export": "Werkzeugdatei und Export des Trackers prüfen",
    "Another probe than calibrated": "Andere Sonde als kalibriert",
    "Use the calibrated probe, or load this one's calibration": (
        "Kalibrierte Sonde nehmen oder Kalibrierung dieser Sonde laden"
    ),
    "Use the calibrated probe, or calibrate this one": "Kalibrierte Sonde nehmen oder diese kalibrieren",
    "One of two marker bodies has moved": "Einer der Markerkörper ist verschoben",
    "Check both clamps; scan: it shows whether the calibration holds": (
        "Beide Klemmen prüfen; schallen: es zeigt, ob die Kalibrierung hält"
    ),
    "Something is wrong, not yet clear what": "Falsch, noch unklar was",
    "Make the motion that shows which of the two it is": "Die Bewegung machen, die zeigt, welches von beiden es ist",
    "Picture is frozen": "Bild ist eingefroren",
    "Unfreeze the scanner; check the video cable": "Standbild aufheben; Videokabel prüfen",
    "No picture from the scanner": "Kein Bild vom Ultraschallgerät",
    "Check the scanner and the video cable": "Ultraschallgerät und Videokabel prüfen",
    "No answer from the tracker": "Tracker antwortet nicht",
    "Check the tracker's power and cable": "Strom und Kabel des Trackers prüfen",
    "Tracker repeats old positions": "Tracker wiederholt alte Positionen",
    "Restart tracking; check the tracker": "Tracking neu starten; Tracker prüfen",
    "Tracker reports a fault": "Tracker meldet einen Fehler",
    "See its remarks; check a bumped sensor, clear it": "Hinweise lesen; nach einem Stoß Sensor prüfen, dann löschen",
    "Marker body is bent or dirty": "Markerkörper verbogen oder verschmutzt",
    "Clean and check all markers and the clamp": "Alle Marker und die Klemme reinigen und prüfen",
    "Tracker's field is distorted": "Feld des Trackers ist gestört",
    "Move metal and cables away from it": "Metall und Kabel von ihm entfernen",
    "Alarm output does not respond": "Alarmausgang antwortet nicht",
    "Check the relay's cable and power": "Kabel und Strom des Relais prüfen",
    "Verification has stopped": "Prüfung steht still",
    "Alarm memory is damaged": "Alarmspeicher ist beschädigt",
    "Alarm log is damaged": "Alarmprotokoll ist beschädigt",
    "Read 'probewatch log --verify', then acknowledge": "'probewatch log --verify' lesen, dann quittieren",
    "Probe not seen by the tracker": "Tracker sieht die Sonde nicht",
    "Bring the probe into the tracker's view": "Sonde ins Sichtfeld des Trackers bringen",
    "No ultrasound in the picture": "Kein Ultraschall im Bild",
    "Probe on the skin, live picture on the scanner": "Sonde auf die Haut, Livebild am Ultraschallgerät",
    "Alarm log cannot be written": "Alarmprotokoll kann nicht geschrieben werden",
    "Configured calibration is not in force": "Konfigurierte Kalibrierung ist nicht in Kraft",
    "Read 'probewatch calibration list'": "'probewatch calibration list' lesen",
    "Calibration is overdue": "Kalibrierung ist überfällig",
    "Recalibrate, or check it with the cross-wire": "Neu kalibrieren, oder am Fadenkreuz prüfen",
    "Make room on the cart's disk; check it": "Platz auf der Festplatte des Wagens schaffen; sie prüfen",
    "This computer is overloaded": "Dieser Rechner ist überlastet",
    "Close other programs; check a device that stays lost": "Andere Programme schließen; Gerät prüfen, das weg bleibt",
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
    "too little in-plane motion to show: {names}": "zu wenig Bewegung in der Bildebene für: {names}",
    "one of these is wrong, {margin} nat apart: {names}": "eines davon ist falsch, {margin} nat auseinander: {names}",
    "to tell which: {motions}": "zur Unterscheidung: {motions}",
    "{name} is now {value} ± {sigma} {unit}, was {old} {unit}": (
        "{name} ist jetzt {value} ± {sigma} {unit}, war {old} {unit}"
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
    "deg": "Grad",
    "axes": "Achsen",
    "polarity": "Spiegelung",
    "rotation-lateral": "Drehung lateral",
    "rotation-axial": "Drehung axial",
    "rotation-elevational": "Drehung elevational",
    "scale-lateral": "Maßstab lateral",
    "scale-axial": "Maßstab axial",
    "offset-lateral": "Versatz lateral",
    "offset-axial": "Versatz axial",
    "offset-elevational": "Versatz elevational",
    "latency": "Verzögerung",
    "motion-agreement": "Übereinstimmung",
    "undecided": "Unentschieden",
    "nothing to compare: {name}": "nichts zu vergleichen: {name}",
    "no-picture": "Kein Ultraschall",
    "user-freeze": "Bild angehalten",
    "What comes as a pose is none": "Was als Pose kommt, ist keine",
    "See the tracker's remarks; name the right tool": "Hinweise des Trackers lesen; Werkzeug richtig nennen",
    "Picture is paused by the user": "Bild vom Benutzer angehalten",
    "Unfreeze the scanner to continue": "Zum Weitermachen Standbild aufheben",
    "picture-flip": "Bild gespiegelt",
    "picture-zoom": "Bild gezoomt",
    "picture-size": "Bildgröße",
    "depth-ruler": "Tiefenlineal",
    "fan-stretch": "Fächer gestreckt",
    "fan-shift": "Fächer verschoben",
    "fan-scale": "Fächermaßstab",
    "fan-motion": "Fächer und Bewegung",
    "poses-inverted": "Posen umgekehrt",
    "axes-swapped": "Achsen vertauscht",
    "axis-mirrored": "Achse gespiegelt",
    "turns-inverted": "Drehungen umgekehrt",
    "quaternion-order": "Quaternion verdreht",
    "exchanged-probe": "Andere Sonde",
    "marker-turn": "Marker verdreht",
    "marker-shift": "Marker verschoben",
    "marker-elevational": "Marker elevational",
    "witness-slide": "Zeuge verschoben",
    "witness-turn": "Zeuge verdreht",
    "frozen-video": "Standbild",
    "frozen-tracker": "Tracker steht",
    "video presence": "Video da",
    "tracker presence": "Tracker da",
    "tracker freshness": "Tracker aktuell",
    "tracker alert": "Trackermeldung",
    "line of sight": "Sichtverbindung",
    "pose usable": "Pose brauchbar",
    "marker fit": "Markerpassung",
    "marker geometry": "Markergeometrie",
    "field indicator": "Feldanzeige",
    "estimator presence": "Prüfprozess da",
    "output presence": "Alarmausgang da",
    "alarm log integrity": "Protokoll unversehrt",
    "calibration file": "Kalibrierdatei",
    "calibration date": "Kalibrierfrist",
    "alarm log written": "Protokoll gesichert",
}

LANGUAGES = {"en": {}, "de": GERMAN}


def translated(text: str, language: str) -> str:
    """The text in one of LANGUAGES. Raises KeyError for one that has no translation."""
    return text if language == "en" else LANGUAGES[language][text]


_FIELDS = {"name": ".+?", "names": ".+", "unit": ".*?", "motions": ".+"}
_LISTS = {"name": ", ", "names": ", ", "motions": " + "}
"""Fields whose parts are texts of the table, and what stands between them."""
_NUMBER = r"[-+]?\d\S*"


def _pattern(template: str) -> re.Pattern[str]:
    """Matches what the template becomes; a field that comes twice is the same both times."""
    seen: set[str] = set()

    def group(field: re.Match[str]) -> str:
        name = field[1]
        if name in seen:
            return f"(?P={name})"
        seen.add(name)
        return f"(?P<{name}>{_FIELDS.get(name, _NUMBER)})"

    return re.compile(re.sub(r"\\{(\w+)\\}", group, re.escape(template)))


_PATTERNS = {english: _pattern(english) for english in GERMAN if re.search(r"{\w+}", english)}


def translated_text(text: str, language: str) -> str:
    """A text of the running service in one of LANGUAGES; whole in that language, else the English text itself."""
    if language == "en":
        return text
    table = LANGUAGES[language]
    said = [table[text]] if text in table else [_clause(clause, table) for clause in text.split("; ")]
    return text if None in said else "; ".join(filter(None, said))


def _clause(clause: str, table: Mapping[str, str]) -> str | None:
    if clause in table:
        return table[clause]
    for english, pattern in _PATTERNS.items():
        parts = pattern.fullmatch(clause)
        if parts is not None and english in table:
            return _filled(table[english], parts.groupdict(), table)
    return None


def _filled(template: str, parts: Mapping[str, str], table: Mapping[str, str]) -> str | None:
    """Names of checks and motions must be known; units that are words are translated, symbols and numbers stay."""
    listed = {key: parts[key].split(joint) for key, joint in _LISTS.items() if key in parts}
    if not all(one in table for each in listed.values() for one in each):
        return None
    said = {key: _LISTS[key].join(table[one] for one in each) for key, each in listed.items()}
    unit = parts.get("unit", "")
    return template.format(**{**parts, **said, "unit": table.get(unit, unit)})
