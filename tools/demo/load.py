"""Records when the machine was too busy for a cart in real time, as the demo sees it."""

import time

from probewatch.appliance.service.host.pressure import Pressure
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable

_WINDOW_NS = 1_000_000_000
"""Nanoseconds of a window: long enough to hold 20 ticks, short enough to fall within one fault of the demo."""
_SHORT = 0.9
"""Pressure of a window, the share of its time in which some program waited. Measured on two cores: 0.15 … 0.5 for
the cart alone; 0.85 … 1.0 beside four to eight busy programs. The scanner's pictures begin to suffer at 16 such
programs."""


class DemoLoad(Closable):
    """Tracks the load; look() must be called often. spans_ns: windows of CLOCK_MONOTONIC in which the machine was too
    busy, joined.
    """

    def __init__(self) -> None:
        self._pressure = Pressure()
        self._at_ns = time.monotonic_ns()
        self._pressure.share(self._at_ns)
        self._overloaded = False
        self.spans_ns: list[tuple[int, int]] = []

    def close(self) -> None:
        """See Closable."""
        self._pressure.close()

    def look(self, overloaded: bool = False) -> None:
        """Takes a look at the load. overloaded: the service reports that it is, which counts also where the kernel
        reports no pressure.
        """
        self._overloaded |= overloaded
        now_ns = time.monotonic_ns()
        if now_ns - self._at_ns < _WINDOW_NS:
            return
        if self._pressure.share(now_ns) >= _SHORT or self._overloaded:
            self._add(self._at_ns, now_ns)
        self._at_ns, self._overloaded = now_ns, False

    def spans_s(self, clock: HostClock) -> tuple[tuple[float, float], ...]:
        """Returns spans_ns in seconds of the cart."""
        seconds = [[(clock.at(t_ns) - clock.origin_ns) / 1e9 for t_ns in span] for span in self.spans_ns]
        return tuple((max(0.0, from_s), to_s) for from_s, to_s in seconds)

    def _add(self, from_ns: int, to_ns: int) -> None:
        if self.spans_ns and self.spans_ns[-1][1] == from_ns:
            from_ns = self.spans_ns.pop()[0]
        self.spans_ns.append((from_ns, to_ns))
