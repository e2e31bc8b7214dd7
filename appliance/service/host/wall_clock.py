"""Detects steps of the wall clock: nothing is timed by it, but the times in the logs jump, which is reported."""

_LEAST_NS = 1_000_000_000
"""ns. A smaller step is not worth an entry: times in the logs are read to the second. Clocks that are slewed never come
near to it in a tick.
"""


class WallClock:
    """Compares the wall clock with the monotonic one. A step is at least a second between two looks."""

    def __init__(self) -> None:
        self._ahead_ns: int | None = None

    def look(self, monotonic_ns: int, wall_ns: int) -> float | None:
        """Returns the step of the wall clock since the last look, s; None where there was none."""
        ahead_ns, before_ns = wall_ns - monotonic_ns, self._ahead_ns
        self._ahead_ns = ahead_ns
        if before_ns is None or abs(ahead_ns - before_ns) < _LEAST_NS:
            return None
        return (ahead_ns - before_ns) / 1e9
