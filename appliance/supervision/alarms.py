"""What each state looks and sounds like, and what each hazard asks of the people in the room.

Lamp colours, flash rates and pulse counts follow the style of IEC 60601-1-8: high priority red, 1.4 … 2.8 Hz, bursts of
5 + 5 pulses; medium yellow, 0.4 … 0.8 Hz, 3 pulses; low cyan, steady, 1 pulse.
"""

from dataclasses import dataclass
from enum import Enum

from appliance.types import State


class Priority(Enum):
    """How soon a person must act."""

    HIGH = "high"
    MEDIUM = "medium"
    LOW = "low"
    NONE = "none"


class Kind(Enum):
    """What a hazard leads to: CALIBRATION halts and latches; DEVICE recovers by itself once the device is back."""

    CALIBRATION = "calibration"
    DEVICE = "device"


@dataclass(frozen=True, slots=True)
class Signal:
    """Lamp and tone of one state. flash_hz 0 is steady; pulses: tone pulses in a burst, 0 is silence."""

    priority: Priority
    lamp: str
    flash_hz: float
    pulses: int
    text: str
    remedy: str


@dataclass(frozen=True, slots=True)
class Hazard:
    """One class of fault: what the operator reads and does."""

    kind: Kind
    text: str
    remedy: str


SIGNALS = {
    State.STARTING: Signal(Priority.LOW, "cyan", 0.0, 0, "Starting", "Wait; scanner and tracker must be switched on"),
    State.NOT_VERIFIED: Signal(
        Priority.LOW, "cyan", 0.0, 1, "Calibration not verified", "Move the probe over tissue in view of the tracker"
    ),
    State.MONITORING: Signal(Priority.NONE, "green", 0.0, 0, "Calibration verified", "None needed"),
    State.WARNING: Signal(
        Priority.MEDIUM, "yellow", 0.6, 3, "Do not rely on the overlay", "Look at the cause; wait a few seconds"
    ),
    State.HALT: Signal(
        Priority.HIGH, "red", 2.0, 10, "HALT: calibration is wrong", "Stop; mend the cause, verify, acknowledge"
    ),
    State.RECALIBRATION_REQUESTED: Signal(
        Priority.HIGH, "red", 2.0, 10, "HALT: recalibrate the probe", "Stop; mend the cause or recalibrate"
    ),
    State.RECALIBRATING: Signal(
        Priority.LOW, "cyan", 0.0, 1, "Recalibrating", "Finish the scan, then move the probe over tissue to verify"
    ),
    State.DEVICE_LOST: Signal(
        Priority.HIGH,
        "red",
        2.0,
        10,
        "Device lost: not watching",
        "Bring the device back; monitoring resumes by itself",
    ),
}

HAZARDS = {
    "polarity": Hazard(Kind.CALIBRATION, "Picture is mirrored", "Reset the scanner's left/right and up/down flip"),
    "scale": Hazard(Kind.CALIBRATION, "Picture scale has changed", "Set the scanner's depth and zoom as calibrated"),
    "rotation": Hazard(Kind.CALIBRATION, "Marker body has turned", "Check the marker clamp, then recalibrate"),
    "offset": Hazard(Kind.CALIBRATION, "Marker body has slipped", "Check the marker clamp, then recalibrate"),
    "latency": Hazard(Kind.CALIBRATION, "Tracker and picture are out of step", "Check frame rate and persistence"),
    "frozen-video": Hazard(Kind.DEVICE, "Picture is frozen", "Unfreeze the scanner; check the video cable"),
    "video-lost": Hazard(Kind.DEVICE, "No picture from the scanner", "Check the scanner and the video cable"),
    "tracker-alert": Hazard(Kind.DEVICE, "Tracker reports a fault", "See its remarks; check a bumped sensor, clear it"),
    "marker-body": Hazard(Kind.DEVICE, "Marker body is bent or soiled", "Clean and check all markers and the clamp"),
    "field-distortion": Hazard(Kind.DEVICE, "Tracker's field is distorted", "Move metal and cables away from it"),
    "tracker-lost": Hazard(Kind.DEVICE, "No answer from the tracker", "Check the tracker's power and cable"),
    "tracker-stale": Hazard(Kind.DEVICE, "Tracker repeats old positions", "Restart tracking; check the tracker"),
    "estimator-silent": Hazard(Kind.DEVICE, "Verification has stopped", "Wait for its restart; else restart the cart"),
    "output-failed": Hazard(Kind.DEVICE, "Alarm output does not respond", "Check the relay's cable and power"),
}

UNVERIFIED = {"line-of-sight": "probe not seen by the tracker"}
"""Checks that are no hazard but keep the calibration from being verified, and why."""


def kind_of(fault: str) -> Kind:
    """Raises KeyError for a class that has no row: a check nobody wrote an alarm for is a bug, not a state."""
    return HAZARDS[fault].kind


def operator_text(state: State, fault: str | None) -> tuple[str, str]:
    """(text, remedy) for the operator: the state's own, sharpened by the hazard where one is named."""
    signal = SIGNALS[state]
    if fault is None:
        return signal.text, signal.remedy
    hazard = HAZARDS[fault]
    return f"{signal.text} · {hazard.text}", hazard.remedy
