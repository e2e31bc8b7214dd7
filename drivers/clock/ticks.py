"""Finds the step in which a clock reports its time, where it does so in steps: Windows advances its own every 15.6 ms
or 1 ms.

A time reported in steps is up to one step too early. Where all differences of times are multiples of one step, zero
included, and not all the same, that step may be the clock's. It may also be the period of a device that left some
measurements out or reported them twice, so callers must take it for no more than a bound.
"""

from collections import deque
from collections.abc import Sequence
from itertools import pairwise

_DIFFERENCES = 60
"""Newest differences that show the step: a second at 60 Hz. Fewer find one by chance; more take longer to find it."""

_FEWEST = 8
"""Differences from which a step is known. Fewer find one by chance (two differences always have one)."""

_LEAST_NS = 900_000
"""Least step that is looked for, ns: 1 ms, slewed. A shorter one adds less than the other bounds, and the shorter it
may be, the sooner the jitter of exact times looks like steps.
"""

_OFF = 0.05
"""How far a difference may be from a multiple, as a share of the step: a clock that is slewed to a server's changes its
steps by some 1 %. More finds steps in times that have none (at .05, one difference in ten fits by chance).
"""


class Ticks:
    """Detects the step of a series of times. tick_ns: the step, 0 where the times have none. Once known, it holds until
    a difference is no multiple of it.
    """

    def __init__(self) -> None:
        self.tick_ns = 0
        self._last_ns: int | None = None
        self._differences: deque[int] = deque(maxlen=_DIFFERENCES)

    def take(self, time_ns: int) -> None:
        """Takes the next time that was reported, ns, including one that was reported before."""
        last_ns, self._last_ns = self._last_ns, time_ns
        if last_ns is None or time_ns < last_ns:
            return
        difference_ns = time_ns - last_ns
        if self.tick_ns and not _is_multiple(difference_ns, self.tick_ns):
            self.tick_ns = 0
            self._differences.clear()
        self._differences.append(difference_ns)
        if not self.tick_ns:
            self.tick_ns = _step_of(self._differences)


def _step_of(differences_ns: Sequence[int]) -> int:
    """Returns the step of which all differences are multiples, though not all the same one; 0 where there is none."""
    if len(differences_ns) < _FEWEST:
        return 0
    ordered = sorted(differences_ns)
    apart = [later - earlier for earlier, later in pairwise(ordered) if later - earlier >= _LEAST_NS]
    if not apart:
        return 0
    step_ns = min([*apart, *(one for one in ordered if one >= _LEAST_NS)])
    return step_ns if all(_is_multiple(one, step_ns) for one in differences_ns) else 0


def _is_multiple(difference_ns: int, step_ns: int) -> bool:
    rest_ns = difference_ns % step_ns
    return min(rest_ns, step_ns - rest_ns) <= _OFF * step_ns
