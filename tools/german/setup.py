"""Holds, like `texts`, the German of what `check`, `log`, the dates of a calibration and the questions before a change
report of a cart as it was set up.
"""

GERMAN_OF_SETUP = {
    # check
    "{file} can be used; it names no calibration": "{file} ist brauchbar; sie nennt keine Kalibrierung",
    "reference {number} of its history stays in force; another: probewatch calibration use FILE": (
        "Referenz {number} ihres Verlaufs bleibt in Kraft; eine andere: probewatch calibration use DATEI"
    ),
    "{file} and {named} can be used": "{file} und {named} sind brauchbar",
    "{file} is not configured yet: probewatch configure {file}": (
        "{file} ist noch nicht eingerichtet: probewatch configure {file}"
    ),
    "but the service waits until it says configured = true": (
        "aber der Dienst wartet, bis darin configured = true steht"
    ),
    'it has no date, so [calibration] overdue = "expires" opens nothing. Give due_days there too': (
        'sie hat kein Datum, [calibration] overdue = "expires" öffnet also nie. Dort auch due_days angeben'
    ),
    "profile {profile}": "Profil {profile}",
    "given in the file": "in der Datei angegeben",
    "given in the file, as profile {profile} has it": "in der Datei angegeben, wie Profil {profile} sie hat",
    "given in the file; profile {profile} has {usual}": "in der Datei angegeben; Profil {profile} hat {usual}",
    "off": "aus",
    "{key} is never verified, so the contact stays open: what motion cannot tell fills it "
    "({sigmas} x {left_out} {unit}). Give more than {least}": (
        "{key} wird nie bestätigt, der Kontakt bleibt also offen: was Bewegung nicht zeigen kann, füllt sie aus "
        "({sigmas} x {left_out} {unit}). Mehr als {least} angeben"
    ),
    "{key} is never verified over tissue that gives way, as a patient's: what motion cannot tell fills it there "
    "({sigmas} x {left_out} {unit}). Give more than {least}": (
        "{key} wird über nachgiebigem Gewebe wie dem eines Patienten nie bestätigt: was Bewegung nicht zeigen kann, "
        "füllt sie dort aus ({sigmas} x {left_out} {unit}). Mehr als {least} angeben"
    ),
    "{key} = {age}: what quiet scanning shows is up to {quiet} s old, so the contact opens again and again. Give "
    "{quiet} or more": (
        "{key} = {age}: was ruhiges Scannen zeigt, ist bis zu {quiet} s alt, der Kontakt öffnet also immer wieder. "
        "{quiet} oder mehr angeben"
    ),
    "[limits] point_depth_mm = {depth} lies below the picture, which is {height} mm high. Give less": (
        "[limits] point_depth_mm = {depth} liegt unter dem Bild, das {height} mm hoch ist. Weniger angeben"
    ),
    "[limits] {name} is looser than profile {profile} has it: OK says less than that name": (
        "[limits] {name} ist weiter als in Profil {profile}: OK sagt weniger als dieser Name"
    ),
    # before a change
    "needs a person to accept it; nothing was changed": "das muss ein Mensch annehmen; nichts wurde geändert",
    "Give --yes to accept it": "Mit --yes annehmen",
    "What stands in its way: probewatch status": "Was im Wege steht: probewatch status",
    # self-test
    "reference {number} is in force, as was decided later": ("Referenz {number} ist in Kraft, wie später entschieden"),
    "1 of {number} is not green.": "1 von {number} ist nicht grün.",
    # dates of a calibration
    "it counts from {day}, when its file was first used": "gezählt vom {day}, als ihre Datei zum ersten Mal galt",
    "if the clock was wrong then: use a changed file, or probewatch calibration reset": (
        "falls die Uhr damals falsch ging: eine geänderte Datei verwenden, oder probewatch calibration reset"
    ),
    # status
    "the configuration names no calibration any more, and reference {number} stays in force": (
        "die Konfiguration nennt keine Kalibrierung mehr, und Referenz {number} bleibt in Kraft"
    ),
    "once the position sensor was looked at: probewatch ack --bump": (
        "sobald der Positionssensor angesehen wurde: probewatch ack --bump"
    ),
    # log
    "chain begun": "Kette begonnen",
    "started": "gestartet",
    "reloaded": "neu gelesen",
    "of a new log": "eines neuen Protokolls",
    "configuration {sha}": "Konfiguration {sha}",
    "reference {number}": "Referenz {number}",
    "SIMULATED: {urls}": "SIMULIERT: {urls}",
    "threshold of a name by {file}": "Schwelle für einen Namen nach {file}",
    "{user}, process {number}": "{user}, Prozess {number}",
    "without an entry each: {said} {times} times": "ohne eigenen Eintrag: {said} {times}-mal",
    "{said} {times} times": "{said} {times}-mal",
    "by {who}": "durch {who}",
}
