"""Where a live recalibration stands, and whether somebody is still there who may go on with it."""

import time
from collections.abc import Callable
from enum import StrEnum

_ABANDONED_S = 900.0
"""Without anybody at the page or the terminal before a scan is given up: a quarter of an hour of a cart that cannot be
used. Longer keeps it from everybody; shorter loses a scan to a telephone call.
"""
_UNSEEN_S = 300.0
"""Without any browser that may go on before a scan begun by one is given up: a tablet that has fallen asleep, or was
carried off, is back by then. Longer keeps the cart for nobody. Not measured.
"""


class Phase(StrEnum):
    """Where the procedure stands."""

    IDLE = "idle"
    LATENCY = "latency"
    SCANNING = "scanning"
    REVIEW = "review"
    CHECKING = "checking"
    PROVING = "proving"
    DONE = "done"
    ENDED = "ended"


LISTENING = (Phase.LATENCY, Phase.SCANNING, Phase.CHECKING)
"""While samples are taken."""
HELD = (*LISTENING, Phase.REVIEW)
"""While the service has to recalibrate, and nothing has been taken yet."""
OPEN = (*HELD, Phase.PROVING)
"""While it is going on: nobody may begin another one."""


class Attendance:
    """Who was there, and when last. now_s: a clock in seconds."""

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s, self._touched_s = now_s, now_s()
        self._seen_s: float | None = None

    def begin(self) -> None:
        """Somebody begins a scan: no browser has shown it yet."""
        self._seen_s = None
        self.touch()

    def touch(self) -> None:
        """Somebody who may go on with it is there."""
        self._touched_s = self._now_s()

    def look_on(self) -> None:
        """A browser that may go on with it shows it. Whoever has looked on once is missed when he is gone."""
        self._seen_s = self._now_s()

    def deserted(self) -> str:
        """Why the scan is given up; empty while somebody is there."""
        now_s = self._now_s()
        if now_s - self._touched_s > _ABANDONED_S:
            return "abandoned: no operator was there for a quarter of an hour"
        if self._seen_s is not None and now_s - max(self._seen_s, self._touched_s) > _UNSEEN_S:
            return "abandoned: no browser that may go on with it was there for five minutes"
        return ""
