"""Detects that this computer has slept: the clock by which all evidence ages does not advance meanwhile."""

import time
from collections.abc import Callable

from probewatch.appliance.core.times import MOST_APART_NS

_LEAST_NS = MOST_APART_NS
"""ns. Less than the time for which nothing may be seen is no sleep: whatever a hand can change takes longer."""

Bounds = tuple[int, int]
"""ns, bounds of the true value: the clocks are read one after the other, and the process may wait in between."""


def slept_ns() -> Bounds:
    """Returns for how long this computer has slept since it was started, suspended to memory or to disk."""
    before_ns = time.monotonic_ns()
    boot_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME)
    return boot_ns - time.monotonic_ns(), boot_ns - before_ns


class SleepWatch:
    """Detects sleep between two looks. slept: returns for how long the computer has slept since it was started."""

    def __init__(self, slept: Callable[[], Bounds] = slept_ns) -> None:
        self._slept = slept
        self._most_ns: int | None = None

    def look(self) -> float | None:
        """Returns for how long the computer has slept since the last look, s; None where it has not."""
        least_ns, most_ns = self._slept()
        before_ns = self._most_ns
        if before_ns is not None and least_ns - before_ns > _LEAST_NS:
            self._most_ns = most_ns
            return (least_ns - before_ns) / 1e9
        self._most_ns = most_ns if before_ns is None else min(before_ns, most_ns)
        return None
