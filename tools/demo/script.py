"""Defines which faults the demo shows, and what each must lead to. Times are seconds of the simulated cart."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import accumulate

from probewatch.appliance.supervision.faults import FAULT_ROWS
from probewatch.appliance.types import Fault, State
from probewatch.drivers.errors import ConfigurationError

HEALTHY_S = 24.0
"""Seconds before the first fault of the default script: about four seconds to start, the gesture that verifies, and
healthy motion."""

DEFAULT = (
    "flip-lateral",
    "depth",
    "bend-marker",
    "freeze-video",
    "lose-tracker",
    "slide-marker",
    "latency",
)

FAULT_CLASS: Mapping[str, Fault] = {
    "flip-lateral": Fault.POLARITY,
    "flip-vertical": Fault.POLARITY,
    "depth": Fault.SCALE,
    "bend-marker": Fault.ROTATION,
    "slide-marker": Fault.OFFSET,
    "latency": Fault.LATENCY,
    "freeze-video": Fault.FROZEN_VIDEO,
    "lose-video": Fault.VIDEO_LOST,
    "lose-tracker": Fault.TRACKER_LOST,
    "stale-tracker": Fault.TRACKER_STALE,
}
"""Fault of a simulated device → class under which a check must report it."""

LONGEST_ON_S = dict.fromkeys(FAULT_CLASS, 8.0) | {"latency": 16.0}
"""Fault → seconds that the service may take to its last state: 3 s of escalation, 3 s in which the hand may rest, and
time to see it; a late tracker shows only where the hand turns back."""
LONGEST_RECOVERY_S = 30.0
"""Seconds that verifying again may take: the hand comes to the gesture within 7 s, or 10 where it rests before, and new
evidence needs up to 10 s of motion."""


@dataclass(frozen=True, slots=True)
class Planned:
    """Represents a fault that is to be shown, not before from_s."""

    fault: str
    from_s: float

    @property
    def longest_s(self) -> float:
        """Returns how long it and its recovery may take."""
        return LONGEST_ON_S[self.fault] + LONGEST_RECOVERY_S


@dataclass(frozen=True, slots=True)
class Injection:
    """Represents a fault that was shown from from_s to to_s."""

    fault: str
    from_s: float
    to_s: float

    @property
    def fault_class(self) -> Fault:
        """Returns the name under which the alarm must report it."""
        return FAULT_CLASS[self.fault]

    @property
    def states(self) -> tuple[State, ...]:
        """Returns the states to which it must lead, in order, without those to which only some of its checks lead: the
        simulated slide is in the picture's plane; 3 mm of it are across, within the limit.
        """
        return tuple(step.state for step in FAULT_ROWS[self.fault_class].policy.steps if not step.by)


@dataclass(frozen=True, slots=True)
class Script:
    """Holds what was shown, in time order, until the run ended at end_s. left_out: faults that were planned, but never
    shown.
    """

    injections: tuple[Injection, ...]
    end_s: float
    left_out: tuple[str, ...] = ()

    def until_s(self, injection: Injection) -> float:
        """Returns when the time of this fault is over: the next one begins, or the run ends."""
        later = [one.from_s for one in self.injections if one.from_s > injection.from_s]
        return min(later, default=self.end_s)


def default_plan(duration_s: float | None = None) -> tuple[Planned, ...]:
    """Returns the faults of DEFAULT one after the other, as many as are certainly over by duration_s."""
    plan = [Planned(fault, HEALTHY_S) for fault in DEFAULT]
    if duration_s is None:
        return tuple(plan)
    over_s = accumulate((one.longest_s for one in plan), initial=HEALTHY_S)
    next(over_s)
    return tuple(one for one, end_s in zip(plan, over_s, strict=True) if end_s <= duration_s)


def chosen_plan(faults: Iterable[tuple[str, float]], duration_s: float | None = None) -> tuple[Planned, ...]:
    """Returns a plan of (fault, from_s) in time order. Raises ConfigurationError where duration_s may be too short for
    them.
    """
    plan = tuple(sorted((Planned(*fault) for fault in faults), key=lambda one: one.from_s))
    over_s = 0.0
    for one in plan:
        over_s = max(over_s, one.from_s) + one.longest_s
    if duration_s is not None and duration_s < over_s:
        what = f"the last fault may need until {over_s:g} s"
        raise ConfigurationError(what, f"--duration {duration_s:g}", "Give more time, or fewer and earlier faults")
    return plan
