"""Holds the German of what `record` reports of the recorder."""

from probewatch.tools.german.free_texts import FreeTexts

GERMAN_OF_RECORDER = {
    "recorder": "Aufzeichnung",
    "this stretch": "dieser Abschnitt",
    "ring": "Ring",
    "kept": "behalten",
    "disk": "Festplatte",
    "lost": "verloren",
    "withheld": "nicht behalten",
    "session": "Sitzung",
    "recording": "läuft",
    "waits for the service": "wartet auf den Dienst",
    "NOT recording: {why}": "läuft NICHT: {why}",
    "marked: it is kept": "markiert: er bleibt erhalten",
    "not marked": "nicht markiert",
    "{said}, {gone} older files gone": "{said}, {gone} ältere sind überschrieben",
    "{size} in {number} file": "{size} in {number} Datei",
    "{size} in {number} files": "{size} in {number} Dateien",
    "{size} free": "{size} frei",
    "nothing": "nichts",
    "{number} samples": "{number} Werte",
    "{number} pictures": "{number} Bilder",
    "recording into {folder}": "aufgezeichnet wird in {folder}",
}


recorder_text = FreeTexts(GERMAN_OF_RECORDER, {}).told
