"""The operator's texts in other languages: one table a language, from the English text. English needs none."""

GERMAN = {
    "Self-test": "Selbsttest",
    "Wait a few seconds": "Einige Sekunden warten",
    "Waiting for devices": "Warten auf Geräte",
    "Switch on the scanner and the tracker": "Ultraschallgerät und Tracker einschalten",
    "Calibration not verified": "Kalibrierung nicht bestätigt",
    "Move the probe over tissue in view of the tracker": "Sonde im Sichtfeld des Trackers über Gewebe bewegen",
    "Calibration verified": "Kalibrierung bestätigt",
    "None needed": "Nichts zu tun",
    "Do not rely on the overlay": "Nicht auf die Überlagerung verlassen",
    "Look at the cause; wait a few seconds": "Ursache ansehen; einige Sekunden warten",
    "HALT: calibration is wrong": "HALT: Kalibrierung ist falsch",
    "Stop; mend the cause, verify, acknowledge": "Anhalten; Ursache beheben, prüfen, quittieren",
    "HALT: recalibrate the probe": "HALT: Sonde neu kalibrieren",
    "Stop; mend the cause or recalibrate; acknowledge": "Anhalten; Ursache beheben oder kalibrieren; quittieren",
    "Recalibrating": "Kalibrierung läuft",
    "Finish the scan, then move the probe over tissue to verify": "Aufnahme beenden, dann Sonde über Gewebe bewegen",
    "Device lost: not watching": "Gerät fehlt: keine Überwachung",
    "Bring it back; monitoring resumes by itself": "Gerät wieder anschließen; die Überwachung läuft von selbst an",
    "Internal fault: not watching": "Interner Fehler: keine Überwachung",
    "Wait for its restart; else restart the cart": "Neustart abwarten; sonst den Wagen neu starten",
    "Picture is mirrored": "Bild ist gespiegelt",
    "Reset the scanner's left/right and up/down flip": "Spiegelung am Ultraschallgerät zurückstellen",
    "Picture scale has changed": "Bildmaßstab ist verändert",
    "Set the scanner's depth and zoom as calibrated": "Tiefe und Zoom wie bei der Kalibrierung einstellen",
    "Marker body has turned": "Markerkörper ist verdreht",
    "Check the marker clamp, then recalibrate": "Klemme des Markerkörpers prüfen, dann neu kalibrieren",
    "Marker body has slipped": "Markerkörper ist verrutscht",
    "Tracker and picture are out of step": "Tracker und Bild laufen auseinander",
    "Check frame rate and persistence": "Bildrate und Persistenz prüfen",
    "Picture is frozen": "Bild ist eingefroren",
    "Unfreeze the scanner; check the video cable": "Standbild aufheben; Videokabel prüfen",
    "No picture from the scanner": "Kein Bild vom Ultraschallgerät",
    "Check the scanner and the video cable": "Ultraschallgerät und Videokabel prüfen",
    "No answer from the tracker": "Tracker antwortet nicht",
    "Check the tracker's power and cable": "Strom und Kabel des Trackers prüfen",
    "Tracker repeats old positions": "Tracker wiederholt alte Positionen",
    "Restart tracking; check the tracker": "Tracking neu starten; Tracker prüfen",
    "Alarm output does not respond": "Alarmausgang antwortet nicht",
    "Check the relay's cable and power": "Kabel und Strom des Relais prüfen",
    "Verification has stopped": "Prüfung steht still",
    "Alarm memory is damaged": "Alarmspeicher ist beschädigt",
    "Alarm log is damaged": "Alarmprotokoll ist beschädigt",
    "Read 'probewatch log --verify', then acknowledge": "'probewatch log --verify' lesen, dann quittieren",
    "Alarm log cannot be written": "Alarmprotokoll kann nicht geschrieben werden",
    "Make room on the cart's disk": "Platz auf der Festplatte des Wagens schaffen",
}

LANGUAGES = {"en": {}, "de": GERMAN}


def translated(text: str, language: str) -> str:
    """The text in one of LANGUAGES. Raises KeyError for one that has no translation."""
    return text if language == "en" else LANGUAGES[language][text]
