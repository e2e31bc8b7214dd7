"""Lets the samples of one stream in by their stamps; one whose stamp leaps is believed only once others agree
with it.
"""

from enum import Enum

_LEAP_NS = 2_000_000_000
"""Step of a stamp, ns, beyond which it is a leap. Longer lets one false stamp hold the stream up for longer; shorter
costs a slow stream its samples. The slowest that can be paired sends every 0.25 s (`Pairing`).
"""
_AGREEING = 3
"""Number of successive stamps that confirm a leap. More costs that many samples after each gap; fewer would let a pair
of false stamps move the stream. At 4 Hz, three take .75 s, within the second that is promised (docs/failures.md).
"""


class StampCheck(Enum):
    """States whether a sample was let in.

    IN: in order. REFUSED: a leap that nothing has confirmed. WENT_BACKWARDS: let in, and what came before it was
    stamped in the future: whatever is not older than this sample must be discarded.
    """

    IN = "in order"
    REFUSED = "its time goes back, or leaps ahead by more than 2 s"
    WENT_BACKWARDS = "went backwards"


class StampGate:
    """Lets the samples of one stream in by their stamps.

    last_ns: the newest stamp that was let in, None before the first.
    """

    def __init__(self) -> None:
        self.last_ns: int | None = None
        self._leap_ns = 0
        self._agreeing = self._refused = 0

    @property
    def lost(self) -> bool:
        """Returns whether as many stamps in a row were refused as would confirm a leap: they do not advance, go back or
        contradict each other, and nobody knows when any sample of the stream was taken.
        """
        return self._refused >= _AGREEING

    def step(self, t_ns: int) -> StampCheck:
        """Judges the next sample of the stream by its stamp."""
        judged = self._judged(t_ns)
        self._refused = self._refused + 1 if judged is StampCheck.REFUSED else 0
        return judged

    def _judged(self, t_ns: int) -> StampCheck:
        last_ns = self.last_ns
        if last_ns is None or _follows(last_ns, t_ns):
            self.last_ns, self._agreeing = t_ns, 0
            return StampCheck.IN
        self._agreeing = self._agreeing + 1 if self._agreeing and _follows(self._leap_ns, t_ns) else 1
        self._leap_ns = t_ns
        if self._agreeing < _AGREEING:
            return StampCheck.REFUSED
        self.last_ns, self._agreeing = t_ns, 0
        return StampCheck.WENT_BACKWARDS if t_ns <= last_ns else StampCheck.IN


def _follows(before_ns: int, t_ns: int) -> bool:
    return before_ns < t_ns <= before_ns + _LEAP_NS
