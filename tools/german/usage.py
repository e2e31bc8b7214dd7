"""Holds the German of what click refuses of a command line, and of what the technician's commands refuse of options."""

from probewatch.tools.german.free_texts import FreeTexts

GERMAN_OF_USAGE = {
    # options, arguments and commands
    "No such option {name}.": "Die Option {name} gibt es nicht.",
    "No such option {name}. Did you mean {meant}?": "Die Option {name} gibt es nicht. Gemeint {meant}?",
    "No such option {name}. (Did you mean one of: {names}?)": (
        "Die Option {name} gibt es nicht. (Gemeint eines von: {names}?)"
    ),
    "No such command {name}.": "Den Befehl {name} gibt es nicht.",
    "No such command {name}. Did you mean {meant}?": "Den Befehl {name} gibt es nicht. Gemeint {meant}?",
    "No such command {name}. (Did you mean one of: {names}?)": (
        "Den Befehl {name} gibt es nicht. (Gemeint eines von: {names}?)"
    ),
    "No such command {name}. Use one of {names}.": "Den Befehl {name} gibt es nicht. Möglich: {names}.",
    "Missing command.": "Der Befehl fehlt.",
    "Missing argument {name}.": "Das Argument {name} fehlt.",
    "Missing argument {name}. Choose from: {names}": "Das Argument {name} fehlt. Möglich: {names}",
    "Missing option {name}.": "Die Option {name} fehlt.",
    "Missing option {name}. Choose from: {names}": "Die Option {name} fehlt. Möglich: {names}",
    "Got unexpected extra argument ({names})": "Unerwartetes Argument ({names})",
    "Got unexpected extra arguments ({names})": "Unerwartete Argumente ({names})",
    "Option {name} requires an argument.": "Die Option {name} braucht einen Wert.",
    "Option {name} requires an argument: one of {names}": "Die Option {name} braucht einen Wert: {names}",
    "Option {name} requires {number} arguments.": "Die Option {name} braucht {number} Werte.",
    "Option {name} does not take a value.": "Die Option {name} nimmt keinen Wert.",
    "Option {name} needs a value, and {other} is an option. As its text: {example}": (
        "Die Option {name} braucht einen Wert, und {other} ist eine Option. Als ihr Text: {example}"
    ),
    # values
    "Invalid value for {name}: {said}": "Ungültiger Wert für {name}: {said}",
    "Invalid value: {said}": "Ungültiger Wert: {said}",
    "{value} is not one of {names}.": "{value} ist keines von {names}.",
    "{value} is not a valid integer.": "{value} ist keine ganze Zahl.",
    "{value} is not a valid integer range.": "{value} ist keine ganze Zahl.",
    "{value} is not a valid float.": "{value} ist keine Zahl.",
    "{value} is not a valid float range.": "{value} ist keine Zahl.",
    "{value} is not in the range {range}.": "{value} liegt nicht im Bereich {range}.",
    "{value} is not known. Did you mean {meant}?": "{value} ist nicht bekannt. Gemeint {meant}?",
    "{value} is not known. Use one of {names}.": "{value} ist nicht bekannt. Möglich: {names}.",
    "{value} is not a known fault. Use {names}": "{value} ist kein bekannter Fehler. Möglich: {names}",
    "{value} is not a known fault. Did you mean {meant}? Use {names}": (
        "{value} ist kein bekannter Fehler. Gemeint {meant}? Möglich: {names}"
    ),
    "{value} is not a day of the calendar, written as {example}": (
        "{value} ist kein Tag des Kalenders, geschrieben wie {example}"
    ),
    "{value} is not a day or a time, written as {one} or {other}": (
        "{value} ist kein Tag und keine Zeit, geschrieben wie {one} oder {other}"
    ),
    "File {file} does not exist.": "Die Datei {file} gibt es nicht.",
    "File {file} is a directory.": "{file} ist ein Ordner, keine Datei.",
    "Directory {file} does not exist.": "Den Ordner {file} gibt es nicht.",
    "Directory {file} is a file.": "{file} ist eine Datei, kein Ordner.",
    "Path {file} does not exist.": "Den Pfad {file} gibt es nicht.",
    # the technician's commands
    "{name} has no effect with {other}; leave it out": "{name} bewirkt nichts mit {other}; weglassen",
    "name the service: --config FILE, or --socket": "den Dienst nennen: --config DATEI, oder --socket",
    "the {kind} {name} has not begun: it is {now} UTC by this computer's clock. Give a day that has been": (
        "{name} ({kind}) hat nicht begonnen: es ist {now} UTC nach der Uhr dieses Rechners. Einen vergangenen Tag "
        "angeben"
    ),
    "{value} is no time for a pause: {least} to {most} seconds, such as {example} or {other}. Longer: --off REASON": (
        "{value} ist keine Zeit für eine Pause: {least} bis {most} Sekunden, wie {example} oder {other}. Länger: --off "
        "GRUND"
    ),
    "--on and --off exclude each other": "--on und --off schließen einander aus",
    "--verify looks at the whole log and writes nothing: leave the other options out": (
        "--verify sieht das ganze Protokoll an und schreibt nichts: die anderen Optionen weglassen"
    ),
    "--until is before --since": "--until liegt vor --since",
    "Missing argument 'URL', such as {meant}. What is connected: probewatch devices": (
        "Das Argument 'URL' fehlt, wie {meant}. Was angeschlossen ist: probewatch devices"
    ),
    "{url} gives no {only}; leave --only out": "{url} gibt keine {only}; --only weglassen",
    "--calibration names one; leave --no-calibration out": "--calibration nennt eine; --no-calibration weglassen",
    "--output ends in .xml or .tfm": "--output endet auf .xml oder .tfm",
    "Missing option '--image-size': the file does not say how large the pictures are": (
        "Die Option '--image-size' fehlt: die Datei sagt nicht, wie groß die Bilder sind"
    ),
    "--live scans on the cart itself; leave --simulated and --recording out": (
        "--live scannt am Wagen selbst; --simulated und --recording weglassen"
    ),
    "--latency-first needs a person at the terminal; leave --signed-by out": (
        "--latency-first braucht jemanden am Terminal; --signed-by weglassen"
    ),
    "--solve offset needs a recorded scan; --live solves zeta or all": (
        "--solve offset braucht einen aufgezeichneten Scan; --live löst zeta oder all"
    ),
    "give the scan: --live, or either --recording FILE or --simulated": (
        "den Scan angeben: --live, oder --recording DATEI, oder --simulated"
    ),
    "give the calibration in force: --calibration FILE, or --config FILE of the service": (
        "die Kalibrierung in Kraft angeben: --calibration DATEI, oder --config DATEI des Dienstes"
    ),
    "{name} goes with --solve all": "{name} gehört zu --solve all",
    "--strike {number}: the scan has views 1 to {most}": "--strike {number}: der Scan hat die Ansichten 1 bis {most}",
    # recordings
    "{value} is not a time in seconds after the start of the recording": (
        "{value} ist keine Zeit in Sekunden nach dem Anfang der Aufzeichnung"
    ),
    "{value} needs a time in seconds, such as {example}": "{value} braucht eine Zeit in Sekunden, wie {example}",
    "--pdf prints the page of --html": "--pdf druckt die Seite von --html",
    "--estimate needs --calibration": "--estimate braucht --calibration",
    "--inject needs --calibration": "--inject braucht --calibration",
    "--inject {value} begins after the recording, which ends at {seconds} s": (
        "--inject {value} beginnt nach der Aufzeichnung, die bei {seconds} s endet"
    ),
    "Missing option '--calibration': only a black box brings its own": (
        "Die Option '--calibration' fehlt: nur eine Blackbox bringt ihre eigene mit"
    ),
    "{name} is for sequences and films: a black box holds the pose that the cart used": (
        "{name} ist für Sequenzen und Filme: eine Blackbox enthält die Pose, die der Wagen verwendet hat"
    ),
    "{name} is for sequences: a black box holds the pose that the cart used": (
        "{name} ist für Sequenzen: eine Blackbox enthält die Pose, die der Wagen verwendet hat"
    ),
    "{name} is for one recording, these are several": "{name} ist für eine Aufzeichnung, dies sind mehrere",
    "{file} is not a recording; --json prints the report: --json > {other}": (
        "{file} ist keine Aufzeichnung; --json gibt den Bericht aus: --json > {other}"
    ),
    "--output {name} does not end in {ending}": "--output {name} endet nicht auf {ending}",
    "--output {name} has no known ending. Use one of {names}": "--output {name} hat keine bekannte Endung: {names}",
    # studies
    "{value} is none of {names}": "{value} ist keines von {names}",
    "{value} is not a list of .001 to 5 mm, such as {example}": (
        "{value} ist keine Liste von .001 bis 5 mm, wie {example}"
    ),
    "{name} is of RECORDINGs; simulated sessions have their own": (
        "{name} gehört zu RECORDINGs; simulierte Sitzungen haben ihre eigene"
    ),
    "{hazard} begins at {onset} s, and the session ends at {end} s: give a longer --duration, or @start": (
        "{hazard} beginnt bei {onset} s, und die Sitzung endet bei {end} s: längere --duration angeben, oder @start"
    ),
    "RECORDINGs need --calibration: only black boxes bring their own": (
        "RECORDINGs brauchen --calibration: nur Blackboxen bringen ihre eigene mit"
    ),
    # programs beside the service
    "is not a time span such as {example}": "ist keine Zeitspanne wie {example}",
    "is not a job name": "ist kein Name eines Jobs",
    "--unconfigured writes a file: give --write FILE": "--unconfigured schreibt eine Datei: --write DATEI angeben",
    "{value} is not a host name: give it alone, without https://, port and path": (
        "{value} ist kein Rechnername: ihn allein angeben, ohne https://, Port und Pfad"
    ),
    "--once prints and ends, and writes no --textfile. Leave one of them out": (
        "--once gibt aus und endet, und schreibt keine --textfile. Eines von beiden weglassen"
    ),
    "--no-http needs --textfile": "--no-http braucht --textfile",
    "must not be empty": "darf nicht leer sein",
    "may have letters, digits, - and _": "darf Buchstaben, Ziffern, - und _ haben",
    "a device name has 1 to {most} signs of ASCII": "ein Gerätename hat 1 bis {most} Zeichen aus ASCII",
    "{value} is taken: so are {names}": "{value} ist vergeben, wie {names}",
    "--image and --pose are both {value}: give each a name of its own": (
        "--image und --pose sind beide {value}: jedem einen eigenen Namen geben"
    ),
    "with --signed-by no questions are asked: give --probe and --preset, too": (
        "mit --signed-by wird nichts gefragt: auch --probe und --preset angeben"
    ),
}
_WORDS = {"day": "Tag", "week": "Woche", "month": "Monat", "poses": "Posen", "pictures": "Bilder"}
"""Words of this program that may fill a field."""
_TEXTS = FreeTexts(GERMAN_OF_USAGE, _WORDS)


def usage_text(message: str) -> str | None:
    """Returns the German of a refused command line; None where the table does not have the whole of it."""
    return _TEXTS.translated(" ".join(message.split()))
