"""Converts the kernel's timestamp of a buffer into the host time at which the middle of the picture was true, with its
bound. Everything here is pure.

A timestamp states when the first or the last byte of a picture arrived (V4L2 buffer flags TSTAMP_SRC). The picture was
made some time within its own period, so its middle is half a period from there, and is known to half a period. The
latency inside the scanner cannot be seen from here; the line estimates it.
"""

from dataclasses import dataclass

from probewatch.drivers.clock.monotonic_stamps import MonotonicStamps
from probewatch.drivers.samples import Stamp
from probewatch.drivers.video.v4l2 import abi

_SLACK_NS = 200_000
"""Time that the interrupt and the driver add before the timestamp is taken, ns."""
_ARRIVAL_NS = 20_000_000
"""Time that waking up may add, ns, where only the arrival is known."""
_OTHER_CLOCK_NS = 2_000_000_000
"""Distance from the arrival, ns, from which a timestamp was taken from another clock, whatever its flags state."""
_HALF, _WRAP = 1 << 31, 1 << 32
"""The kernel counts pictures in 32 bits; a step of half of that or more is one backward."""


@dataclass
class FrameTimes:
    """Stamps the pictures of one capture. period_ns: that of the pictures. ahead: count of timestamps that lay after
    the arrival; foreign: count of timestamps that were no host time.
    """

    period_ns: int
    ahead: int = 0
    foreign: int = 0

    def __post_init__(self) -> None:
        self._monotonic = MonotonicStamps()

    def stamp(self, flags: int, kernel_ns: int, arrival_ns: int) -> Stamp:
        """Returns the stamp of a picture. flags: those of the buffer. kernel_ns: its timestamp. arrival_ns:
        CLOCK_MONOTONIC when it was taken from the queue.
        """
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
    """Converts the kernel's 32-bit picture counter into one that never wraps. lost: numbers that no buffer carried."""

    lost: int = 0
    restarts: int = 0
    _last: int | None = None
    _total: int = 0

    def count(self, sequence: int) -> int:
        """Returns the number of this picture. A counter that runs backward was restarted by the driver; none is
        lost.
        """
        step = 1 if self._last is None else (sequence - self._last) % _WRAP
        if step == 0 or step >= _HALF:
            self.restarts += 1
            step = 1
        self.lost += step - 1
        self._total += step
        self._last = sequence
        return self._total
