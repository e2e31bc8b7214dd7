"""Holds the German of what `probe`, `devices` and trials of `configure` report. The words of a device itself stay."""

from probewatch.tools.german.free_texts import FreeTexts
from probewatch.tools.german.remarks import GERMAN_OF_REMARKS

GERMAN_OF_MENDING = {
    "Check that the device is switched on and measures": "Prüfen, ob das Gerät eingeschaltet ist und misst",
    "Bring the tool further into the measurement volume": "Das Werkzeug weiter ins Messvolumen bringen",
    "Bring the tool into the measurement volume": "Das Werkzeug ins Messvolumen bringen",
    "Bring the tool into view, and clear the way between it and the tracker": (
        "Das Werkzeug ins Sichtfeld bringen, und den Weg zwischen ihm und dem Tracker frei machen"
    ),
    "Check that the tracker measures; start it again if it does": (
        "Prüfen, ob der Tracker misst; ihn neu starten, wenn er misst"
    ),
    "Plug the tool in, or correct its number or definition in the URL": (
        "Das Werkzeug einstecken, oder seine Nummer oder Definition in der URL berichtigen"
    ),
    "Clear the condition that the tracker reports": "Beheben, was der Tracker meldet",
    "Check the transform that the sender computes for this tool: it must be rigid, in mm": (
        "Die Transformation prüfen, die der Sender für dieses Werkzeug rechnet: starr, in mm"
    ),
}
"""What to do about a device that delivers nothing of use, or less than it could."""

GERMAN_OF_DEVICES = {
    # devices
    "No serial port, no video device and no GPIO chip is connected.": (
        "Keine serielle Schnittstelle, kein Videogerät und kein GPIO-Chip ist angeschlossen."
    ),
    "kind": "Art",
    "path": "Pfad",
    "node": "Knoten",
    "what it is": "was es ist",
    "state": "Zustand",
    "serial port": "serielle Schnittstelle",
    "GPIO chip": "GPIO-Chip",
    "free": "frei",
    "has no node in /dev": "hat keinen Knoten in /dev",
    "no permission; add this user to the group {name}": (
        "keine Berechtigung; diesen Benutzer in die Gruppe {name} aufnehmen"
    ),
    "in use by {name}": "benutzt von {name}",
    "serial port on the board": "serielle Schnittstelle der Platine",
    "unnamed": "ohne Namen",
    "{name}, node {number}": "{name}, Knoten {number}",
    "{name}, {number} lines": "{name}, {number} Leitungen",
    # probe: how it goes
    "connected in {time} s, measuring for {seconds} s": "verbunden in {time} s, gemessen wird {seconds} s lang",
    "Poses": "Posen",
    "Pictures": "Bilder",
    "nothing": "nichts",
    "lost": "verloren",
    "good": "gut",
    "poor, see the lines marked with !": "mangelhaft, siehe die Zeilen mit !",
    "the recording has ended": "die Aufzeichnung ist zu Ende",
    "If {half} are all that is asked of it: --only {option}": "Wenn nur {half} verlangt sind: --only {option}",
    # probe: names of lines
    "model": "Modell",
    "firmware": "Firmware",
    "serial number": "Seriennummer",
    "tools": "Werkzeuge",
    "device rate": "Rate des Geräts",
    "remark": "Hinweis",
    "samples": "Werte",
    "picture": "Bild",
    "marker fit": "Markerpassung",
    "rate": "Rate",
    "timestamp error": "Fehler der Zeiten",
    "timestamp jitter": "Streuung der Zeiten",
    "delay": "Verzögerung",
    "gaps": "Lücken",
    "contact energised in": "Kontakt angezogen in",
    "contact released in": "Kontakt abgefallen in",
    # probe: what was measured
    "not to be told": "nicht zu sagen",
    "{number} measurements per second": "{number} Messungen je Sekunde",
    "{number}, of which {usable} can be used": "{number}, davon brauchbar {usable}",
    "{width} x {height} pixels": "{width} x {height} Pixel",
    "median {median}, worst {worst} mm RMS or indicator": "Median {median}, schlechteste {worst} mm RMS oder Indikator",
    "{hz} per second, the device counts {step} for each": "{hz} je Sekunde, das Gerät zählt {step} für jeden",
    "median ± {median} ms, at worst ± {worst} ms": "Median ± {median} ms, schlechtestens ± {worst} ms",
    "{delay} ms from measurement to arrival, at worst {worst} ms": (
        "{delay} ms von der Messung bis zur Ankunft, schlechtestens {worst} ms"
    ),
    "{number}, {lost} samples lost in them; longest step {step} ms": (
        "{number}, darin {lost} Werte verloren; längster Schritt {step} ms"
    ),
    "{time} ms, confirmed": "{time} ms, bestätigt",
    "{time} ms, commanded, not confirmed": "{time} ms, befohlen, nicht bestätigt",
    # what is not as it should be
    "no feedback confirms that the contact moved. Watch it, or listen for two clicks": (
        "keine Rückmeldung bestätigt, dass der Kontakt schaltete. Ihn ansehen, oder auf zweimal Klicken hören"
    ),
    "{share} % of the poses: {status} ({reason}). {said}": "{share} % der Posen: {status} ({reason}). {said}",
    "the marker fit is poor ({fit}). Clean the markers and compare body and definition": (
        "die Markerpassung ist mangelhaft ({fit}). Die Marker reinigen, Körper und Definition vergleichen"
    ),
    "all poses lie within {far} mm of the origin. Have the sender use mm; it may use metres": (
        "alle Posen liegen innerhalb von {far} mm um den Ursprung. Der Sender muss mm geben; vielleicht gibt er Meter"
    ),
    "all {number} pictures are the same. Move the probe, end the scanner's freeze; of an interlaced stream OpenCV "
    "decodes no picture": (
        "alle {number} Bilder sind gleich. Die Sonde bewegen, das Standbild beenden; aus einem Strom mit Halbbildern "
        "decodiert OpenCV kein Bild"
    ),
    "the time is known only to ± {bound} ms in the median. {remedy}": (
        "die Zeit ist im Median nur auf ± {bound} ms bekannt. {remedy}"
    ),
    "{number} {half} come per second, {least} are needed. Have the device or the sender give each one that it "
    "measures": (
        "{number} {half} kommen je Sekunde, {least} sind nötig. Gerät oder Sender soll alle geben, die es misst"
    ),
    "the times scatter by {jitter} ms. Look for a slow line, or a sender that stamps late": (
        "die Zeiten streuen um {jitter} ms. Nach einer langsamen Leitung oder einem Sender suchen, der spät stempelt"
    ),
    "{number} samples were lost. Look for a slow line, or a busy host": (
        "{number} Werte gingen verloren. Nach einer langsamen Leitung oder einem beschäftigten Rechner suchen"
    ),
    **GERMAN_OF_MENDING,
    **GERMAN_OF_REMARKS,
}
_WORDS = {
    "poses": "Posen",
    "pictures": "Bilder",
    "partly out of volume": "teils außerhalb des Messvolumens",
    "out of volume": "außerhalb des Messvolumens",
    "missing": "fehlt",
    "stale": "veraltet",
    "disabled": "abgeschaltet",
    "fault": "Fehler",
    "ok": "in Ordnung",
    "nothing": "nichts",
    "not understood": "nicht verstanden",
    "Measure longer, or look for what delays the line": "Länger messen, oder suchen, was die Leitung verzögert",
}
"""Words of this program that may fill a field; what a device or driver puts there instead stays as it is."""


device_text = FreeTexts(GERMAN_OF_DEVICES, _WORDS).told
