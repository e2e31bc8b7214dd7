"""Detects whether this computer is short of time. Pure: time is an argument.

It explains and decides nothing: the contact, the states and their names are the same with and without it.
"""

from dataclasses import dataclass
from math import exp, isnan, nan

from probewatch.appliance.types import Check, Fault, VerdictKind

REPORTS_FAULTS = (Fault.OVERLOADED,)

_MEMORY_S = 1.0
"""s, the time constant of the means. With a longer one, a short burst is not called an overload; with a shorter one,
fewer losses precede the detection.
"""
_LONGEST_STEP_S = 0.25
"""s, the most that a step counts for, so that a service that was stopped, or a laptop that slept, is not overloaded."""
_LATE = 0.25
"""Share of time by which ticks may be late. Higher: a device is lost before the overload is known. Lower: a single long
tick, which counts for 0.22 at most, is called an overload. Measured on two cores, service at nice -10, pressure 0.99: 0
beside 32 busy programs; under 0.04 in 23 of 25 seconds after a tracker was killed at a load average of 13, 0.09 and 0.2
in the other two; 0.4 and more for a service that runs only when others leave time (SCHED_IDLE beside four busy
programs).
"""
_WAITING = 4
"""Pictures that wait for the estimator: a quarter of its ring. An estimator that keeps up has none or one."""
_BEHIND = 0.5
"""Share of time in which that many pictures wait."""
_PRESSED = 0.5
"""Pressure below which a late tick is no overload, but a stopped process. Measured: 0.1 … 0.5 on a cart at rest."""
_RELIEF = 0.5
"""Share of each limit below which the overload counts as over."""
_PROBATION_NS = 5_000_000_000
"""ns for which it must be over. With more, there are fewer pairs of entries; with less, the end is reported sooner."""


@dataclass(frozen=True, slots=True)
class Load:
    """Holds what is known about the last tick. pressure: share of the time since the tick before in which some program
    waited for the processor or for memory, NaN where the kernel does not report it. waiting: pictures that the
    estimator has not taken although it is working.
    """

    pressure: float = nan
    waiting: int = 0


@dataclass(slots=True)
class _Mean:
    """Computes a leaky mean."""

    value: float = 0.0

    def add(self, value: float, step_s: float) -> None:
        self.value += (value - self.value) * (1 - exp(-step_s / _MEMORY_S))


class Overload:
    """Detects an overload, one step a tick.

    since_ns: when it began, None while there is none. period_ns: how often the tick is due.
    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._pressure, self._late, self._behind = _Mean(), _Mean(), _Mean()
        self._pressure_known = False
        self._last_ns: int | None = None
        self._good_ns = 0
        self.since_ns: int | None = None

    def step(self, now_ns: int, load: Load) -> Check:
        """Returns the check to add to those of the device watchers."""
        if self._last_ns is not None and now_ns > self._last_ns:
            self._note(now_ns - self._last_ns, load)
        self._last_ns = now_ns
        strain = self._strain()
        if self.since_ns is None:
            self.since_ns = now_ns if strain >= 1.0 else None
            self._good_ns = now_ns
        elif strain >= _RELIEF:
            self._good_ns = now_ns
        elif now_ns - self._good_ns >= _PROBATION_NS:
            self.since_ns = None
        verdict = VerdictKind.OK if self.since_ns is None else VerdictKind.FAULT
        return Check("processor time", Fault.OVERLOADED, strain, 0.0, "", 1.0, verdict)

    @property
    def pressure(self) -> float:
        """Returns the mean of the last second, 0 … 1; NaN where the kernel does not report it."""
        return self._pressure.value if self._pressure_known else nan

    @property
    def late(self) -> float:
        """Returns the share of the last second by which ticks were late."""
        return self._late.value

    def _note(self, interval_ns: int, load: Load) -> None:
        step_s = min(interval_ns / 1e9, _LONGEST_STEP_S)
        late = interval_ns > self._period_ns * 3 // 2
        self._late.add((interval_ns - self._period_ns) / interval_ns if late else 0.0, step_s)
        self._behind.add(float(load.waiting >= _WAITING), step_s)
        self._pressure_known = not isnan(load.pressure)
        self._pressure.add(load.pressure if self._pressure_known else 0.0, step_s)

    def _strain(self) -> float:
        """Returns the worst quantity ÷ its limit. Without the kernel's figures only the tick counts."""
        pressed = not self._pressure_known or self._pressure.value >= _PRESSED
        late = self._late.value / _LATE if pressed else 0.0
        return max(late, self._behind.value / _BEHIND)
