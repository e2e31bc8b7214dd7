"""Decides which steps of the supervisor begin an entry of a timeline. Pure."""

from probewatch.appliance.types import POINT_WITHHELD


class Turns:
    """Tracks what a timeline last said: a state with its fault, and within it, once, that the limit of the error of a
    point alone withholds the OK.
    """

    def __init__(self) -> None:
        self._last: tuple[object, object] | None = None
        self._limited = False

    def begins(self, state: object, fault: object, reason: str) -> bool:
        """Returns whether this step begins an entry. Repeated only once in each state, as the error may stay near its
        limit.
        """
        changed = (state, fault) != self._last
        limited = reason.startswith(POINT_WITHHELD)
        new = changed or (limited and not self._limited)
        self._last, self._limited = (state, fault), limited or (self._limited and not changed)
        return new
