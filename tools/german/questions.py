"""Holds, like `texts`, the German of the questions of `configure`."""

GERMAN_OF_QUESTIONS = {
    "the scanner's picture": "das Bild des Ultraschallgeräts",
    "the tracker": "der Tracker",
    "the output that drives the contact": "der Ausgang, der den Kontakt schaltet",
    "{which}: a number, or a URL such as {examples}": "{which}: eine Nummer, oder eine URL wie {examples}",
    "! {said} is not in the list, which is empty; or give a URL": (
        "! {said} ist nicht in der Liste, die leer ist; oder eine URL angeben"
    ),
    "! {said} is not in the list, give 1 to {most}; or give a URL": (
        "! {said} ist nicht in der Liste, 1 bis {most} angeben; oder eine URL"
    ),
    "! {error}, or '{without}'": "! {error}, oder '{without}'",
    "tool definition file (.rom) of the probe's markers, or 'wired'": (
        "Definitionsdatei (.rom) des Markerkörpers der Sonde, oder 'wired'"
    ),
    "the same of a second marker body on the probe, or 'none'": (
        "die eines zweiten Markerkörpers an der Sonde, oder 'none'"
    ),
    "Use it anyway?": "Trotzdem verwenden?",
    "needs an answer, and there is no terminal": "dazu fehlt eine Antwort, und es gibt kein Terminal",
    "Give {option}": "{option} angeben",
    "  trying {url} for {seconds} s …": "  {url} wird {seconds} s lang versucht …",
    "Calibration file (probewatch TOML or PLUS device set, XML), or none: scan it on this cart": (
        "Kalibrierdatei (TOML von probewatch oder XML von PLUS), oder none: auf diesem Wagen scannen"
    ),
    "calibration": "Kalibrierung",
    "Name another file, or none": "Eine andere Datei nennen, oder none",
    "How far the calibration may be off while the contact is closed": (
        "Wie weit die Kalibrierung danebenliegen darf, während der Kontakt geschlossen ist"
    ),
    "3 deg, 5 %, 4 mm, 60 ms: finds a wrong or bent marker body, cable, depth; the one to begin with": (
        "3 Grad, 5 %, 4 mm, 60 ms: findet falschen oder verbogenen Markerkörper, Kabel, Tiefe; damit beginnen"
    ),
    "1.5 deg, 3 %, 2.5 mm, 30 ms, a point within 4 mm: optical tracker, phantom; open more often": (
        "1.5 Grad, 3 %, 2.5 mm, 30 ms, ein Punkt auf 4 mm: optischer Tracker, Phantom; öfter offen"
    ),
    "1 deg, 2 %, 1.5 mm, 20 ms, a point within 2.5 mm: over rigid tissue alone, gesture of 10 s": (
        "1 Grad, 2 %, 1.5 mm, 20 ms, ein Punkt auf 2.5 mm: nur über starrem Gewebe, Geste von 10 s"
    ),
    "limits": "Grenzen",
    "language of the operator's texts": "Sprache der Texte am Wagen",
    "{file} is already up to date; nothing was written": "{file} ist schon so; nichts wurde geschrieben",
    "{file}, what changes:": "{file}, was sich ändert:",
    "{file} is new:": "{file} ist neu:",
    "Write it?": "Schreiben?",
    "nothing was written": "nichts wurde geschrieben",
    "Ctrl-C where it runs, then {text}": "Strg-C, wo er läuft, dann {text}",
    "to apply it: {how}": "damit es gilt: {how}",
    "a service that was waiting for it starts by itself; see: {command}": (
        "ein Dienst, der darauf gewartet hat, startet von selbst; siehe: {command}"
    ),
    "to test the contact, when it is not in use and no service is running: probewatch probe '{url}' --click": (
        "den Kontakt testen, wenn er nicht benutzt wird und kein Dienst läuft: probewatch probe '{url}' --click"
    ),
    "no calibration yet? scan it: probewatch recalibrate --live --solve all --config {file}": (
        "noch keine Kalibrierung? Scannen: probewatch recalibrate --live --solve all --config {file}"
    ),
}
