"""Holds, like `texts`, the German of what `report` prints, of the pages of `report` and `trend`, and of a bad log."""

GERMAN_OF_REPORTS = {
    # what is printed
    "day": "Tag",
    "week": "Woche",
    "month": "Monat",
    "Report of the {kind} {name}, as asked for with --of": "Bericht, {kind} {name}, wie mit --of verlangt",
    "Report of the {kind} {name}, which is not over, as asked for with --of": (
        "Bericht, {kind} {name}, noch nicht zu Ende, wie mit --of verlangt"
    ),
    "Report of the last {kind} that is over, {name}, as no day was named with --of": (
        "Bericht, {kind} {name}, als Letztes zu Ende, da mit --of kein Tag genannt wurde"
    ),
    "The alarm log begins after it, on {since}: --of {since} reports that {kind}": (
        "Das Alarmprotokoll beginnt danach, am {since}: --of {since} zeigt es ({kind})"
    ),
    "written: {file}, signed {signature}": "geschrieben: {file}, Signatur {signature}",
    "the alarm log is damaged, as the top of the report says; see: probewatch log --verify": (
        "das Alarmprotokoll ist beschädigt, wie oben im Bericht steht; siehe: probewatch log --verify"
    ),
    "the store of references is damaged, as the top of the report says: {why}": (
        "der Speicher der Referenzen ist beschädigt, wie oben im Bericht steht: {why}"
    ),
    # headings
    "probewatch report": "probewatch-Bericht",
    "{name} so far": "{name} bisher",
    "Verification": "Bestätigung",
    "Alarms": "Alarme",
    "Calibrations": "Kalibrierungen",
    "Trend": "Verlauf",
    "Self-tests": "Selbsttests",
    "Software and limits": "Software und Grenzen",
    "The log itself": "Das Protokoll selbst",
    "Read by": "Gelesen von",
    "Name ____________________  Date ____________  Signature ____________________": (
        "Name ____________________  Datum ____________  Unterschrift ____________________"
    ),
    "{chosen}. From {start} until {until} UTC, by the alarm log of this cart; made {made} UTC. "
    "probewatch is not a certified medical device.": (
        "{chosen}. Von {start} bis {until} UTC, nach dem Alarmprotokoll dieses Wagens; erstellt {made} UTC. "
        "probewatch ist kein zugelassenes Medizinprodukt."
    ),
    # at the top
    "The alarm log is DAMAGED: entries are missing, were changed or put in; what follows may be false. {damages}. "
    "See: probewatch log --verify.": (
        "Das Alarmprotokoll ist BESCHÄDIGT: Einträge fehlen, wurden geändert oder eingefügt; was folgt, kann falsch "
        "sein. {damages}. Siehe: probewatch log --verify."
    ),
    "The chain of the alarm log was begun again {times} in this period.": (
        "Die Kette des Alarmprotokolls wurde in diesem Zeitraum {times} neu begonnen."
    ),
    "The store of references is DAMAGED, so what was in force is not known: {why}.": (
        "Der Speicher der Referenzen ist BESCHÄDIGT, was in Kraft war, ist also unbekannt: {why}."
    ),
    "The check of the calibration in force is OVERDUE: {overdue}.": (
        "Die Prüfung der Kalibrierung in Kraft ist ÜBERFÄLLIG: {overdue}."
    ),
    "Records of self-tests are not as they were kept: {faults}.": (
        "Aufzeichnungen von Selbsttests sind nicht, wie sie aufbewahrt wurden: {faults}."
    ),
    "The {kind} is not over: this is what happened so far.": "{kind} noch nicht zu Ende: dies geschah bisher.",
    "and {more} more": "und {more} weitere",
    "once": "einmal",
    "{number} times": "{number}-mal",
    # overload
    "This computer was overloaded {times}, for {long} in all.": (
        "Dieser Rechner war {times} überlastet, insgesamt {long} lang."
    ),
    "Each change of the state has its own entry all the same.": (
        "Dennoch hat jeder Wechsel des Zustands seinen eigenen Eintrag."
    ),
    "Meanwhile {changes}: times in each state and of each fault are known only in part.": (
        "Währenddessen {changes}: die Zeiten jedes Zustands und Fehlers sind nur zum Teil bekannt."
    ),
    "1 change of the state has no entry of its own": "hat 1 Wechsel des Zustands keinen eigenen Eintrag",
    "at least 1 change of the state has no entry of its own": (
        "hat mindestens 1 Wechsel des Zustands keinen eigenen Eintrag"
    ),
    "{number} changes of the state have no entry of their own": (
        "haben {number} Wechsel des Zustands keinen eigenen Eintrag"
    ),
    "at least {number} changes of the state have no entry of their own": (
        "haben mindestens {number} Wechsel des Zustands keinen eigenen Eintrag"
    ),
    "changes of the state may have no entry of their own": (
        "können Wechsel des Zustands ohne eigenen Eintrag geblieben sein"
    ),
    # verification
    "The service did not run: of this cart nothing was verified.": (
        "Der Dienst lief nicht: an diesem Wagen wurde nichts bestätigt."
    ),
    "The service ran for {long}; the calibration was verified in {share} of it.": (
        "Der Dienst lief {long}; davon war die Kalibrierung {share} der Zeit bestätigt."
    ),
    "Green: monitoring; blue: not verified; yellow: warning; red: halt, or a device or a part lost.": (
        "Grün: überwacht; blau: nicht bestätigt; gelb: Warnung; rot: Halt, oder ein Gerät oder ein Teil fehlt."
    ),
    "hour of the day, UTC": "Stunde des Tages, UTC",
    "day of the week, 1 is Monday": "Wochentag, 1 ist Montag",
    "day of the month": "Tag des Monats",
    "% verified": "% bestätigt",
    "{share} % verified": "{share} % bestätigt",
    "time in each state, hour by hour": "Zeit in jedem Zustand, Stunde für Stunde",
    "time in each state, day by day": "Zeit in jedem Zustand, Tag für Tag",
    "share of the time verified, hour by hour": "bestätigter Anteil der Zeit, Stunde für Stunde",
    "share of the time verified, day by day": "bestätigter Anteil der Zeit, Tag für Tag",
    "time": "Zeit",
    "of the time on": "der Laufzeit",
    # alarms
    "None.": "Keine.",
    "None, as the service did not run.": "Keine, da der Dienst nicht lief.",
    "And {more} more; probewatch log has them all.": "Und {more} weitere; probewatch log zeigt alle.",
    "fault": "Fehler",
    "alarms": "Alarme",
    "in all": "insgesamt",
    "begun, UTC": "Beginn, UTC",
    "lasted": "Dauer",
    "at the end": "am Ende",
    "faults": "Fehler",
    "reason at the end": "Grund am Ende",
    ", then ": ", dann ",
    "{long}, and went on": "{long}, und ging weiter",
    "People asked: {asked}.": "Verlangt wurde: {asked}.",
    "nothing": "nichts",
    "acknowledge": "quittieren",
    "pause-audio": "Ton pausieren",
    "audio-off": "Ton ausschalten",
    "audio-on": "Ton einschalten",
    "lamp-test": "Lampentest",
    "clear-bump": "Positionssensor nach Stoß geprüft",
    "propose-calibration": "Kalibrierung vorschlagen",
    "begin-recalibration": "Neukalibrierung beginnen",
    "end-recalibration": "Neukalibrierung beenden",
    "abort-recalibration": "Neukalibrierung abbrechen",
    "reload": "Konfiguration neu lesen",
    # calibrations
    "in force from, UTC": "in Kraft ab, UTC",
    "until, UTC": "bis, UTC",
    "verified by motion": "durch Bewegung bestätigt",
    "how": "Weg",
    "difference to the one before": "Unterschied zur vorigen",
    "still in force": "noch in Kraft",
    "never": "nie",
    "Not known, see the top of this report.": "Unbekannt, siehe oben im Bericht.",
    "None was in force.": "Keine war in Kraft.",
    "By the log, none took the place of another in this period.": (
        "Laut Protokoll löste in diesem Zeitraum keine eine andere ab."
    ),
    "When the calibration is to be checked again is not known.": (
        "Wann die Kalibrierung wieder zu prüfen ist, ist unbekannt."
    ),
    "No calibration is in force, so none is to be checked.": (
        "Keine Kalibrierung ist in Kraft, also ist keine zu prüfen."
    ),
    "The next check of the calibration in force is overdue: {overdue}.": (
        "Die nächste Prüfung der Kalibrierung in Kraft ist überfällig: {overdue}."
    ),
    "Next check of the calibration in force: {ends}.": "Nächste Prüfung der Kalibrierung in Kraft: {ends}.",
    "due": "fällig",
    "its {what} is {text}, no day such as {example}": "ihr {what} ist {text}, kein Tag wie {example}",
    "it came in force at {text}, which no calendar has": "sie kam in Kraft am {text}, den kein Kalender kennt",
    # trend
    "Trend under reference {number}": "Verlauf unter Referenz {number}",
    "The service has noted no estimates: it does so every five minutes while it is verified.": (
        "Der Dienst hat keine Schätzungen notiert: er tut es alle fünf Minuten, solange er bestätigt."
    ),
    "Of reference {number}, until the end of the period.": "Zu Referenz {number}, bis zum Ende des Zeitraums.",
    "Line: weighted mean. Band: its control limits. Dashed: the limit of the check.": (
        "Linie: gewichtetes Mittel. Band: seine Eingriffsgrenzen. Gestrichelt: die Grenze der Prüfung."
    ),
    "Now": "Jetzt",
    "Over days": "Über Tage",
    "days": "Tage",
    "weighted mean": "gewichtetes Mittel",
    "{parameter} over days": "{parameter} über Tage",
    "probewatch: trend": "probewatch: Verlauf",
    # self-tests
    "result": "Ergebnis",
    "red": "rot",
    "failed": "nicht bestanden",
    "{text}.json cannot be read": "{text}.json ist nicht lesbar",
    "{text}.json has no digest, though one before it has: it was put in or changed": (
        "{text}.json hat keine Prüfsumme, obwohl eine davor eine hat: sie wurde eingefügt oder geändert"
    ),
    "{text}.json was changed after it was kept": "{text}.json wurde nach dem Aufbewahren geändert",
    "{text}.json follows a record that is missing or was changed": (
        "{text}.json folgt auf eine Aufzeichnung, die fehlt oder geändert wurde"
    ),
    # software and limits
    "from, UTC": "ab, UTC",
    "version": "Version",
    "no {name}": "ohne {name}",
    "limits of an OK": "Grenzen eines OK",
    "not logged by that version": "von jener Version nicht notiert",
    "the service was not started": "der Dienst wurde nicht gestartet",
    "Started {times}.": "{times} gestartet.",
    "Not started in this period.": "In diesem Zeitraum nicht gestartet.",
    # the log itself, and what is wrong with it
    "The chain is NOT whole, see the top of this report.": "Die Kette ist NICHT heil, siehe oben im Bericht.",
    "A write that a loss of power tore, no damage: {torn}.": "Vom Stromausfall zerrissen, kein Schaden: {torn}.",
    "Nothing was logged in this period.": "In diesem Zeitraum wurde nichts notiert.",
    "The chain of the alarm log is whole.": "Die Kette des Alarmprotokolls ist heil.",
    "The chain of the alarm log is whole; it was begun again {times}.": (
        "Die Kette des Alarmprotokolls ist heil; sie wurde {times} neu begonnen."
    ),
    "entry {number} begins a new chain: {found}": "Eintrag {number} beginnt eine neue Kette: {found}",
    "the alarm log is damaged: {damage}; what it still holds is told. See: probewatch log --verify": (
        "das Alarmprotokoll ist beschädigt: {damage}; gezeigt ist, was es noch hat. Siehe: probewatch log --verify"
    ),
    "line {number}": "Zeile {number}",
    "is cut off": "ist abgeschnitten",
    "was cut off while it was written": "wurde beim Schreiben abgeschnitten",
    "cannot be read ({text})": "nicht lesbar ({text})",
    "is not an entry (it was changed)": "ist kein Eintrag (er wurde geändert)",
    "is not an entry (its time has no zone)": "ist kein Eintrag (seine Zeit hat keine Zone)",
    "is not an entry (it is not UTF-8 text)": "ist kein Eintrag (kein Text in UTF-8)",
    "is not an entry (it is not JSON, or a part of it is missing)": (
        "ist kein Eintrag (kein JSON, oder ein Teil davon fehlt)"
    ),
    "is not an entry (a field is missing or wrong: {text})": (
        "ist kein Eintrag (ein Feld fehlt oder ist falsch: {text})"
    ),
    "entry {number} follows entry {before}: entries are missing or were put in": (
        "Eintrag {number} folgt auf Eintrag {before}: Einträge fehlen oder wurden eingefügt"
    ),
    "entry {number} does not continue the chain": "Eintrag {number} setzt die Kette nicht fort",
    "entry {number}, which begins a chain, follows entry {before}: it was moved or copied": (
        "Eintrag {number}, der eine Kette beginnt, folgt auf Eintrag {before}: er wurde verschoben oder kopiert"
    ),
    "entry {number} began a chain after another entry than {before}: entries are missing": (
        "Eintrag {number} begann eine Kette nach einem anderen Eintrag als {before}: Einträge fehlen"
    ),
    "entry {number} stands where the segment's name promises entry {promised}": (
        "Eintrag {number} steht, wo der Name des Abschnitts Eintrag {promised} verspricht"
    ),
    "entry {number} begins a chain, but not a segment: it was moved or copied": (
        "Eintrag {number} beginnt eine Kette, aber keinen Abschnitt: er wurde verschoben oder kopiert"
    ),
    "entry {number} is not the one that had been written": "Eintrag {number} ist nicht der, der geschrieben wurde",
    "is missing, although there is a log": "fehlt, obwohl es ein Protokoll gibt",
    "cannot be believed ({text})": "ist nicht zu glauben ({text})",
    "the log ends with entry {number}, but {written} had been written": (
        "das Protokoll endet mit Eintrag {number}, aber {written} wurden geschrieben"
    ),
    "it ends with entry {number}, but the log with {last}": (
        "es endet mit Eintrag {number}, aber das Protokoll mit {last}"
    ),
    "the log begins with entry {number}, but {kept} had been kept": (
        "das Protokoll beginnt mit Eintrag {number}, aber ab {kept} wurde aufbewahrt"
    ),
    "reference {number} was in force, but no entry of the log names it: entries are missing": (
        "Referenz {number} war in Kraft, aber kein Eintrag des Protokolls nennt sie: Einträge fehlen"
    ),
    # what is wrong with the store of references
    "which calibration is in force is not known": "welche Kalibrierung in Kraft ist, ist unbekannt",
    "the history of references cannot be read ({text})": "die Geschichte der Referenzen ist nicht lesbar ({text})",
    "Check the disk and the permissions": "Festplatte und Rechte prüfen",
    "was changed: it is not the content of reference {number}": (
        "wurde geändert: es ist nicht der Inhalt von Referenz {number}"
    ),
    "the content of reference {number} is missing ({text})": "der Inhalt von Referenz {number} fehlt ({text})",
    "is missing, although references were kept": "fehlt, obwohl Referenzen aufbewahrt wurden",
    "is too large": "ist zu groß",
    "does not match its checksum": "passt nicht zu seiner Prüfsumme",
    "cannot be understood": "ist nicht zu verstehen",
    "the alarm log names reference {number}, SHA-256 {text}, which the store does not hold": (
        "das Alarmprotokoll nennt Referenz {number}, SHA-256 {text}, die der Speicher nicht hat"
    ),
    "Restore the folder from a copy, or start again with the configuration's file: probewatch calibration reset": (
        "Den Ordner aus einer Kopie wiederherstellen, oder mit der Datei der Konfiguration neu beginnen: "
        "probewatch calibration reset"
    ),
    "Restore the folder from a copy": "Den Ordner aus einer Kopie wiederherstellen",
}
