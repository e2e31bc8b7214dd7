"""How long to wait before the next attempt: doubling from a short wait to a cap, until something succeeds."""


class Backoff:
    """Seconds between attempts."""

    def __init__(self, first_s: float = 0.1, cap_s: float = 1.0) -> None:
        self._first_s, self._cap_s = first_s, cap_s
        self._next_s = first_s

    def next_s(self) -> float:
        """The wait before the coming attempt."""
        wait_s, self._next_s = self._next_s, min(2 * self._next_s, self._cap_s)
        return wait_s

    def reset(self) -> None:
        """Something succeeded."""
        self._next_s = self._first_s
