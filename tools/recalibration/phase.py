"""Defines the phases of a live recalibration, and tracks whether anybody who may go on with it is still there."""

import time
from collections.abc import Callable
from enum import StrEnum

_ABANDONED_S = 900.0
"""Seconds without anybody at the page or the terminal before a scan is given up: a quarter of an hour in which the cart
cannot be used. Longer keeps it from everybody; shorter loses a scan to a telephone call.
"""
_UNSEEN_S = 300.0
"""Seconds without any browser that may go on before a scan begun by one is given up: a tablet that has fallen asleep,
or was carried off, is back by then. Longer blocks the cart for nobody. Not measured.
"""


class Phase(StrEnum):
    """Names the phases of the procedure."""

    IDLE = "idle"
    LATENCY = "latency"
    SCANNING = "scanning"
    REVIEW = "review"
    CHECKING = "checking"
    PROVING = "proving"
    DONE = "done"
    ENDED = "ended"


LISTENING = (Phase.LATENCY, Phase.SCANNING, Phase.CHECKING)
"""Phases in which samples are taken."""
HELD = (*LISTENING, Phase.REVIEW)
"""Phases in which the service has to recalibrate, and nothing has been taken yet."""
OPEN = (*HELD, Phase.PROVING)
"""Phases in which a recalibration is going on: nobody may begin another one."""


class Attendance:
    """Tracks who was there, and when last. now_s: a clock in seconds."""

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s, self._touched_s = now_s, now_s()
        self._seen_s: float | None = None

    def begin(self) -> None:
        """Records that somebody begins a scan, which no browser has shown yet."""
        self._seen_s = None
        self.touch()

    def touch(self) -> None:
        """Records that somebody is there who may go on with the scan."""
        self._touched_s = self._now_s()

    def look_on(self) -> None:
        """Records that a browser that may go on with the scan shows it. From then on, the absence of one counts."""
        self._seen_s = self._now_s()

    def deserted(self) -> str:
        """Returns why the scan is given up; empty while somebody is there."""
        now_s = self._now_s()
        if now_s - self._touched_s > _ABANDONED_S:
            return "abandoned: no operator was there for a quarter of an hour"
        if self._seen_s is not None and now_s - max(self._seen_s, self._touched_s) > _UNSEEN_S:
            return "abandoned: no browser that may go on with it was there for five minutes"
        return ""
