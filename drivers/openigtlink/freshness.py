"""Tracks whether a server sends anything new about the probe, and for how long it has not."""

import math
import statistics
from collections import deque

import numpy as np

from probewatch.drivers.samples import Matrix4
from probewatch.drivers.trackers.staleness import FROZEN_READINGS, SLOWEST_PERIOD_NS, STALE_PERIODS

_LEAST_WAIT_NS = 60_000_000
"""Time without a new transform before the pose is missing, however fast the tracker is, ns: servers forward
measurements in bursts of their own loop (PLUS every 20 ms or so), and a repeated TCP segment takes the network tens of
milliseconds. More lets an old pose stand longer; less calls a burst a loss of sight. Not measured on a server.
"""

_STEPS = 15
"""Newest steps of time whose median is the period: a quarter of a second at 60 Hz. Fewer follow single bursts; more
take longer to follow a change of the rate.
"""


class Freshness:
    """Tracks the measurements of the probe. count: index of the newest one, -1 before the first. repeats: whether the
    server sent the last one again. frozen: why equal poses in a row are not trusted, empty while they change.
    """

    def __init__(self, now_ns: int) -> None:
        self.count = -1
        self.repeats = False
        self.frozen = ""
        self._new_ns = self._reported_ns = now_ns
        self._time_ns: int | None = None
        self._matrix: Matrix4 | None = None
        self._equal = 0
        self._steps_ns: deque[int] = deque(maxlen=_STEPS)

    @property
    def rate_hz(self) -> float:
        """Returns the rate of new measurements; NaN before the second one."""
        return 1e9 / statistics.median(self._steps_ns) if self._steps_ns else math.nan

    @property
    def due_ns(self) -> int:
        """Returns when the report that there is nothing new is due."""
        return max(self._new_ns + self._wait_ns, self._reported_ns + self._period_ns)

    def take(self, time_ns: int, matrix: Matrix4 | None, now_ns: int) -> bool:
        """Returns whether a measurement is new. time_ns: the sender's, 0 where it sends none and all are new."""
        if time_ns and time_ns == self._time_ns:
            self.repeats = True
            return False
        if self.count >= 0:
            step_ns = time_ns - self._time_ns if time_ns and self._time_ns else now_ns - self._new_ns
            if 0 < step_ns < SLOWEST_PERIOD_NS * STALE_PERIODS:
                self._steps_ns.append(step_ns)
        repeated = matrix is not None and self._matrix is not None and np.array_equal(matrix, self._matrix)
        self._equal = self._equal + 1 if repeated else 0
        still = self._equal >= FROZEN_READINGS - 1
        self.frozen = f"{FROZEN_READINGS} poses in a row are equal to the last bit" if still else ""
        self._matrix, self._time_ns, self._new_ns = matrix, time_ns, now_ns
        self.count += 1
        self.repeats = False
        return True

    def overdue(self, now_ns: int) -> bool:
        """Returns whether the report that there is nothing new is due. If so, it counts as made."""
        if now_ns < self.due_ns:
            return False
        self._reported_ns = now_ns
        return True

    @property
    def _period_ns(self) -> int:
        return round(statistics.median(self._steps_ns)) if self._steps_ns else round(SLOWEST_PERIOD_NS)

    @property
    def _wait_ns(self) -> int:
        return max(STALE_PERIODS * self._period_ns, _LEAST_WAIT_NS)
