"""Holds the German texts on what is wrong in a configuration or a device's URL, and on what `configure` refuses."""

from probewatch.tools.german.free_texts import FreeTexts

GERMAN_OF_MISTAKES = {
    # keys
    "{key} is missing": "{key} fehlt",
    "{key} is not known. Did you mean {meant}?": "{key} ist nicht bekannt. Gemeint {meant}?",
    "{key} is not known, it belongs in {section}": "{key} ist hier nicht bekannt, es gehört in {section}",
    "{key} is not known, it belongs before the first section": (
        "{key} ist hier nicht bekannt, es gehört vor den ersten Abschnitt"
    ),
    "{key} is not known, it belongs in a section of its own": (
        "{key} ist hier nicht bekannt, es gehört in einen eigenen Abschnitt"
    ),
    "{key} is not known (known: {list})": "{key} ist nicht bekannt (bekannt: {list})",
    # values
    "{key} = {value}: {said}": "{key} = {value}: {said}",
    "{key}: {said}": "{key}: {said}",
    "must be a section, written {section}": "muss ein Abschnitt sein, geschrieben {section}",
    "must be a list of sections, each written {section}": (
        "muss eine Liste von Abschnitten sein, jeder geschrieben {section}"
    ),
    "must be a list, written [{first}, …]": "muss eine Liste sein, geschrieben [{first}, …]",
    "there is no such group. Make it: groupadd --system {group}": (
        "diese Gruppe gibt es nicht. Anlegen: groupadd --system {group}"
    ),
    "must be text in quotes": "muss ein Text in Anführungszeichen sein",
    "must be the name of a file in quotes": "muss der Name einer Datei in Anführungszeichen sein",
    "must be true or false": "muss true oder false sein",
    "input should be greater than or equal to {number}": "muss mindestens {number} sein",
    "input should be less than or equal to {number}": "darf höchstens {number} sein",
    "input should be greater than {number}": "muss größer als {number} sein",
    "input should be less than {number}": "muss kleiner als {number} sein",
    "input should be a valid number": "muss eine Zahl sein",
    "input should be a finite number": "muss eine endliche Zahl sein",
    "input should be a valid integer": "muss eine ganze Zahl sein",
    "input should be {meant}": "muss {meant} sein",
    "tuple should have at least {number} item after validation, not {other}": (
        "muss mindestens {number} Eintrag haben, nicht {other}"
    ),
    "tuple should have at most {number} items after validation, not {other}": (
        "darf höchstens {number} Einträge haben, nicht {other}"
    ),
    "two outputs share one contact, url = '{url}'. Give each its own channel or line": (
        "zwei Ausgänge teilen einen Kontakt, url = '{url}'. Jedem seinen Kanal oder seine Leitung geben"
    ),
    "{key} = {value} is on the serial port of {other} = {quoted}. Give each its own port": (
        "{key} = {value} liegt an der seriellen Schnittstelle von {other} = {quoted}. Jedem seine eigene geben"
    ),
    "no output has signal = 'contact'. Without one nobody hears of a fault; add it": (
        "kein Ausgang hat signal = 'contact'. Ohne ihn erfährt niemand von einem Fehler; ihn hinzufügen"
    ),
    "the path is longer than 100 bytes. Choose a shorter path, such as in /run": (
        "der Pfad ist länger als 100 Byte. Einen kürzeren wählen, etwa in /run"
    ),
    "a control character is in it, such as a NUL or a line break. Type it again": (
        "ein Steuerzeichen ist darin, wie NUL oder ein Zeilenumbruch. Neu eintippen"
    ),
    "{key} = {value} is longer than [supervisor] max_verification_age_s = {most}, which bounds them all. Raise that "
    "one, or shorten this": (
        "{key} = {value} ist länger als [supervisor] max_verification_age_s = {most}, das alle begrenzt. Jenes "
        "erhöhen, oder dies kürzen"
    ),
    "is the control socket. Choose another path": "ist der Steuersocket. Einen anderen Pfad wählen",
    "is the socket of the feed. Choose another path": "ist der Socket des Feeds. Einen anderen Pfad wählen",
    "[limits] named_nats is not set by hand. Learn it, probewatch noise, and name the file in [noise]": (
        "[limits] named_nats wird nicht von Hand gesetzt. Lernen (probewatch noise), und die Datei in [noise] nennen"
    ),
    # as in a refusal in one line, and in what the service has left behind
    "the service does not watch, since {utc}: {said}": "der Dienst überwacht nicht, seit {utc}: {said}",
    "{said}; then {command}": "{said}; dann {command}",
    "line {number}: {said}": "Zeile {number}: {said}",
    "{said}. {then}": "{said}. {then}",
    "{said}; {then}": "{said}; {then}",
}
"""Texts on a configuration file, one mistake each."""

