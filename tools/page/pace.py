"""Limits how often each address is answered, so that clients that ask as fast as they can do not take the page's time
from others. Pure.
"""

_AT_ONCE_S = 1.0
"""Seconds of answers that may be given at once, as a page that is opened asks for its files. Longer lets many clients
take more time of others, shorter makes a page wait while it is opened. Not varied."""

_LONGEST_S = 0.4
"""Longest wait of one request, s: what 64 connections wait that all ask at once, at the page's 160 a second. A client
that connects and leaves again does not add to it, and as there are no more places, no more are answered."""

_MOST_ADDRESSES = 1000
"""Addresses remembered at a time; beyond that those are forgotten that may ask at once. More takes memory."""


class Pace:
    """Spaces the answers to each address. a_second: answers to one address, evenly spaced once it has had those of
    _AT_ONCE_S. Times are s of any clock.
    """

    def __init__(self, a_second: float) -> None:
        self._every_s = 1.0 / a_second
        self._next_s: dict[str, float] = {}

    def wait_s(self, address: str, now_s: float) -> float:
        """Returns how long this request waits, s, 0 where it need not, and counts it."""
        if len(self._next_s) >= _MOST_ADDRESSES:
            self._next_s = {one: next_s for one, next_s in self._next_s.items() if next_s > now_s - _AT_ONCE_S}
        next_s = max(self._next_s.get(address, 0.0), now_s - _AT_ONCE_S) + self._every_s
        self._next_s[address] = next_s = min(next_s, now_s + _LONGEST_S)
        return max(0.0, next_s - now_s)
