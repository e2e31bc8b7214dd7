"""Holds the German of what `reload`, `self-test`, `trend`, `calibration` and `recalibrate` print: one table, from the
English text or its template.
"""

GERMAN_OF_TOOLS = {
    "the service has taken its configuration": "der Dienst hat seine Konfiguration übernommen",
    "written: {file}": "geschrieben: {file}",
    # self-test: what is asked
    "Lay the probe down in view of the tracker, and leave it; then Enter": (
        "Die Sonde im Sichtfeld des Trackers ablegen und liegen lassen; dann Enter"
    ),
    "Now move the probe over tissue or a phantom; then Enter": (
        "Jetzt die Sonde über Gewebe oder ein Phantom bewegen; dann Enter"
    ),
    "at rest": "in Ruhe",
    "moving": "in Bewegung",
    "For {seconds} s every lamp is lit and the tone sounds. All seen and heard?": (
        "{seconds} s lang leuchtet jede Lampe und der Ton klingt. Alles gesehen und gehört?"
    ),
    "All green.": "Alles grün.",
    "{bad} of {number} are not green.": "{bad} von {number} sind nicht grün.",
    "kept: {file}": "aufbewahrt: {file}",
    "no result was stored": "kein Ergebnis wurde gespeichert",
    # self-test: its items
    "service": "Dienst",
    "latched alarm": "gehaltene Alarme",
    "estimator restarts": "Neustarts des Prüfprozesses",
    "video": "Video",
    "tracker": "Tracker",
    "output": "Ausgang",
    "feed": "Feed",
    "video rate": "Bilder je Sekunde",
    "video losses": "verlorene Bilder",
    "video stamps": "Zeiten der Bilder",
    "video regularity": "Gleichmaß der Bilder",
    "tracker rate": "Posen je Sekunde",
    "tracker losses": "verlorene Posen",
    "tracker stamps": "Zeiten der Posen",
    "tracker regularity": "Gleichmaß der Posen",
    "noise at rest": "Rauschen in Ruhe",
    "overlay mask": "Maske der Einblendungen",
    "lamps and tone": "Lampen und Ton",
    "alarm log": "Alarmprotokoll",
    "disk": "Festplatte",
    "clock": "Uhr",
    "reference": "Referenz",
    "reference in time": "Referenz rechtzeitig",
    "reference due": "Prüftermin",
    "configured calibration": "konfigurierte Kalibrierung",
    "first use": "erste Nutzung",
    "kept": "Aufbewahrung",
    # self-test: what was found
    "not known, as its device is lost": "unbekannt, da sein Gerät fehlt",
    "within its limit": "innerhalb der Grenze",
    "was beyond its limit, and is within it again": "war jenseits der Grenze und ist wieder innerhalb",
    "{value} {unit}, limit {limit}": "{value} {unit}, Grenze {limit}",
    "{value}, limit {limit}": "{value}, Grenze {limit}",
    "not known {unit}, limit {limit}": "unbekannt, Grenze {limit} {unit}",
    "{said}, version {version}": "{said}, Version {version}",
    "none": "keine",
    "{said}, acknowledged": "{said}, quittiert",
    "{said}, not acknowledged": "{said}, nicht quittiert",
    "is written": "wird geschrieben",
    "not known": "nicht bekannt",
    "{size} GB free": "{size} GB frei",
    "{utc}, synchronised": "{utc}, synchronisiert",
    "{utc}, free-running": "{utc}, nicht synchronisiert",
    "{utc}, not known whether synchronised": "{utc}, ob synchronisiert, ist unbekannt",
    "number {number} of {utc}": "Nummer {number} vom {utc}",
    "it has expired since {day} {time} UTC": "sie ist abgelaufen seit {day} {time} UTC",
    "it is due since {day} {time} UTC": "sie ist fällig seit {day} {time} UTC",
    "the clock says {day}, before it came in force on {since}: set the clock": (
        "die Uhr sagt {day}, vor dem Tag ihres Inkrafttretens {since}: die Uhr stellen"
    ),
    "no date asked for ([calibration] due_days)": "kein Termin verlangt ([calibration] due_days)",
    "is in force": "ist in Kraft",
    "{number} samples came": "{number} Werte kamen",
    "{rate} / s, {least} / s at least": "{rate} / s, mindestens {least} / s",
    "{lost} %, at most {most} %": "{lost} %, höchstens {most} %",
    "no pose came": "keine Pose kam",
    "± {bound} ms, at most {most} ms": "± {bound} ms, höchstens {most} ms",
    "scatter {scatter} ms, at most {most} ms": "Streuung {scatter} ms, höchstens {most} ms",
    "longest pause {pause} ms, at most {most} ms": "längste Pause {pause} ms, höchstens {most} ms",
    "{seen} of {poses} poses saw the probe": "{seen} von {poses} Posen sahen die Sonde",
    "the probe moved by {moved} mm and {turned}": "die Sonde hat sich um {moved} mm und {turned} bewegt",
    "{noise} mm, {turn} (standard deviation, worst axis), at most {most} mm, {most_turn}": (
        "{noise} mm, {turn} (Standardabweichung, schlechteste Achse), höchstens {most} mm, {most_turn}"
    ),
    "not learnt: the picture has hardly changed": "nicht gelernt: das Bild hat sich kaum geändert",
    "{share} % of the picture is drawn or dark": "{share} % des Bildes sind Einblendung oder dunkel",
    "this cart has none, only the contact": "dieser Wagen hat keine, nur den Kontakt",
    "{text}: no operator confirmed them": "{text}: niemand hat sie bestätigt",
    "{text}: seen and heard by the operator": "{text}: gesehen und gehört",
    "{text}: not all seen or heard": "{text}: nicht alles gesehen oder gehört",
    "first use {value} {unit}": "erste Nutzung {value} {unit}",
    "compared with the self-test of {utc}, software {version}": (
        "verglichen mit dem Selbsttest vom {utc}, Software {version}"
    ),
    "this self-test is kept to compare later ones with": "dieser Selbsttest bleibt zum Vergleich mit späteren",
    "not kept to compare with: not all is green": "bleibt nicht zum Vergleich: nicht alles ist grün",
    # self-test: what to do
    "Mend it, or its cable": "Das Gerät oder sein Kabel instand setzen",
    "Mend that first, and repeat": "Erst das beheben, dann wiederholen",
    "See probewatch status": "Siehe probewatch status",
    "Wait some seconds, and test again": "Einige Sekunden warten und erneut testen",
    "Mend the cause; acknowledge": "Ursache beheben; quittieren",
    "probewatch log, journalctl -u probewatch": "Siehe probewatch log, journalctl -u probewatch",
    "Check the disk": "Die Festplatte prüfen",
    "Make room on the disk of the alarm log": "Auf der Festplatte des Alarmprotokolls Platz schaffen",
    "Set the clock: the log's dates are wrong": "Die Uhr stellen: die Daten im Protokoll sind falsch",
    "Calibrate: docs/first-calibration.md": "Kalibrieren: docs/first-calibration.md",
    "Move the probe over tissue until it is verified": "Sonde über Gewebe bewegen, bis sie bestätigt ist",
    "Recalibrate; where the clock is wrong, set it": "Neu kalibrieren; wo die Uhr falsch geht, sie stellen",
    "probewatch calibration": "Siehe probewatch calibration",
    "See that it runs and is connected": "Sehen, dass es läuft und angeschlossen ist",
    "Raise the device's rate": "Die Rate des Geräts erhöhen",
    "Check its cable, and what else runs": "Sein Kabel prüfen, und was sonst noch läuft",
    "Bring the probe into view, and repeat": "Die Sonde ins Sichtfeld bringen und wiederholen",
    "probewatch probe URL": "Siehe probewatch probe URL",
    "Lay the probe still in view of the tracker, and repeat": (
        "Die Sonde ruhig im Sichtfeld des Trackers ablegen und wiederholen"
    ),
    "Lay it down, do not hold it, and repeat": "Sie ablegen, nicht halten, und wiederholen",
    "Clean the markers; bring the probe nearer to the middle of the tracker's volume": (
        "Die Marker reinigen; die Sonde näher zur Mitte des Messvolumens bringen"
    ),
    "Move the probe over tissue while it is asked for, and repeat": (
        "Die Sonde über Gewebe bewegen, während es verlangt wird, und wiederholen"
    ),
    "Look at the picture: is it the scanner's, whole, and live?": (
        "Das Bild ansehen: ist es das des Ultraschallgeräts, ganz und live?"
    ),
    "Check lamps, tone and cables": "Lampen, Ton und Kabel prüfen",
    "probewatch status says why there is none: feed": "probewatch status sagt, warum es keinen gibt: feed",
    "Name a --folder that you may write to, or be in its group": (
        "Mit --folder einen beschreibbaren Ordner nennen, oder in dessen Gruppe sein"
    ),
    "Set the device as it was, or keep this one as first use: --baseline": (
        "Das Gerät wie damals einstellen, oder diesen als erste Nutzung behalten: --baseline"
    ),
    "Mend what is not green, and repeat": "Beheben, was nicht grün ist, und wiederholen",
    # calibration: list, show
    "no.": "Nr.",
    "since, UTC": "seit, UTC",
    "since": "seit",
    "origin": "Herkunft",
    "verified": "bestätigt",
    "no": "nein",
    "in force": "in Kraft",
    "not yet": "noch nicht",
    "pictures": "Bilder",
    "asked by": "verlangt von",
    "difference": "Unterschied",
    "from the one before": "zur vorigen",
    "must show": "muss zeigen",
    "made by": "gemacht von",
    "not stated": "nicht genannt",
    "signed by": "Unterschrift",
    "nobody": "niemand",
    "next check": "Prüftermin",
    "expires": "läuft ab",
    "no date is set": "kein Termin gesetzt",
    "scales": "Maßstäbe",
    "offset": "Versatz",
    "the contact stays open": "der Kontakt bleibt offen",
    "no check at another point was made: {text}": "an keinem anderen Punkt wurde geprüft: {text}",
    "{said} is {text}: that is a placeholder, not a person": "{said}: {text} ist ein Platzhalter, keine Person",
    "who made it": "wer sie gemacht hat",
    "who signed it": "wer sie unterschrieben hat",
    "the signer's role": "Funktion der zweiten Person",
    "it is not signed": "sie ist nicht unterschrieben",
    "it is signed by who made it, not by a second person": (
        "sie ist von dem unterschrieben, der sie gemacht hat, nicht von einer zweiten Person"
    ),
    "it says that it was {said} on {day} {time} UTC, which lies in the future": (
        "sie ist laut Datei {said} am {day} {time} UTC, und das liegt in der Zukunft"
    ),
    "made": "gemacht",
    "signed": "unterschrieben",
    "it was signed on {signed}, before it was made on {made}": (
        "sie wurde unterschrieben am {signed}, bevor sie gemacht wurde am {made}"
    ),
    "its {what} is {text}, no time such as {example}": "ihr {what} ist {text}, keine Zeit wie {example}",
    # calibration: diff
    "rotation": "Drehung",
    "picture size": "Bildgröße",
    "the same": "gleich",
    "differs": "verschieden",
    "{one} and {other} px": "{one} und {other} px",
    "of the cart": "dieses Wagens",
    "that probewatch ships with; --config names a cart's": (
        "wie probewatch sie mitbringt; --config nennt die eines Wagens"
    ),
    "{file} states no picture size: {width} × {height} px, that of the other, is supposed, and the offset depends on "
    "it. probewatch calibration import with --image-size makes a file that states it": (
        "{file} nennt keine Bildgröße: {width} × {height} px, die der anderen, ist angenommen, und der Offset hängt "
        "davon ab. probewatch calibration import mit --image-size macht eine Datei, die sie nennt"
    ),
    "beyond the limits of the checks {whose}: a person must accept it before a service uses it": (
        "jenseits der Grenzen der Prüfungen {whose}: eine Person muss das annehmen, bevor ein Dienst sie verwendet"
    ),
    # calibration: measured
    "parameter": "Größe",
    "by motion": "durch Bewegung",
    "calibrated to": "kalibriert auf",
    "apart": "Abstand",
    "estimates": "Schätzungen",
    "examinations": "Untersuchungen",
    "{sigmas} sigmas": "{sigmas} Sigma",
    "no estimate of reference {number} yet: the service notes one in five minutes while verified": (
        "noch keine Schätzung zu Referenz {number}: der Dienst notiert alle fünf Minuten eine, solange er bestätigt"
    ),
    # calibration: use, back, reset; recalibrate
    "against the reference in force: {text}": "gegen die Referenz in Kraft: {text}",
    "Accept that? Nothing of it is verified then.": "Das annehmen? Nichts davon ist dann bestätigt.",
    "there is no calibration, as before": "es gibt keine Kalibrierung, wie zuvor",
    "reference {number} is in force, as before; the contact closes once motion has verified it": (
        "Referenz {number} ist in Kraft, wie zuvor; der Kontakt schließt, sobald Bewegung sie bestätigt hat"
    ),
    "no service was notified": "kein Dienst wurde benachrichtigt",
    "whether the reference was changed is not known ({why}); see: probewatch calibration list": (
        "ob die Referenz geändert wurde, ist unbekannt ({why}); siehe: probewatch calibration list"
    ),
    "nothing was changed": "nichts wurde geändert",
    "nothing was changed, there is no calibration, as before": (
        "nichts wurde geändert, es gibt keine Kalibrierung, wie zuvor"
    ),
    "nothing was changed, reference {number} is in force, as before": (
        "nichts wurde geändert, Referenz {number} ist in Kraft, wie zuvor"
    ),
    "the calibration before is in force again, as reference {number}; motion has to verify it": (
        "die Kalibrierung davor ist wieder in Kraft, als Referenz {number}; Bewegung muss sie bestätigen"
    ),
    "reference {number} was taken, and the contact stays open until motion has verified it": (
        "Referenz {number} wurde übernommen, und der Kontakt bleibt offen, bis Bewegung sie bestätigt hat"
    ),
    "back to the one before: probewatch calibration back {number}": (
        "zurück zur vorigen: probewatch calibration back {number}"
    ),
    "now move the probe over tissue, to and fro, tilting and turning it: the service verifies the reference": (
        "jetzt die Sonde über Gewebe hin und her bewegen, dabei kippen und drehen: der Dienst bestätigt die Referenz"
    ),
    "not verified within {seconds} s: {why}": "nicht bestätigt innerhalb von {seconds} s: {why}",
    "not verified, the service is in state {state}: {why}": "nicht bestätigt, der Dienst ist im Zustand {state}: {why}",
    "a device was lost before the new calibration was verified: {why}": (
        "ein Gerät ging verloren, bevor die neue Kalibrierung bestätigt war: {why}"
    ),
    "a device was lost before the new calibration was verified, and the one before is in force": (
        "ein Gerät ging verloren, bevor die neue Kalibrierung bestätigt war, und die vorige ist in Kraft"
    ),
    "As soon as the device is back: probewatch calibration use {file}": (
        "Sobald das Gerät wieder da ist: probewatch calibration use {file}"
    ),
    "The old one is in force again; repair the device and recalibrate again": (
        "Die alte ist wieder in Kraft; das Gerät instand setzen und neu kalibrieren"
    ),
    "The contact stays open; move the probe over tissue, see its status": (
        "Der Kontakt bleibt offen; die Sonde über Gewebe bewegen, siehe den Status"
    ),
    "The contact stays open; to show it, on tissue: {motions}": (
        "Der Kontakt bleibt offen; um es auf Gewebe zu zeigen: {motions}"
    ),
    "reference {number} is verified and in force, also after a restart": (
        "Referenz {number} ist bestätigt und in Kraft, auch nach einem Neustart"
    ),
    "Set the history of the reference in {folder} aside?": "Die Geschichte der Referenz in {folder} beiseitelegen?",
    "the folder holds no history": "der Ordner enthält keine Geschichte",
    "kept as {folder}": "aufbewahrt als {folder}",
    "at its next start the service uses the calibration file of the configuration, not verified": (
        "beim nächsten Start verwendet der Dienst die Kalibrierdatei der Konfiguration, unbestätigt"
    ),
    # status
    "it is {said}, and of it is not shown yet: {names}": "sie ist {said}, und von ihr ist noch nicht gezeigt: {names}",
    "far from the one before": "weit von der vorigen",
    "the first calibration": "die erste Kalibrierung",
    # lamp-test, trend
    "does not answer": "antwortet nicht",
    "limit": "Grenze",
    "since the first": "seit der ersten",
    "per day": "pro Tag",
    "reaches the limit": "erreicht die Grenze",
    "is": "ist",
    "a record of a self-test is damaged, as the top of the report says": (
        "eine Aufzeichnung eines Selbsttests ist beschädigt, wie oben im Bericht steht"
    ),
    "{file} is of an earlier report; --pdf writes it anew": (
        "{file} ist von einem früheren Bericht; --pdf schreibt sie neu"
    ),
    "not before {days} days": "nicht vor {days} Tagen",
    "near its limit": "nahe der Grenze",
    "steady": "beständig",
    "{folder} holds no estimates of reference {number}, only of {held}: give --reference {last}": (
        "{folder} hat keine Schätzungen zu Referenz {number}, nur zu {held}: --reference {last} angeben"
    ),
    "{folder} holds no estimates yet: the service notes one every five minutes while it is verified": (
        "{folder} hat noch keine Schätzungen: der Dienst notiert alle fünf Minuten eine, solange er bestätigt"
    ),
    # log
    "estimate": "Schätzung",
    "overloaded": "überlastet",
    "overload-ended": "Überlastung beendet",
    "wall-clock": "Uhrzeit",
    "slept": "geschlafen",
    "{share} % of the last second waiting for a processor": (
        "{share} % der letzten Sekunde auf einen Prozessor gewartet"
    ),
    "{share} % of its ticks late": "{share} % seiner Takte verspätet",
    "{number} pictures waiting": "{number} Bilder warten",
    "after {seconds} s": "nach {seconds} s",
    "{number} losses of devices meanwhile": "{number}-mal ein Gerät verloren",
    "without an entry each: {said} ({text}) {times} times": "ohne eigenen Eintrag: {said} ({text}) {times}-mal",
    "{said} ({text}) {times} times": "{said} ({text}) {times}-mal",
    "overdue: {said}": "überfällig: {said}",
    "not overdue any more": "nicht mehr überfällig",
    "stepped by {seconds} s": "verstellt um {seconds} s",
    "the computer slept for {seconds} s": "der Rechner hat {seconds} s lang geschlafen",
    # recalibrate
    "nothing was begun": "nichts wurde begonnen",
    "probe": "Sonde",
    "depth or preset of the scanner": "Tiefe oder Voreinstellung des Ultraschallgeräts",
    "your name": "Ihr Name",
    "type something other than spaces": "etwas anderes als Leerzeichen eingeben",
    "waiting for the first picture": "Warten auf das erste Bild",
    "the scan is complete": "der Scan ist vollständig",
    "{views} views in {pictures} pictures": "{views} Ansichten in {pictures} Bildern",
    "all is covered": "alles ist gezeigt",
    "next: {motion}": "als Nächstes: {motion}",
    "Scan the crossing; Enter when it is complete, Ctrl-C to give up.": (
        "Die Kreuzung scannen; Enter, wenn es vollständig ist, Strg-C bricht ab."
    ),
    "The scan is complete: press Enter, or scan on for smaller sigmas.": (
        "Der Scan ist vollständig: Enter, oder weiter scannen für kleinere Sigmas."
    ),
    "Point the probe at the tank's bottom; move it straight up and down, 2 s to and fro, turning sharply.": (
        "Die Sonde auf den Boden des Beckens richten; gerade auf und ab bewegen, 2 s hin und her, scharf umkehren."
    ),
    "Enter takes what was measured; 'skip' leaves it to the scan; Ctrl-C gives up.": (
        "Enter übernimmt das Gemessene; 'auslassen' überlässt es dem Scan; Strg-C bricht ab."
    ),
    "bottom seen in {seen} of {pictures} pictures": "Boden gesehen in {seen} von {pictures} Bildern",
    "not known yet": "noch nicht bekannt",
    "; type it with ?{name}=…": "; mit ?{name}=… eintippen",
    "the service": "der Dienst",
    "proposes no calibration": "schlägt keine Kalibrierung vor",
    "tracker late by {late} ± {sigma} ms": "Tracker verspätet um {late} ± {sigma} ms",
    "tracker early by {late} ± {sigma} ms": "Tracker verfrüht um {late} ± {sigma} ms",
    "no check at another point yet": "noch keine Prüfung an einem anderen Punkt",
    "{views} views put it within {error} mm RMS from where it is": (
        "{views} Ansichten legen ihn auf {error} mm RMS dorthin, wo er ist"
    ),
    "{views} views put it within {error} mm RMS about one place": (
        "{views} Ansichten legen ihn auf {error} mm RMS um einen Ort"
    ),
    "passed": "bestanden",
    "Move the tank by 2 cm and more; pass through the crossing again, tilted otherwise each time; Enter.": (
        "Das Becken um 2 cm oder mehr versetzen; wieder durch die Kreuzung fahren, jedes Mal anders gekippt; Enter."
    ),
    "accept, check (at another point), scan on, reject, or numbers of views to strike out or take back": (
        "annehmen, prüfen (an einem anderen Punkt), weiter (scannen), ablehnen, oder Nummern von Ansichten zum"
        " Streichen oder Zurücknehmen"
    ),
    "'{word}' is no answer": "'{word}' ist keine Antwort",
    "review": "Durchsicht",
    "Type accept, check, scan on or reject": "annehmen, prüfen, weiter oder ablehnen eingeben",
    "Type accept, check, scan on or reject, or numbers of views from 1 to {views}, such as '2 5'": (
        "annehmen, prüfen, weiter oder ablehnen eingeben, oder Nummern von Ansichten von 1 bis {views}, wie '2 5'"
    ),
    "role": "Funktion",
    "why is there no check at another point": "warum gibt es keine Prüfung an einem anderen Punkt",
    "comment": "Bemerkung",
    "name of the second person": "Name der zweiten Person",
    "against the calibration in force: {text}": "gegen die Kalibrierung in Kraft: {text}",
    "Now move the probe over tissue, to and fro, tilting and turning it: the service proves it.": (
        "Jetzt die Sonde über Gewebe hin und her bewegen, dabei kippen und drehen: der Dienst prüft sie."
    ),
    "The calibration before is in force": "Die Kalibrierung davor ist in Kraft",
    "crossing found, {share} %": "Kreuzung gefunden, {share} %",
    "before: {mm}": "vorher: {mm}",
    "lean to and fro": "vor und zurück neigen",
    "twist": "drehen",
    "lean sideways": "zur Seite neigen",
    "new": "neu",
    "{said} less new": "{said} minus neu",
    "motion alone": "Bewegung allein",
    "no service was notified; to use the file: probewatch calibration use {file}": (
        "kein Dienst wurde benachrichtigt; um die Datei zu verwenden: probewatch calibration use {file}"
    ),
    "the service has verified the new calibration and monitors again; it is in force, also after a restart": (
        "der Dienst hat die neue Kalibrierung bestätigt und überwacht wieder; sie bleibt nach einem Neustart in Kraft"
    ),
}
"""Some keys are texts of the commands, which `told` fills in; others are recognised in what was made elsewhere, such as
the items of a self-test, whose record stays English.
"""
