"""The kernel's time stamp of a buffer → host time at which the middle of the picture was true, with its bound. Pure.

A stamp says when the first or the last byte of a picture arrived (V4L2 buffer flags TSTAMP_SRC). The picture was made
some time within its own period, so its middle lies half a period from there, and is known to half a period. The
latency inside the scanner cannot be seen from here; the line estimates it.
"""

from dataclasses import dataclass

from probewatch.drivers.clock.monotonic_stamps import MonotonicStamps
from probewatch.drivers.samples import Stamp
from probewatch.drivers.video.v4l2 import abi

_SLACK_NS = 200_000
"""What the interrupt and the driver add before the stamp is taken."""
_ARRIVAL_NS = 20_000_000
"""What waking up may add where only the arrival is known."""
_OTHER_CLOCK_NS = 2_000_000_000
"""A stamp this far from the arrival was taken from another clock, whatever its flags say."""
_HALF, _WRAP = 1 << 31, 1 << 32
"""The kernel counts pictures in 32 bits; a step of half of that or more is one backward."""


@dataclass
class FrameTimes:
    """period_ns: of the pictures. ahead: stamps that lay after the arrival; foreign: stamps that were no host time."""

    period_ns: int
    ahead: int = 0
    foreign: int = 0

    def __post_init__(self) -> None:
        self._monotonic = MonotonicStamps()

    def stamp(self, flags: int, kernel_ns: int, arrival_ns: int) -> Stamp:
        """flags: of the buffer. kernel_ns: its stamp. arrival_ns: CLOCK_MONOTONIC when it was taken from the queue."""
        half_ns = self.period_ns // 2
        monotonic = flags & abi.BUF_FLAG_TIMESTAMP_MASK == abi.BUF_FLAG_TIMESTAMP_MONOTONIC
        if not monotonic or abs(arrival_ns - kernel_ns) > _OTHER_CLOCK_NS:
            self.foreign += 1
            return self._monotonic.stamp(arrival_ns - half_ns, self.period_ns + _ARRIVAL_NS)
        starts = flags & abi.BUF_FLAG_TSTAMP_SRC_MASK == abi.BUF_FLAG_TSTAMP_SRC_SOE
        known_ns = min(kernel_ns, arrival_ns)
        self.ahead += kernel_ns > arrival_ns
        middle_ns = min(known_ns + half_ns, arrival_ns) if starts else known_ns - half_ns
        return self._monotonic.stamp(middle_ns, half_ns + _SLACK_NS + kernel_ns - known_ns)


@dataclass
class Counter:
    """The kernel's 32-bit picture counter as one that never wraps. lost: numbers that no buffer carried."""

    lost: int = 0
    restarts: int = 0
    _last: int | None = None
    _total: int = 0

    def count(self, sequence: int) -> int:
        """The number of this picture. One that runs backward was started again by the driver, and loses nothing."""
        step = 1 if self._last is None else (sequence - self._last) % _WRAP
        if step == 0 or step >= _HALF:
            self.restarts += 1
            step = 1
        self.lost += step - 1
        self._total += step
        self._last = sequence
        return self._total
