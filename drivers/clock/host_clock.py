"""Provides the one clock of the host. Sources and the daemon take it as an argument, so a simulated cart may run faster
than real time.
"""

import time
from dataclasses import dataclass, field
from threading import Event


@dataclass(frozen=True, slots=True)
class HostClock:
    """Reads CLOCK_MONOTONIC in nanoseconds; rate > 1 makes time run faster from origin_ns on (simulated carts only)."""

    rate: float = 1.0
    origin_ns: int = field(default_factory=time.monotonic_ns)

    def now_ns(self) -> int:
        """Returns nanoseconds of CLOCK_MONOTONIC; with rate ≠ 1 those since origin_ns are scaled by it."""
        return self.at(self.real_ns())

    def real_ns(self) -> int:
        """Returns nanoseconds of CLOCK_MONOTONIC, whatever the rate."""
        return time.monotonic_ns()

    def at(self, real_ns: int) -> int:
        """Returns what this clock shows, or showed, at real_ns of CLOCK_MONOTONIC."""
        if self.rate == 1.0:
            return real_ns
        return self.origin_ns + round((real_ns - self.origin_ns) * self.rate)

    def sleep_until(self, t_ns: int) -> None:
        """Blocks until now_ns() >= t_ns; returns at once when that is past."""
        remaining_s = (t_ns - self.now_ns()) / self.rate / 1e9
        if remaining_s > 0:
            time.sleep(remaining_s)

    def wait(self, event: Event, real_s: float | None) -> bool:
        """Blocks until the event is set, or for real_s of CLOCK_MONOTONIC (None: for ever). Returns whether it is."""
        return event.wait(real_s)

    def real_s(self, seconds: float) -> float:
        """Returns the wall seconds to pass to a blocking call that shall last `seconds` of this clock."""
        return seconds / self.rate
