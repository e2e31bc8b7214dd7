"""Defines each fault in one row: what it leads to, what the operator reads and does in each language, its checks,
device, and keys of its limits. Supervisor, languages, page, metrics and docs/alarms.md are built from the rows. Pure.

Its member of `Fault` gives its word and kind, as the line knows no texts; detectors declare which faults they report.
"""

from collections.abc import Mapping

from probewatch.appliance.supervision.fault_row import Device, FaultRow, Texts
from probewatch.appliance.supervision.policy import (
    ADVISORY,
    DAMAGED,
    DEVICE,
    GROSS,
    OFFSET,
    OUTPUT,
    PAUSED,
    PLAIN,
    SCALE,
    SILENT,
    UNSEEN,
)
from probewatch.appliance.types import Fault

_RECOVER, _RECOVER_DE = (
    "Scan: if it verifies, the tracker moved; else clamp, 'calibration recover'",
    "Schallen; wird bestätigt: Tracker; sonst Klemme, 'calibration recover'",
)
_READ_THE_LOG, _READ_THE_LOG_DE = (
    "Read 'probewatch log --verify', then acknowledge",
    "'probewatch log --verify' lesen, dann quittieren",
)
FAULT_ROWS: Mapping[Fault, FaultRow] = {
    Fault.POLARITY: FaultRow(
        GROSS,
        en=Texts("Picture is mirrored", "Reset the scanner's left/right and up/down flip"),
        de=Texts(
            "Bild ist gespiegelt",
            "Spiegelung am Ultraschallgerät zurückstellen",
            checks={"polarity": "Spiegelung", "picture-flip": "Bild gespiegelt"},
        ),
    ),
    Fault.SCALE: FaultRow(
        SCALE,
        en=Texts(
            "Picture scale has changed",
            "Set the scanner's depth and zoom as calibrated",
            "Set the scanner's depth and zoom as calibrated, else recalibrate",
        ),
        de=Texts(
            "Bildmaßstab ist verändert",
            "Tiefe und Zoom wie bei der Kalibrierung einstellen",
            "Tiefe und Zoom wie bei der Kalibrierung einstellen, sonst neu kalibrieren",
            checks={
                "scale-lateral": "Maßstab lateral",
                "scale-axial": "Maßstab axial",
                "picture-zoom": "Bild gezoomt",
                "picture-size": "Bildgröße",
                "depth-ruler": "Tiefenlineal",
                "fan-stretch": "Fächer gestreckt",
                "fan-shift": "Fächer verschoben",
                "fan-scale": "Fächermaßstab",
            },
        ),
    ),
    Fault.ROTATION: FaultRow(
        PLAIN,
        en=Texts("Marker body or tracker has turned", _RECOVER),
        de=Texts(
            "Markerkörper oder Tracker ist verdreht",
            _RECOVER_DE,
            checks={
                "rotation-lateral": "Drehung lateral",
                "rotation-axial": "Drehung axial",
                "rotation-elevational": "Drehung elevational",
                "marker-turn": "Marker verdreht",
            },
        ),
    ),
    Fault.OFFSET: FaultRow(
        OFFSET,
        en=Texts(
            "Marker body or tracker has moved",
            _RECOVER,
            "Scan: if it verifies, the tracker moved; else check clamp, recalibrate",
        ),
        de=Texts(
            "Markerkörper oder Tracker ist verrutscht",
            _RECOVER_DE,
            "Schallen; wird bestätigt: Tracker; sonst Klemme prüfen, neu kalibrieren",
            checks={
                "offset-lateral": "Versatz lateral",
                "offset-axial": "Versatz axial",
                "offset-elevational": "Versatz elevational",
                "marker-shift": "Marker verschoben",
                "marker-elevational": "Marker elevational",
            },
        ),
    ),
    Fault.LATENCY: FaultRow(
        PLAIN,
        en=Texts("Tracker and picture are out of step", "Check frame rate; set latency_ms as proposed"),
        de=Texts(
            "Tracker und Bild laufen auseinander",
            "Bildrate prüfen; latency_ms wie vorgeschlagen setzen",
            checks={"latency": "Verzögerung"},
        ),
    ),
    Fault.POSE_CONVENTION: FaultRow(
        GROSS,
        en=Texts("Tracker's axis convention is wrong", "Check the tool file and the tracker's export"),
        de=Texts(
            "Achsenkonvention des Trackers falsch",
            "Werkzeugdatei und Export des Trackers prüfen",
            checks={
                "poses-inverted": "Posen umgekehrt",
                "axes-swapped": "Achsen vertauscht",
                "axis-mirrored": "Achse gespiegelt",
                "turns-inverted": "Drehungen umgekehrt",
                "quaternion-order": "Quaternion verdreht",
            },
        ),
    ),
    Fault.EXCHANGED_PROBE: FaultRow(
        SCALE,
        en=Texts(
            "Wrong probe: not the calibrated one",
            "Use the calibrated probe, or load this one's calibration",
            "Use the calibrated probe, or calibrate this one",
        ),
        de=Texts(
            "Falsche Sonde: nicht die kalibrierte",
            "Kalibrierte Sonde nehmen oder Kalibrierung dieser Sonde laden",
            "Kalibrierte Sonde nehmen oder diese kalibrieren",
            checks={"exchanged-probe": "Andere Sonde"},
        ),
    ),
    Fault.MARKER_BODY_MOVED: FaultRow(
        PLAIN,
        en=Texts(
            "One of two marker bodies has moved", "Check both clamps; scan: it shows whether the calibration holds"
        ),
        de=Texts(
            "Einer der Markerkörper ist verschoben",
            "Beide Klemmen prüfen; schallen: es zeigt, ob die Kalibrierung hält",
            checks={"witness-slide": "Zeuge verschoben", "witness-turn": "Zeuge verdreht"},
        ),
        limits=("witness_mm", "witness_deg"),
    ),
    Fault.UNDECIDED: FaultRow(
        PLAIN,
        en=Texts("Fault found, cause undecided", "Make the motion that shows which of the two it is"),
        de=Texts(
            "Fehler gefunden, Ursache unklar",
            "Die Bewegung machen, die zeigt, welches von beiden es ist",
            checks={"undecided": "Unentschieden"},
        ),
    ),
    Fault.AGREEMENT: FaultRow(
        ADVISORY,
        en=Texts(),
        de=Texts(checks={"motion-agreement": "Übereinstimmung", "fan-motion": "Fächer und Bewegung"}),
    ),
    Fault.FROZEN_VIDEO: FaultRow(
        DEVICE,
        en=Texts("Picture is frozen", "Unfreeze the scanner; check the video cable"),
        de=Texts("Bild ist eingefroren", "Standbild aufheben; Videokabel prüfen", checks={"frozen-video": "Standbild"}),
        device=Device.SCANNER,
        place=2,
        limits=("frozen_ms",),
        overload=True,
    ),
    Fault.VIDEO_LOST: FaultRow(
        DEVICE,
        en=Texts("No picture from the scanner", "Check the scanner and the video cable"),
        de=Texts(
            "Kein Bild vom Ultraschallgerät",
            "Ultraschallgerät und Videokabel prüfen",
            checks={"video presence": "Video da"},
        ),
        device=Device.SCANNER,
        place=1,
        limits=("video_silence_ms",),
        overload=True,
    ),
    Fault.TRACKER_ALERT: FaultRow(
        DEVICE,
        en=Texts("Tracker reports a fault", "See its remarks; after a bump check the sensor, 'probewatch ack --bump'"),
        de=Texts(
            "Tracker meldet einen Fehler",
            "Hinweise lesen; nach Stoß Sensor prüfen, 'probewatch ack --bump'",
            checks={"tracker alert": "Trackermeldung"},
        ),
        device=Device.TRACKER,
        place=3,
    ),
    Fault.MARKER_BODY: FaultRow(
        DEVICE,
        en=Texts("Marker body is bent or dirty", "Clean and check all markers and the clamp"),
        de=Texts(
            "Markerkörper verbogen oder verschmutzt",
            "Alle Marker und die Klemme reinigen und prüfen",
            checks={"marker fit": "Markerpassung", "marker geometry": "Markergeometrie"},
        ),
        device=Device.TRACKER,
        place=6,
        limits=("marker_fit_mm", "marker_shape_mm"),
    ),
    Fault.FIELD_DISTORTION: FaultRow(
        DEVICE,
        en=Texts("Tracker's field is distorted", "Move metal and cables away from it"),
        de=Texts(
            "Feld des Trackers ist gestört",
            "Metall und Kabel von ihm entfernen",
            checks={"field indicator": "Feldanzeige", "field-distortion": "Feld gestört"},
        ),
        device=Device.TRACKER,
        place=7,
        limits=("field_indicator", "named_nats"),
    ),
    Fault.TRACKER_LOST: FaultRow(
        DEVICE,
        en=Texts("No answer from the tracker", "Check the tracker's power and cable"),
        de=Texts(
            "Tracker antwortet nicht", "Strom und Kabel des Trackers prüfen", checks={"tracker presence": "Tracker da"}
        ),
        device=Device.TRACKER,
        place=1,
        limits=("tracker_silence_ms",),
        overload=True,
    ),
    Fault.TRACKER_STALE: FaultRow(
        DEVICE,
        en=Texts("Tracker repeats old positions", "Restart tracking; check the tracker"),
        de=Texts(
            "Tracker wiederholt alte Positionen",
            "Tracking neu starten; Tracker prüfen",
            checks={"tracker freshness": "Tracker aktuell", "frozen-tracker": "Tracker steht"},
        ),
        device=Device.TRACKER,
        place=2,
        limits=("tracker_stale_ms",),
        overload=True,
    ),
    Fault.OUTPUT_FAILED: FaultRow(
        OUTPUT,
        en=Texts("Alarm output does not respond", "Check the relay's cable and power"),
        de=Texts(
            "Alarmausgang antwortet nicht",
            "Kabel und Strom des Relais prüfen",
            checks={"output presence": "Alarmausgang da"},
        ),
        device=Device.CONTACT,
        place=1,
        limits=("output_silence_ms",),
        overload=True,
    ),
    Fault.ESTIMATOR_SILENT: FaultRow(
        SILENT,
        en=Texts("Verification has stopped", "Wait for it to restart, else restart the cart"),
        de=Texts(
            "Prüfung steht still",
            "Neustart abwarten; sonst den Wagen neu starten",
            checks={"estimator presence": "Prüfprozess da"},
        ),
        device=Device.COMPUTER,
        place=1,
        limits=("estimator_silence_ms",),
        overload=True,
    ),
    Fault.MEMORY_DAMAGED: FaultRow(
        DAMAGED,
        en=Texts("Alarm memory is damaged", _READ_THE_LOG),
        de=Texts("Alarmspeicher ist beschädigt", _READ_THE_LOG_DE),
        device=Device.ALARM_LOG,
        place=2,
    ),
    Fault.LOG_DAMAGED: FaultRow(
        DAMAGED,
        en=Texts("Alarm log is damaged", _READ_THE_LOG),
        de=Texts(
            "Alarmprotokoll ist beschädigt", _READ_THE_LOG_DE, checks={"alarm log integrity": "Protokoll unversehrt"}
        ),
        device=Device.ALARM_LOG,
        place=1,
    ),
    Fault.LINE_OF_SIGHT: FaultRow(
        UNSEEN,
        en=Texts("Probe not seen by the tracker", "Bring the probe into the tracker's view"),
        de=Texts(
            "Tracker sieht die Sonde nicht",
            "Sonde ins Sichtfeld des Trackers bringen",
            checks={"line of sight": "Sichtverbindung"},
        ),
        device=Device.TRACKER,
        place=4,
    ),
    Fault.POSE_UNUSABLE: FaultRow(
        UNSEEN,
        en=Texts("Tracker sends no valid pose", "See the tracker's remarks; name the right tool"),
        de=Texts(
            "Tracker liefert keine gültige Pose",
            "Hinweise des Trackers lesen; Werkzeug richtig nennen",
            checks={"pose usable": "Pose brauchbar"},
        ),
        device=Device.TRACKER,
        place=5,
    ),
    Fault.USER_FREEZE: FaultRow(
        PAUSED,
        en=Texts("Picture is paused by the user", "Unfreeze the scanner to continue"),
        de=Texts(
            "Bild vom Benutzer angehalten",
            "Zum Weitermachen Standbild aufheben",
            checks={"user-freeze": "Bild angehalten"},
        ),
        device=Device.SCANNER,
        place=3,
        limits=("frozen_ms",),
    ),
    Fault.NO_PICTURE: FaultRow(
        UNSEEN,
        en=Texts("No ultrasound in the picture", "Probe on the skin, live picture on the scanner"),
        de=Texts(
            "Kein Ultraschall im Bild",
            "Sonde auf die Haut, Livebild am Ultraschallgerät",
            checks={"no-picture": "Kein Ultraschall"},
        ),
        device=Device.SCANNER,
        place=4,
    ),
    Fault.LOG_NOT_WRITTEN: FaultRow(
        ADVISORY,
        en=Texts("Alarm log cannot be written", "Make room on the cart's disk; check it"),
        de=Texts(
            "Alarmprotokoll kann nicht geschrieben werden",
            "Platz auf der Festplatte des Wagens schaffen; sie prüfen",
            checks={"alarm log written": "Protokoll gesichert"},
        ),
        device=Device.ALARM_LOG,
        place=3,
    ),
    Fault.OVERLOADED: FaultRow(
        ADVISORY,
        en=Texts("This computer is overloaded", "Close other programs; check a device that stays lost"),
        de=Texts(
            "Dieser Rechner ist überlastet",
            "Andere Programme schließen; Gerät prüfen, das weg bleibt",
            checks={"processor time": "Rechenzeit"},
        ),
        device=Device.COMPUTER,
        place=2,
    ),
    Fault.CALIBRATION_FILE: FaultRow(
        ADVISORY,
        en=Texts("Configured calibration is not in force", "Read 'probewatch calibration list'"),
        de=Texts(
            "Konfigurierte Kalibrierung ist nicht in Kraft",
            "'probewatch calibration list' lesen",
            checks={"calibration file": "Kalibrierdatei"},
        ),
        device=Device.CALIBRATION,
        place=1,
    ),
    Fault.CALIBRATION_DUE: FaultRow(
        ADVISORY,
        en=Texts("Calibration is overdue", "Recalibrate, or check it with the cross-wire"),
        de=Texts(
            "Kalibrierung ist überfällig",
            "Neu kalibrieren, oder am Fadenkreuz prüfen",
            checks={"calibration date": "Kalibrierfrist"},
        ),
        device=Device.CALIBRATION,
        place=2,
    ),
}
"""Rows in the order of the pages. AGREEMENT has no text: it is a fact beside the others, and its check never fails."""


def of_device(device: Device) -> tuple[Fault, ...]:
    """Returns the device's faults, the worst first: the one that hides the others."""
    faults = [fault for fault, row in FAULT_ROWS.items() if row.device is device]
    return tuple(sorted(faults, key=lambda fault: FAULT_ROWS[fault].place))
