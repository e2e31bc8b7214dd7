"""Converts a device's frame counter into host time, and measures its rate."""

import statistics
from collections.abc import Sequence

from probewatch.drivers.clock.device_clock import DeviceClock
from probewatch.drivers.samples import Stamp

COUNTS = 1 << 32
"""Values of a frame counter, by NDI's Combined API: at 60 Hz it wraps after 828 days."""


class CounterClock(DeviceClock):
    """Converts values of a 32-bit frame counter into stamps, as `DeviceClock` does for times; undoes the wrap-around.

    nominal_hz: counts per second according to the data sheet.
    """

    def __init__(self, nominal_hz: float) -> None:
        super().__init__()
        self._period_ns = 1e9 / nominal_hz
        self._counter: int | None = None
        self._counts = 0

    def stamp(self, counter: int, arrival_ns: int, absent_ns: int | None = None, asked_ns: int | None = None) -> Stamp:
        """Returns the stamp as DeviceClock.stamp does, for a value of the counter. A counter that runs backward starts
        the line again.
        """
        steps = 0 if self._counter is None else (counter - self._counter) % COUNTS
        self._counts += steps - COUNTS if steps >= COUNTS // 2 else steps
        self._counter = counter
        return super().stamp(round(self._counts * self._period_ns), arrival_ns, absent_ns, asked_ns)


def counter_rate_hz(counters: Sequence[int], arrivals_ns: Sequence[int]) -> float:
    """Returns the counts per second of a counter without a data sheet, by the regression line through all its readings.

    counters: (n,), n >= 2, without wrap-around. arrivals_ns: (n,).
    """
    slope_ns = statistics.linear_regression(counters, [t_ns - arrivals_ns[0] for t_ns in arrivals_ns]).slope
    return 1e9 / slope_ns
