"""Measures how regularly the tick comes."""

from collections import deque
from typing import Any

from probewatch.appliance.service.host.delay_histogram import DelayHistogram

_MOST = 2000
"""Intervals: 100 s, so that the 99th percentile rests on twenty. More hides in it what the last minute was like."""
_BOUNDS_MS = (10.0, 20.0, 30.0, 40.0, 50.0, 52.0, 55.0, 60.0, 75.0, 100.0, 150.0, 250.0, 500.0, 1000.0)
"""ms, bounds of the histogram. The tick is due after 50 ms at the latest and late from 75 on; an output opens by itself
after 250.
"""


class TickMeter:
    """Measures the intervals between ticks. late: ticks that came more than half a period late. This and the histogram
    count since the start; the other figures are over the last _MOST ticks.
    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._intervals_ns = deque[int](maxlen=_MOST)
        self._last_ns: int | None = None
        self.late = 0
        self._counted = DelayHistogram(_BOUNDS_MS)

    def note(self, now_ns: int) -> None:
        """Records that a tick begins at now_ns."""
        if self._last_ns is not None:
            interval_ns = now_ns - self._last_ns
            self._intervals_ns.append(interval_ns)
            self._counted.note(interval_ns / 1e6)
            self.late += interval_ns > self._period_ns * 3 // 2
        self._last_ns = now_ns

    def fields(self) -> dict[str, Any]:
        """Returns the intervals in ms: median, 99th percentile, longest; and the histogram of all since the start."""
        ordered = sorted(self._intervals_ns) or [0]
        at = {"median_ms": len(ordered) // 2, "p99_ms": len(ordered) * 99 // 100, "longest_ms": len(ordered) - 1}
        latest = {name: round(ordered[index] / 1e6, 3) for name, index in at.items()}
        return {**latest, "histogram": self._counted.fields()}