GERMAN_OF_URLS = {
    "names no device": "nennt kein Gerät",
    "Write {scheme}: and then a path or an address": "{scheme}: schreiben, und dann einen Pfad oder eine Adresse",
    "{quoted} is not a known device kind": "{quoted} ist keine bekannte Art von Gerät",
    "does not say of which kind the device is": "sagt nicht, von welcher Art das Gerät ist",
    "{quoted} is {kind}, not {other}": "{quoted} ist {kind}, nicht {other}",
    "'={value}' names no option": "'={value}' nennt keine Option",
    "Write ?OPTION=VALUE&OPTION=VALUE": "?OPTION=WERT&OPTION=WERT schreiben",
    "option {quoted} has no value": "die Option {quoted} hat keinen Wert",
    "Write {name}=VALUE, or leave it out": "{name}=WERT schreiben, oder weglassen",
    "option {quoted} is given twice, as {one} and {other}": (
        "die Option {quoted} steht zweimal da, als {one} und {other}"
    ),
    "Write {name}= once": "{name}= einmal schreiben",
    "unknown option {quoted}": "die Option {quoted} gibt es nicht",
    "Did you mean {meant}? Use {list}": "Gemeint {meant}? Möglich: {list}",
    "Did you mean {meant}?": "Gemeint {meant}?",
    "Use one of {list}": "Möglich: {list}",
    "Use {list}": "Möglich: {list}",
    "Leave it out: this kind of device takes none": "Weglassen: diese Art von Gerät nimmt keine",
    "{option} is not known": "{option} ist nicht bekannt",
    "{option} cannot be used": "{option} ist nicht brauchbar",
    "Use a number from {number} to {other} {unit}": "Eine Zahl von {number} bis {other} {unit} angeben",
    "Use a number from {number} to {other}": "Eine Zahl von {number} bis {other} angeben",
    "Use a whole number from {number} to {other}": "Eine ganze Zahl von {number} bis {other} angeben",
    "{option} is not a line speed of these trackers": "{option} ist keine Geschwindigkeit dieser Tracker",
    "{option} is not a part of a picture": "{option} ist kein Teil eines Bildes",
    "Write crop=LEFT,TOP,WIDTH,HEIGHT in pixels, width and height at least {number}": (
        "crop=LINKS,OBEN,BREITE,HÖHE in Pixeln schreiben, Breite und Höhe mindestens {number}"
    ),
    "is not the path of a device": "ist nicht der Pfad eines Geräts",
    "Write {list}": "{list} schreiben",
    "{quoted} is not an address": "{quoted} ist keine Adresse",
    "Write host:port, such as {list}": "HOST:PORT schreiben, wie {list}",
    "names no line": "nennt keine Leitung",
    "Add ?line= and a number or a name, see `gpioinfo`": "?line= und Nummer oder Namen anhängen, siehe `gpioinfo`",
    "the tool definition cannot be read ({said})": "die Werkzeugdefinition ist nicht lesbar ({said})",
    "Name the .rom file that came with the tool": "Die .rom-Datei nennen, die mit dem Werkzeug kam",
    "No such file or directory": "keine solche Datei",
    "Permission denied": "keine Berechtigung",
    "Is a directory": "ein Ordner",
}
"""Texts on the URL of a device: what is wrong, and what to do."""

