"""Measures events per second over the last whole window."""


class RateMeter:
    """Computes a rate from a running count; per_s is 0 until the first window is full."""

    def __init__(self, window_ns: int = 1_000_000_000) -> None:
        self._window_ns = window_ns
        self._start: tuple[int, int] | None = None
        self.per_s = 0.0

    def note(self, now_ns: int, count: int) -> None:
        """Takes the running count. count: all events so far."""
        if self._start is None:
            self._start = (now_ns, count)
        start_ns, start_count = self._start
        if now_ns - start_ns >= self._window_ns:
            self.per_s = (count - start_count) * 1e9 / (now_ns - start_ns)
            self._start = (now_ns, count)
