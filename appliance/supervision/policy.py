"""Defines the policies: what a hazard leads to while it is shown, after how long, with which tone, and what ends it.
Pure.

The supervisor's transitions define which state may follow which; how soon and how loudly is defined only here. The
policy of a fault is in its row (`appliance.supervision.faults`). docs/alarms.md shows the table.

As in the paper, a recalibration is requested only for what motion does not recover: a scale, and the offset across the
picture (ζ). What motion recovers, and what is corrected at the scanner or the tracker, ends in HALT.
"""

from dataclasses import dataclass
from enum import Enum

from probewatch.appliance.limits import MAX_VERIFICATION_AGE_S
from probewatch.appliance.types import State

BEHIND_NS = 1_000_000_000
"""ns by which a verdict may be behind the clock and still count. More keeps the contact closed on times that do not
advance, or advance too slowly, which make all evidence look recent for ever: with this value the contact opens within a
second for every scanner and tracker (docs/failures.md). Less opens it for a busy computer; a picture waits for its pose
for 0.7 s at most (`Pairing`), of a tracker that is lost by then.
"""
CAUGHT_UP_NS = 200_000_000
"""ns by which a verdict must be less behind before it verifies again: two pictures at 10 Hz. With none, the contact of
a cart that is late by nearly that second switched 79 times in 8 s; more keeps it open for longer.
"""


@dataclass(frozen=True, slots=True)
class Durations:
    """Holds the times of the policy and of the supervisor's table, ns of the host clock.

    behind_ns: by which a verdict may be behind the clock and still verify something. It is no key of the configuration:
    what a URL states about delays is added (`appliance.configuration.config`).
    """

    gross_halt_after_ns: int = 300_000_000
    halt_after_ns: int = 1_000_000_000
    recalibrate_after_ns: int = 2_000_000_000
    device_lost_after_ns: int = 1_000_000_000
    probation_ns: int = 1_000_000_000
    max_verification_age_ns: int = round(MAX_VERIFICATION_AGE_S * 1e9)
    self_test_ns: int = 20_000_000_000
    starting_ns: int = 10_000_000_000
    behind_ns: int = BEHIND_NS


class Ending(Enum):
    """Names what must happen after a hazard is gone before its last state is left."""

    VERIFIED = "gone for probation; if latched, also acknowledged and verified since"
    BACK = "gone for probation"
    ACKNOWLEDGED = "acknowledged"
    AT_ONCE = "gone; new motion verifies again"
    NONE = "gone"


@dataclass(frozen=True, slots=True)
class Step:
    """Describes one step of a policy. state: entered once the hazard has been shown for the sum of the durations that
    `after` names; () means at once. by: names of the checks that lead there, where not every check of the hazard does;
    then only their time counts.
    """

    state: State
    after: tuple[str, ...] = ()
    by: tuple[str, ...] = ()

    def after_ns(self, durations: Durations) -> int:
        """Returns the duration, ns."""
        return sum(int(getattr(durations, f"{name}_ns")) for name in self.after)

    def led_by(self, check: str) -> bool:
        """Returns whether that check of the hazard leads there; "" where it is not known which check reports it."""
        return not self.by or check in self.by


@dataclass(frozen=True, slots=True)
class Policy:
    """Describes one policy. steps: in order; none leaves the state as it is. scan: what it leads to during a
    recalibration; None lets the recalibration continue. silent: its states have no tone. tested: the power-on self-test
    must see that it is absent.
    """

    steps: tuple[Step, ...]
    ending: Ending
    scan: Step | None = None
    silent: bool = False
    tested: bool = False

    def step_to(self, state: State) -> Step | None:
        """Returns the step that leads there, None where none does."""
        return next((step for step in self.steps if step.state is state), None)


def _calibration(halt: str, *more: Step) -> Policy:
    return Policy((Step(State.WARNING), Step(State.HALT, (halt,)), *more), Ending.VERIFIED)


def _unrecovered(*by: str) -> Policy:
    after = ("halt_after", "recalibrate_after")
    return _calibration("halt_after", Step(State.RECALIBRATION_REQUESTED, after, by))


def _device(tested: bool = False) -> Policy:
    lost = Step(State.DEVICE_LOST, ("device_lost_after",))
    return Policy((Step(State.WARNING), lost), Ending.BACK, scan=lost, tested=tested)


GROSS = _calibration("gross_halt_after")
"""For faults that mislead about the side at once, and are corrected at the scanner or the tracker that is set wrong."""
PLAIN = _calibration("halt_after")
"""For faults that motion recovers, or for which it shows the value to set; also while it is not known what is wrong:
the motion that shows it is then requested, and what it names has a row of its own.
"""
SCALE = _unrecovered()
OFFSET = _unrecovered("offset-elevational", "marker-elevational")
"""For an offset, of which motion recovers only the part in the picture's plane."""
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
"""For a picture that the user's own hand has paused: a sound would have nothing to report."""
ADVISORY = Policy((), Ending.NONE)
