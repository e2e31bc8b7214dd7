"""Holds the German of what is refused, and of why a device is lost: what is wrong and what to do, each a text of its
own.

Both texts of an error are given in German or neither; words of a device or of the system that are not here stay as they
are.
"""

_FREE = "Das andere Programm beenden, dann noch einmal versuchen"
_LISTED = "`probewatch devices` zeigt, was da ist"
_NAMES = "Namen und Rechte prüfen"

GERMAN_OF_ERRORS = {
    # the system
    "no such file or directory": "keine solche Datei",
    "No such file or directory": "keine solche Datei",
    "connection refused": "Verbindung abgelehnt",
    "Permission denied": "keine Berechtigung",
    # serial ports and the network
    "no such serial port": "keine solche serielle Schnittstelle",
    "is no serial port": "ist keine serielle Schnittstelle",
    "is no GPIO chip": "ist kein GPIO-Chip",
    "Correct the path: `probewatch devices` lists what is connected": (
        "Den Pfad berichtigen: `probewatch devices` nennt, was angeschlossen ist"
    ),
    "Plug the cable in, or correct the path in the configuration": (
        "Das Kabel einstecken, oder den Pfad in der Konfiguration berichtigen"
    ),
    "the serial port is in use by another program": "ein anderes Programm benutzt die serielle Schnittstelle",
    "Close that program, then try again": _FREE,
    "no permission to open the serial port": "keine Berechtigung für die serielle Schnittstelle",
    "Add this user to the group 'dialout' (sudo usermod -aG dialout $USER), then log in again": (
        "Diesen Benutzer in die Gruppe 'dialout' aufnehmen (sudo usermod -aG dialout $USER), dann neu anmelden"
    ),
    "nothing listens there (connection refused)": "dort antwortet niemand (Verbindung abgelehnt)",
    "Check that the device's server is running and that the port is right": (
        "Prüfen, ob der Server des Geräts läuft und der Port stimmt"
    ),
    "nobody answers": "niemand antwortet",
    "Check the network cable, the address and the firewall": "Netzkabel, Adresse und Firewall prüfen",
    "the name is unknown": "der Name ist unbekannt",
    "Write the device's IP address in place of its name": "Statt des Namens die IP-Adresse des Geräts schreiben",
    # trackers
    "the tracker does not answer at any line speed": "der Tracker antwortet bei keiner Geschwindigkeit",
    "the tracker accepts connections but does not answer": "der Tracker nimmt Verbindungen an, antwortet aber nicht",
    "Check that it is switched on and that the cable sits at both ends": (
        "Prüfen, ob er eingeschaltet ist und das Kabel an beiden Enden steckt"
    ),
    # pictures
    "no such video device": "kein solches Videogerät",
    "Check the grabber's plug": "Den Stecker des Framegrabbers prüfen",
    "Check the grabber's plug, or correct the path; `probewatch devices` lists what is there": (
        f"Den Stecker des Framegrabbers prüfen, oder den Pfad berichtigen; {_LISTED}"
    ),
    "the video device is in use by another program": "ein anderes Programm benutzt das Videogerät",
    "the video device was unplugged": "das Videogerät wurde abgezogen",
    "no signal at the video input": "kein Signal am Videoeingang",
    "Check the cable from the scanner and that it is switched on": (
        "Das Kabel vom Ultraschallgerät prüfen, und ob es eingeschaltet ist"
    ),
    "the video signal is not steady": "das Videosignal ist unruhig",
    "Check the cable from the scanner": "Das Kabel vom Ultraschallgerät prüfen",
    "no video ({said})": "kein Video ({said})",
    "Check that the simulated scanner is running": "Prüfen, ob das simulierte Ultraschallgerät läuft",
    # devices that `probe` and `configure` try
    "nothing to use came within {seconds} s": "innerhalb von {seconds} s kam nichts Brauchbares",
    "nothing came within {seconds} s": "innerhalb von {seconds} s kam nichts",
    "Check that the device is on and measuring": "Prüfen, ob das Gerät an ist und misst",
    "probing an output moves its contact": "ein Ausgang wird geprüft, indem sein Kontakt schaltet",
    "probing an output sounds its tone": "ein Ausgang wird geprüft, indem sein Ton klingt",
    "Add --click while the contact is not in use": "--click angeben, während der Kontakt nicht benutzt wird",
    "Add --click while the tone is not in use": "--click angeben, während der Ton nicht benutzt wird",
    "the contact was commanded energised, but reads back open": (
        "der Kontakt sollte anziehen, meldet sich aber als offen"
    ),
    "the contact was commanded released, but reads back closed": (
        "der Kontakt sollte abfallen, meldet sich aber als geschlossen"
    ),
    "Check the wiring of the contact and of what reads it back": (
        "Die Verdrahtung des Kontakts und seiner Rückmeldung prüfen"
    ),
    # outputs
    "the relay board does not answer": "die Relaiskarte antwortet nicht",
    "Check the relay board's cable": "Das Kabel der Relaiskarte prüfen",
    # files and the service
    "cannot be read: {said}": "nicht lesbar: {said}",
    "cannot be read ({said})": "nicht lesbar ({said})",
    "it is a folder, not a file": "es ist ein Ordner, keine Datei",
    "cannot be written: {said}": "nicht schreibbar: {said}",
    "is not what probewatch noise writes": "ist nicht das, was probewatch noise schreibt",
    "Learn it again: probewatch noise": "Neu lernen: probewatch noise",
    "proposes nothing: no parameter is shown to be wrong": (
        "schlägt nichts vor: kein Parameter ist als falsch gezeigt"
    ),
    "Move the probe over tissue until the fault is shown by motion": (
        "Die Sonde über Gewebe bewegen, bis Bewegung den Fehler zeigt"
    ),
    "Check the name and the permissions": _NAMES,
    "Check the path and its permissions": _NAMES,
    "Check its name and its folder": "Namen und Ordner prüfen",
    "exists already": "gibt es schon",
    "Give another name, or move it away": "Einen anderen Namen angeben, oder sie wegräumen",
    "no recorder answers ({said})": "kein Rekorder antwortet ({said})",
    "Start it: probewatch record --config {text}": "Ihn starten: probewatch record --config {text}",
    "Check name and permissions. Give a .toml or a PLUS .xml file": (
        f"{_NAMES}. Eine .toml oder eine .xml von PLUS angeben"
    ),
    "cannot be written: there is no folder {text}": "nicht schreibbar: es gibt keinen Ordner {text}",
    "Name a file in a folder that exists and may be written to": (
        "Eine Datei in einem Ordner nennen, den es gibt und der beschreibbar ist"
    ),
    "lies in the folder of the log itself": "liegt im Ordner des Protokolls selbst",
    "Write it to another folder": "In einen anderen Ordner schreiben",
    "no service answers ({said})": "kein Dienst antwortet ({said})",
    "Start it: systemctl start probewatch; if it ends again, journalctl -u probewatch says why": (
        "Ihn starten: systemctl start probewatch; endet er wieder, sagt journalctl -u probewatch, warum"
    ),
    "Start it: probewatch run --config FILE, with the FILE whose [control] socket this is": (
        "Ihn starten: probewatch run --config DATEI; in der DATEI steht dieser Socket unter [control]"
    ),
    "Start it: probewatch run --config {text}": "Ihn starten: probewatch run --config {text}",
    "is not a reference of this service, there is none yet": "gibt es bei diesem Dienst nicht, er hat noch keine",
    "is not a reference of this service, there is only number 1": "gibt es bei diesem Dienst nicht, nur Nummer 1",
    "is not a reference of this service, there are 1 to {number}": (
        "gibt es bei diesem Dienst nicht, nur 1 bis {number}"
    ),
    "See: probewatch calibration list": "Siehe: probewatch calibration list",
    "is no file": "ist keine Datei",
    "To go back to reference {number}: probewatch calibration back {times}": (
        "Zurück zu Referenz {number}: probewatch calibration back {times}"
    ),
    "needs an operator to lay the probe down and then to move it, and there is no terminal": (
        "jemand muss die Sonde ablegen und dann bewegen, und es gibt kein Terminal"
    ),
    "Run it at a terminal, or give --yes and --lamps seen, not-seen or skip": (
        "In einem Terminal ausführen, oder --yes und --lamps seen, not-seen oder skip angeben"
    ),
}
