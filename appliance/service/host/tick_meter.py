"""How regularly the tick comes."""

from collections import deque

_MOST = 2000
"""100 s of ticks, so that the 99th percentile stands on twenty. More hides in it what the last minute was like."""


class TickMeter:
    """late: ticks that came more than half a period too late. All else over the last _MOST ticks."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._intervals_ns = deque[int](maxlen=_MOST)
        self._last_ns: int | None = None
        self.late = 0

    def note(self, now_ns: int) -> None:
        """A tick begins."""
        if self._last_ns is not None:
            interval_ns = now_ns - self._last_ns
            self._intervals_ns.append(interval_ns)
            self.late += interval_ns > self._period_ns * 3 // 2
        self._last_ns = now_ns

    def fields(self) -> dict[str, float]:
        """Intervals in ms: median, 99th percentile, longest."""
        ordered = sorted(self._intervals_ns) or [0]
        at = {"median_ms": len(ordered) // 2, "p99_ms": len(ordered) * 99 // 100, "longest_ms": len(ordered) - 1}
        return {name: round(ordered[index] / 1e6, 3) for name, index in at.items()}
