"""The order of one source's stamps."""

from probewatch.drivers.samples import Stamp


class MonotonicStamps:
    """Makes stamps of one source strictly increasing: word that data are stale is stamped when it came, and the next
    measurement may have been made before that. What a stamp is moved by is added to its bound.
    """

    def __init__(self) -> None:
        self._last_t_ns = 0

    def stamp(self, t_ns: int, err_ns: int) -> Stamp:
        """t_ns, or a nanosecond after the stamp before."""
        self._last_t_ns = max(t_ns, self._last_t_ns + 1)
        return Stamp(self._last_t_ns, err_ns + self._last_t_ns - t_ns)