GERMAN_OF_CONFIGURING = {
    "Mend it; config/probewatch.toml shows every key": "Berichtigen; config/probewatch.toml zeigt jeden Schlüssel",
    "Mend that line; config/probewatch.toml shows every key": (
        "Die Zeile berichtigen; config/probewatch.toml zeigt jeden Schlüssel"
    ),
    "is not valid TOML: {text}": "ist kein gültiges TOML: {text}",
    "cannot be read ({said})": "nicht lesbar ({said})",
    "it is a folder, not a file": "es ist ein Ordner, keine Datei",
    "it is a device, not a file": "es ist ein Gerät, keine Datei",
    "it is a pipe (FIFO), not a file": "es ist eine Pipe (FIFO), keine Datei",
    "Name the cart's configuration, a TOML file": "Die Konfiguration des Wagens nennen, eine TOML-Datei",
    "Name the file in it": "Die Datei darin nennen",
    "Check the path's permissions": "Die Rechte des Pfads prüfen",
    "Correct its name, or write it: probewatch configure {file}": (
        "Den Namen berichtigen, oder sie schreiben: probewatch configure {file}"
    ),
    "{quoted} is not a lamp": "{quoted} ist keine Lampe",
    "has a layout that cannot be edited line by line": "ist so geschrieben, dass man sie nicht zeilenweise ändern kann",
    "Start over with --fresh, or change it in an editor": "Mit --fresh neu beginnen, oder in einem Editor ändern",
    "the service cannot see it: its unit is shown nothing of {file}. Copy it to /etc/probewatch, and name it there": (
        "der Dienst sieht sie nicht: seine Unit bekommt nichts von {file} zu sehen. Sie nach /etc/probewatch kopieren, "
        "und dort nennen"
    ),
    "{file} is a path from this folder, and the service starts in another": (
        "{file} ist ein Pfad von diesem Ordner aus, und der Dienst startet in einem anderen"
    ),
    "nothing was written": "nichts wurde geschrieben",
    "Name another file, or give --no-calibration": "Eine andere Datei nennen, oder --no-calibration angeben",
    "Change your answers, or start over with --fresh": "Die Antworten ändern, oder mit --fresh neu beginnen",
    "is invalid and was not changed": "ist ungültig und wurde nicht geändert",
    "Correct it in an editor (see: probewatch check), or start over with --fresh": (
        "In einem Editor berichtigen (siehe: probewatch check), oder mit --fresh neu beginnen"
    ),
    "was changed by another program meanwhile": "wurde inzwischen von einem anderen Programm geändert",
    "Run the command again": "Den Befehl noch einmal ausführen",
    "may not be read": "darf nicht gelesen werden",
    "Put sudo before the command, or name another file": "sudo vor den Befehl setzen, oder eine andere Datei nennen",
    "is the name of {kind}, and what is written there is a configuration, TOML": (
        "ist der Name von {kind}, geschrieben wird dort eine Konfiguration, TOML"
    ),
    "Name it {file}": "Sie {file} nennen",
    "is not HOST:PORT": "ist nicht HOST:PORT",
    "Such as {list}": "Wie {list}",
}
"""Texts of `configure` and `check`, and on addresses that other commands are given: what is wrong, and what to do."""

_WORDS = {
    "a tracker": "ein Tracker",
    "a video source": "eine Videoquelle",
    "an alarm output": "ein Alarmausgang",
}
_LIST = r"\S+(?:(?:, | or )\S+)*"
_QUOTED = r"'[^']*'"
_SHAPES = {
    "key": rf"(?:\[[^\]]+\]|{_QUOTED})(?: entry \d+| [\w.-]+)*",
    "list": _LIST,
    "meant": rf"{_QUOTED}(?:(?:, | or ){_QUOTED})*",
    "number": r"[-+]?[\d.]\S*",
    "option": r"\w+=\S*",
    "quoted": _QUOTED,
    "section": r"\[\[?[\w.]+\]?\]",
    "command": "(?:sudo )?(?:probewatch|systemctl) .+",
    "utc": r"[-\d:T+]+",
    "kind": "|".join(_WORDS) + "|[A-Z]+",
    "file": r"\S+",
    "name": r"\w+",
}
"""Field that does not stand for a text → what it may be. An error with a word of another kind stays English, as half of
it would be English otherwise."""

_TEXTS = FreeTexts({**GERMAN_OF_MISTAKES, **GERMAN_OF_URLS, **GERMAN_OF_CONFIGURING}, _WORDS, _SHAPES)


def refusal_text(text: str) -> str | None:
    """Returns the German of a mistake, or of one of the two texts of a refusal; None where not all of it has one."""
    return _TEXTS.translated(text)
