"""Which faults the demo shows, and when. Times are seconds of the simulated cart."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise

from appliance.supervision.alarms import Kind, kind_of
from appliance.types import State
from drivers.errors import ConfigurationError
from drivers.twins.faults import FAULT_CLASS, Episode, Schedule

HEALTHY_S = 24.0
"""Start of the first fault of the default script: four seconds to start, then 20 s of healthy motion."""

DEFAULT = (
    "flip-lateral",
    "depth",
    "bend-marker",
    "freeze-video",
    "lose-tracker",
    "slide-marker",
    "latency",
)

_ON_S = dict.fromkeys(FAULT_CLASS, 4.5) | {"latency": 11.0, "slide-marker": 5.5}
_ON_S |= dict.fromkeys(("freeze-video", "lose-video", "lose-tracker", "stale-tracker"), 3.0)
"""Fault → how long it is on: as long as it takes to be seen, and 3 s from there to the last state it leads to."""

_RECOVERY_S = {Kind.CALIBRATION: 14.5, Kind.DEVICE: 15.0}
"""How long the service may take to verify again. New evidence needs up to 10 s, as the hand rests 3 s in every 13."""

_EXPECTED = {
    Kind.CALIBRATION: (State.WARNING, State.HALT, State.RECALIBRATION_REQUESTED),
    Kind.DEVICE: (State.WARNING, State.DEVICE_LOST),
}


@dataclass(frozen=True, slots=True)
class Injection:
    """One fault of the script."""

    fault: str
    from_s: float

    @property
    def to_s(self) -> float:
        return self.from_s + _ON_S[self.fault]

    @property
    def over_s(self) -> float:
        """When the calibration has to be verified again."""
        return self.to_s + _RECOVERY_S[kind_of(self.fault_class)]

    @property
    def fault_class(self) -> str:
        """Name under which the alarm must report it."""
        return FAULT_CLASS[self.fault]

    @property
    def states(self) -> tuple[State, ...]:
        """States it has to lead to, in order."""
        return _EXPECTED[kind_of(self.fault_class)]


@dataclass(frozen=True, slots=True)
class Script:
    """Faults in time order, far enough apart; the run ends at duration_s at the latest."""

    injections: tuple[Injection, ...]
    duration_s: float

    @property
    def schedule(self) -> Schedule:
        """The same for the twins."""
        return Schedule(tuple(Episode(one.fault, one.from_s, one.to_s) for one in self.injections))

    def until_s(self, injection: Injection) -> float:
        """When the time of this fault is up: the next one begins, or the run ends."""
        later = [one.from_s for one in self.injections if one.from_s > injection.from_s]
        return min(later, default=self.duration_s)

    def next_after(self, t_s: float) -> Injection | None:
        """The first fault that begins after t_s."""
        return next((one for one in self.injections if one.from_s > t_s), None)

    def on(self, t_s: float) -> Injection | None:
        """The fault that is on at t_s."""
        return next((one for one in self.injections if one.from_s <= t_s < one.to_s), None)


def default_script(duration_s: float | None = None) -> Script:
    """The faults of DEFAULT one after the other, as many as are over by duration_s."""
    injections: list[Injection] = []
    from_s = HEALTHY_S
    for fault in DEFAULT:
        injection = Injection(fault, from_s)
        if duration_s is None or injection.over_s <= duration_s:
            injections.append(injection)
            from_s = injection.over_s
    return Script(tuple(injections), from_s if duration_s is None else duration_s)


def chosen_script(faults: Iterable[tuple[str, float]], duration_s: float | None = None) -> Script:
    """Script of (fault, from_s) as a person asked for. Raises ConfigurationError where that leaves too little time."""
    injections = tuple(sorted((Injection(*fault) for fault in faults), key=lambda one: one.from_s))
    for before, after in pairwise(injections):
        if after.from_s < before.over_s:
            what = f"it begins before {before.fault}@{before.from_s:g} can be over"
            raise ConfigurationError(what, f"--fault {after.fault}@{after.from_s:g}", f"Use {before.over_s:g} or later")
    last_s = injections[-1].over_s
    if duration_s is not None and duration_s < last_s:
        what = f"the last fault needs until {last_s:g} s"
        raise ConfigurationError(what, f"--duration {duration_s:g}", "Give more time, or an earlier fault")
    return Script(injections, last_s if duration_s is None else duration_s)
