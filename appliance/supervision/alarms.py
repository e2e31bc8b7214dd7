"""Defines the alarm table: what each state looks and sounds like, and what the operator reads beside it.

In the style of IEC 60601-1-8: high priority red, flashing at 1.4 … 2.8 Hz, bursts of 5 + 5 pulses; medium yellow, 0.4 …
0.8 Hz, 3 pulses; low cyan, steady, 1 pulse. Texts are English; appliance.supervision.languages translates them.
"""

from dataclasses import dataclass
from enum import Enum

from probewatch.appliance.supervision.faults import FAULT_ROWS
from probewatch.appliance.supervision.languages import translated
from probewatch.appliance.types import Fault, State

DISPLAY_COLUMNS = 76
"""Columns of the narrowest display, a terminal of 80 with a frame: one line for what is wrong, one for what to do."""


class Priority(Enum):
    """Ranks how soon a person must act."""

    HIGH = "high"
    MEDIUM = "medium"
    LOW = "low"
    NONE = "none"


class Lamp(Enum):
    """Names the one colour that is shown; each means the same everywhere."""

    GREEN = "green"
    CYAN = "cyan"
    YELLOW = "yellow"
    RED = "red"


@dataclass(frozen=True, slots=True)
class Signal:
    """Describes the signal of one state.

    flash_hz: 0 is steady. pulses: tone pulses in a burst, 0 is silence. technical: not about the probe.
    """

    priority: Priority
    technical: bool
    lamp: Lamp
    flash_hz: float
    pulses: int
    text: str
    remedy: str


def _high(technical: bool, text: str, remedy: str) -> Signal:
    return Signal(Priority.HIGH, technical, Lamp.RED, 2.0, 10, text, remedy)


def _low(pulses: int, text: str, remedy: str) -> Signal:
    return Signal(Priority.LOW, True, Lamp.CYAN, 0.0, pulses, text, remedy)


SIGNALS = {
    State.SELF_TEST: _low(0, "Self-test", "Wait a few seconds"),
    State.WAITING: _low(0, "Waiting for devices", "Switch on the scanner and the tracker"),
    State.NOT_VERIFIED: _low(1, "Calibration not verified", "Move the probe over tissue in view of the tracker"),
    State.MONITORING: Signal(Priority.NONE, False, Lamp.GREEN, 0.0, 0, "Calibration verified", "None needed"),
    State.WARNING: Signal(
        Priority.MEDIUM,
        False,
        Lamp.YELLOW,
        0.6,
        3,
        "Do not rely on the overlay",
        "Check the cause; wait a few seconds",
    ),
    State.HALT: _high(False, "HALT: calibration is wrong", "Stop; fix the cause, verify, acknowledge"),
    State.RECALIBRATION_REQUESTED: _high(
        False, "HALT: recalibrate the probe", "Stop; fix the cause or recalibrate; acknowledge"
    ),
    State.RECALIBRATING: _low(1, "Recalibrating", "Finish the scan, then move the probe over tissue to verify"),
    State.DEVICE_LOST: _high(True, "Device lost: not watching", "Reconnect it; monitoring resumes by itself"),
    State.INTERNAL_FAULT: _high(True, "Internal fault: not watching", "Wait for it to restart, else restart the cart"),
}
"""Signal of each state, with flashes in Hz and pulses of a burst in the ranges of IEC 60601-1-8 named above."""

HAZARDS = {fault: row for fault, row in FAULT_ROWS.items() if row.text}
"""Hazards: the faults that have a text for the operator."""
SILENCES = frozenset(fault for fault, row in FAULT_ROWS.items() if row.overload)
"""Hazards that a computer short of time shows as well as a device that is gone."""
_EXPLAINED = (State.WAITING, State.NOT_VERIFIED, State.WARNING, State.DEVICE_LOST, State.INTERNAL_FAULT)
"""States to which silence alone can lead."""

EARLIER, PARTLY_EARLIER = "by earlier motion", "in part by earlier motion"
"""Texts that state what a verified calibration rests on, where the present motion does not show all of it."""
OUTDATED = "the last verification is too old; move the probe over tissue"
BEHIND = "the times of picture or pose fall behind; check scanner, tracker and their server"
DISTURBED = "verified only before a disturbance; move the probe over tissue"
"""Reasons why a calibration that the line has called verified does not count as verified."""

NO_CALIBRATION = "Scan it: 'recalibrate --live --solve all'; or 'calibration use FILE'"
EXPIRED_CALIBRATION = "Calibration has expired: 'probewatch recalibrate --live'"
"""Remedies where no motion can verify anything."""

CHECK_BUMPED = "Check the tracker's position sensor; then 'probewatch ack --bump'"
"""Remedy for a bumped tracker. Until the bump is acknowledged, every pose is a fault and motion verifies nothing."""

NO_LATENCY = "Check frame rate, stamps and whose calibration is in force"
"""Remedy for a latency that the tracker's URL cannot state."""

NOT_NOW = "not possible while"
"""Precedes the state in which a request is not granted."""
ACKNOWLEDGED = "acknowledged, waiting until the calibration is verified again"


def operator_text(state: State, fault: Fault | None, language: str = "en", overloaded: bool = False) -> tuple[str, str]:
    """Returns (text, remedy) for the operator: those of the state, made specific by the hazard where one is named, or
    by the overload where a computer short of time explains the state.
    """
    signal = SIGNALS[state]
    text = translated(signal.text, language)
    if overloaded and state in _EXPLAINED and (fault is None or fault in SILENCES):
        fault = Fault.OVERLOADED
    if fault is None:
        return text, translated(signal.remedy, language)
    hazard = HAZARDS[fault]
    requested = hazard.requested if state is State.RECALIBRATION_REQUESTED else ""
    return f"{text} · {translated(hazard.text, language)}", translated(requested or hazard.remedy, language)
