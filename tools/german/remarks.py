"""Holds the German of what drivers report of their devices. Names, numbers and alerts of a device itself stay."""

GERMAN_OF_REMARKS = {
    # models and tools
    "OpenIGTLink server": "OpenIGTLink-Server",
    "OpenIGTLink, picture '{name}'": "OpenIGTLink, Bild '{name}'",
    "NDI tracker": "NDI-Tracker",
    "Optotrak, by the RTC3D server of First Principles": "Optotrak, über den RTC3D-Server von First Principles",
    "LCUS-type relay board, contact {number}": "Relaiskarte nach Art der LCUS, Kontakt {number}",
    "tone of {hz} Hz through aplay": "Ton von {hz} Hz über aplay",
    "control line {name} of a serial port": "Steuerleitung {name} einer seriellen Schnittstelle",
    "{name}, answers {kind}": "{name}, antwortet mit {kind}",
    "rigid body {number} (reference)": "Starrkörper {number} (Referenz)",
    "rigid body {number} (second on the probe)": "Starrkörper {number} (zweiter an der Sonde)",
    "rigid body {number}": "Starrkörper {number}",
    "{name} (reference)": "{name} (Referenz)",
    "{name} (second on the probe)": "{name} (zweiter an der Sonde)",
    "{name}: {status}, markers within {far} mm of the definition, marker {marker} LOOSE by {loose} mm": (
        "{name}: {status}, Marker auf {far} mm bei der Definition, Marker {marker} LOSE um {loose} mm"
    ),
    "{name}: {status}, markers within {far} mm of the definition, BENT": (
        "{name}: {status}, Marker auf {far} mm bei der Definition, VERBOGEN"
    ),
    "{name}: {status}, markers within {far} mm of the definition": (
        "{name}: {status}, Marker auf {far} mm bei der Definition"
    ),
    # poses
    "{number} poses had no time: they are stamped at their arrival": (
        "{number} Posen hatten keine Zeit: sie sind mit ihrer Ankunft gestempelt"
    ),
    "{number} damaged messages were refused": "{number} beschädigte Nachrichten wurden abgewiesen",
    "{number} damaged packets were refused": "{number} beschädigte Pakete wurden abgewiesen",
    "damaged replies refused: {number}; where they go on, see cable and plugs": (
        "beschädigte Antworten abgelehnt: {number}; halten sie an, Kabel und Stecker ansehen"
    ),
    "poses read a second time, after a leap or a gap, and then used: {number}; this is no fault": (
        "Posen nach einem Sprung oder einer Lücke ein zweites Mal gelesen und dann verwendet: {number}; das ist kein "
        "Fehler"
    ),
    "{number} times the server's clock jumped, or its messages came later from then on": (
        "{number}-mal sprang die Uhr des Servers, oder seine Nachrichten kamen von da an später"
    ),
    "the second marker body ({name}) was not seen {said}: whether either has moved is not watched": (
        "der zweite Markerkörper ({name}) wurde {said} gesehen: ob sich einer bewegt hat, wird nicht überwacht"
    ),
    "yet": "noch nicht",
    "for {time} s": "seit {time} s nicht",
    "the tracker or the reference tool was moved, by {far} mm and {turn}°: the tracker, which does no harm, unless "
    "rotation or offset is named": (
        "der Tracker oder das Referenzwerkzeug wurde bewegt, um {far} mm und {turn}°: der Tracker, was nicht schadet, "
        "wenn weder Rotation noch Versatz genannt wird"
    ),
    "marker details: {reason}": "Angaben zu den Markern: {reason}",
    "the tool on {plug} does not say what it is; name its definition with FILE.rom@PLUG": (
        "das Werkzeug an {plug} sagt nicht, was es ist; seine Definition mit DATEI.rom@STECKER nennen"
    ),
    # pictures
    "{number} pictures had no time: they are stamped at their arrival": (
        "{number} Bilder hatten keine Zeit: sie sind mit ihrer Ankunft gestempelt"
    ),
    "{number} damaged pictures were refused": "{number} beschädigte Bilder wurden abgewiesen",
    "{number} pictures had the time of the one before and were dropped: each needs its own": (
        "{number} Bilder hatten die Zeit des Bildes davor und wurden verworfen: jedes braucht seine eigene"
    ),
    "a file: it plays at its own rate": "eine Datei: sie läuft mit ihrer eigenen Rate",
    "stamped at arrival, to ± {error} ms by error_ms=": "bei der Ankunft gestempelt, auf ± {error} ms laut error_ms=",
    "sends {size} pixels as {code}": "sendet {size} Pixel als {code}",
    "{number} pictures were lost before they reached this host's memory": (
        "{number} Bilder gingen verloren, bevor sie im Speicher dieses Rechners waren"
    ),
    "{number} damaged pictures were dropped": "{number} beschädigte Bilder wurden verworfen",
    "{number} pictures without a time of this host, stamped at their arrival": (
        "{number} Bilder ohne eine Zeit dieses Rechners, mit ihrer Ankunft gestempelt"
    ),
    "{number} pictures stamped later than they arrived": "{number} Bilder später gestempelt, als sie ankamen",
    "it does not report its rate, {hz} per second is taken for the time bound": (
        "es meldet seine Rate nicht, für die Schranke der Zeit gilt {hz} je Sekunde"
    ),
    "its rate cannot be chosen": "seine Rate ist nicht wählbar",
    "{asked} pictures per second were asked for, it gives {hz}": "{asked} Bilder je Sekunde verlangt, es gibt {hz}",
    "{code} comes {hz} times a second by the word of the device. {said}": (
        "{code} kommt nach Angabe des Geräts {hz}-mal in der Sekunde. {said}"
    ),
    "{meant} may come more often, or a smaller size=": "{meant} kommt vielleicht öfter, oder ein kleineres size=",
    "A smaller size= may come more often": "Ein kleineres size= kommt vielleicht öfter",
    # outputs
    "it reports its contacts": "sie meldet ihre Kontakte",
    "it does not report its contacts": "sie meldet ihre Kontakte nicht",
    "a square wave for a watchdog relay": "ein Rechtecksignal für ein Watchdog-Relais",
    "a steady level": "ein fester Pegel",
    "the line's own level is read back": "der Pegel der Leitung selbst wird zurückgelesen",
    "the contact is read on {line}": "der Kontakt wird an {line} gelesen",
    "the contact is not read back": "der Kontakt wird nicht zurückgelesen",
    "it falls silent with the service": "er verstummt mit dem Dienst",
    # why nothing came, and what to do
    "{said} came; the server sends {kinds}": "{said} kam; der Server sendet {kinds}",
    "{said} could be read: {reason}": "{said} war lesbar: {reason}",
    "no transform '{name}'": "keine Transformation '{name}'",
    "no IMAGE '{name}'": "kein IMAGE '{name}'",
    "no IMAGE": "kein IMAGE",
    "Name one that it sends by probe= in the URL; where the name is right, bring the tool into view": (
        "Eine, die er sendet, mit probe= in der URL nennen; stimmt der Name, das Werkzeug ins Sichtfeld bringen"
    ),
    "Have the server send the tool's pose as TRANSFORM (PLUS: TransformNames); where it does, bring the tool into "
    "view": (
        "Der Server muss die Pose des Werkzeugs als TRANSFORM senden (PLUS: TransformNames); tut er es, das Werkzeug "
        "ins Sichtfeld bringen"
    ),
    "Name one of its IMAGEs by image= in the URL": "Eines seiner IMAGEs mit image= in der URL nennen",
    "Have the server send its pictures as IMAGE, which is the only kind that is read": (
        "Der Server muss seine Bilder als IMAGE senden; nur diese Art wird gelesen"
    ),
    "Have the sender follow the protocol: content, lengths, and the CRC-64 (ECMA-182) of each body": (
        "Der Sender muss das Protokoll einhalten: Inhalt, Längen und die CRC-64 (ECMA-182) jedes Rumpfes"
    ),
    "Have the server stamp what it sends: messages came without a time": (
        "Der Server muss stempeln, was er sendet: Nachrichten kamen ohne Zeit"
    ),
    "Keep the server's clock from being set while it sends: it jumped": (
        "Die Uhr des Servers darf nicht gestellt werden, während er sendet: sie sprang"
    ),
}
