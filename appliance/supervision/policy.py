"""The policy: what each hazard leads to while it is shown, after how long, with which tone, and what ends it. Pure.

The supervisor's transitions say from where to where it may go; how soon, for which hazard and how loudly is said here
and nowhere else. docs/alarms.md shows the table.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from appliance.supervision.alarms import SIGNALS
from appliance.types import Fault, State


@dataclass(frozen=True, slots=True)
class Durations:
    """Times of the policy and of the supervisor's table, ns of the host clock."""

    gross_halt_after_ns: int = 300_000_000
    halt_after_ns: int = 1_000_000_000
    recalibrate_after_ns: int = 2_000_000_000
    device_lost_after_ns: int = 1_000_000_000
    probation_ns: int = 1_000_000_000
    max_verification_age_ns: int = 120_000_000_000
    self_test_ns: int = 20_000_000_000
    starting_ns: int = 10_000_000_000


class Ending(Enum):
    """What must happen after a hazard is gone before its last state is left."""

    VERIFIED = "gone for probation; a latched state also waits for an acknowledgement and a new verification"
    BACK = "gone for probation"
    ACKNOWLEDGED = "acknowledged"
    AT_ONCE = "gone; new motion verifies again"
    NONE = "gone"


@dataclass(frozen=True, slots=True)
class Step:
    """state: entered once the hazard has been shown for the sum of the durations that after names; () is at once."""

    state: State
    after: tuple[str, ...] = ()

    def after_ns(self, durations: Durations) -> int:
        """In ns."""
        return sum(int(getattr(durations, f"{name}_ns")) for name in self.after)


@dataclass(frozen=True, slots=True)
class Policy:
    """One row. steps: in order; none leaves the state as it is. scan: what it leads to while a recalibration goes on;
    None lets that go on. silent: its states have no tone. tested: the power-on self-test must see it absent.
    """

    steps: tuple[Step, ...]
    ending: Ending
    scan: Step | None = None
    silent: bool = False
    tested: bool = False

    def step_to(self, state: State) -> Step | None:
        """The step that leads there, None where none does."""
        return next((step for step in self.steps if step.state is state), None)


def _calibration(halt: str) -> Policy:
    steps = (
        Step(State.WARNING),
        Step(State.HALT, (halt,)),
        Step(State.RECALIBRATION_REQUESTED, (halt, "recalibrate_after")),
    )
    return Policy(steps, Ending.VERIFIED)


def _device(tested: bool = False) -> Policy:
    lost = Step(State.DEVICE_LOST, ("device_lost_after",))
    return Policy((Step(State.WARNING), lost), Ending.BACK, scan=lost, tested=tested)


GROSS = _calibration("gross_halt_after")
"""Misleads about the side at once."""
PLAIN = _calibration("halt_after")
UNCLEAR = Policy((Step(State.WARNING), Step(State.HALT, ("halt_after",))), Ending.VERIFIED)
"""Surely wrong, and not known what: the motion that tells is asked for, and what it then names has a row of its own."""
DEVICE, OUTPUT = _device(), _device(tested=True)
SILENT = Policy(
    (Step(State.INTERNAL_FAULT),),
    Ending.BACK,
    scan=Step(State.INTERNAL_FAULT, ("device_lost_after",)),
    tested=True,
)
DAMAGED = Policy((Step(State.INTERNAL_FAULT),), Ending.ACKNOWLEDGED, tested=True)
UNSEEN = Policy((Step(State.NOT_VERIFIED),), Ending.AT_ONCE)
PAUSED = Policy((Step(State.NOT_VERIFIED),), Ending.AT_ONCE, silent=True)
"""By the user's own hand: nothing that a sound would have to say."""
ADVISORY = Policy((), Ending.NONE)

POLICY: Mapping[Fault, Policy] = {
    Fault.POLARITY: GROSS,
    Fault.SCALE: PLAIN,
    Fault.ROTATION: PLAIN,
    Fault.OFFSET: PLAIN,
    Fault.LATENCY: PLAIN,
    Fault.POSE_CONVENTION: GROSS,
    Fault.UNDECIDED: UNCLEAR,
    Fault.AGREEMENT: ADVISORY,
    Fault.FROZEN_VIDEO: DEVICE,
    Fault.VIDEO_LOST: DEVICE,
    Fault.TRACKER_ALERT: DEVICE,
    Fault.MARKER_BODY: DEVICE,
    Fault.FIELD_DISTORTION: DEVICE,
    Fault.TRACKER_LOST: DEVICE,
    Fault.TRACKER_STALE: DEVICE,
    Fault.OUTPUT_FAILED: OUTPUT,
    Fault.ESTIMATOR_SILENT: SILENT,
    Fault.MEMORY_DAMAGED: DAMAGED,
    Fault.LOG_DAMAGED: DAMAGED,
    Fault.LINE_OF_SIGHT: UNSEEN,
    Fault.USER_FREEZE: PAUSED,
    Fault.NO_PICTURE: UNSEEN,
    Fault.LOG_NOT_WRITTEN: ADVISORY,
    Fault.OVERLOADED: ADVISORY,
    Fault.CALIBRATION_FILE: ADVISORY,
    Fault.CALIBRATION_DUE: ADVISORY,
}


def pulses(state: State, fault: Fault | None) -> int:
    """Of a burst of the tone in this state, for this hazard; 0 is silence."""
    row = None if fault is None else POLICY[fault]
    quiet = row is not None and row.silent and row.step_to(state) is not None
    return 0 if quiet else SIGNALS[state].pulses
