"""How often each address is answered: a crowd that asks as fast as it can leaves the page's time to others. Pure."""

_AT_ONCE_S = 1.0
"""Answers of so long a time at once, as a page that is opened asks for its files. Longer lets a crowd take more time of
others, shorter has a page wait that is opened. Not varied."""

_LONGEST_S = 0.4
"""For one request: what 64 connections wait that ask all at once, at the page's 160 a second. Whoever comes and leaves
again does not add to it, and as there are no more places, no more are answered."""

_MOST_ADDRESSES = 1000
"""Remembered at a time; then those are forgotten who may ask at once. More takes memory from the cart."""


class Pace:
    """a_second: answers to one address, evenly spaced once it has had those of _AT_ONCE_S. Times are s of any clock."""

    def __init__(self, a_second: float) -> None:
        self._every_s = 1.0 / a_second
        self._next_s: dict[str, float] = {}

    def wait_s(self, address: str, now_s: float) -> float:
        """How long this request waits, s, 0 where it need not. It is counted."""
        if len(self._next_s) >= _MOST_ADDRESSES:
            self._next_s = {one: next_s for one, next_s in self._next_s.items() if next_s > now_s - _AT_ONCE_S}
        next_s = max(self._next_s.get(address, 0.0), now_s - _AT_ONCE_S) + self._every_s
        self._next_s[address] = next_s = min(next_s, now_s + _LONGEST_S)
        return max(0.0, next_s - now_s)
