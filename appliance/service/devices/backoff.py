"""Computes the wait before each new attempt: it doubles from a short one up to a cap, until an attempt succeeds."""


class Backoff:
    """Computes the seconds between attempts."""

    def __init__(self, first_s: float = 0.1, cap_s: float = 1.0) -> None:
        self._first_s, self._cap_s = first_s, cap_s
        self._next_s = first_s

    def next_s(self) -> float:
        """Returns the wait before the coming attempt, s."""
        wait_s, self._next_s = self._next_s, min(2 * self._next_s, self._cap_s)
        return wait_s

    def reset(self) -> None:
        """Starts again at the first wait, after an attempt that succeeded."""
        self._next_s = self._first_s
