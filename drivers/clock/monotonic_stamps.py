"""Keeps the stamps of one source in order."""

from probewatch.drivers.samples import Stamp


class MonotonicStamps:
    """Makes the stamps of one source strictly increasing. A report that data are stale is stamped when it came, and the
    next measurement may have been made before that. The time by which a stamp is moved is added to its bound.
    """

    def __init__(self) -> None:
        self._last_t_ns = 0

    def stamp(self, t_ns: int, err_ns: int) -> Stamp:
        """Returns a stamp at t_ns, or one nanosecond after the stamp before if that is later."""
        self._last_t_ns = max(t_ns, self._last_t_ns + 1)
        return Stamp(self._last_t_ns, err_ns + self._last_t_ns - t_ns)
