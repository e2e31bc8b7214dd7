"""Detects that tracker and picture drift apart in the plane, in .5 s or 5 s, as where a body gives way to a hand.

Moving tissue looks the same, so the detector names nothing: what was shown before no longer counts, and new motion
decides. It learns what is usual, including breathing and a late tracker. It sees nothing out of the plane.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from probewatch.appliance.core.detectors.detector import Detector
from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration, Check
from probewatch.drivers.rigid import Array, inverse, rigid, vector_from_rotation
from probewatch.drivers.samples import Matrix4

SLIPS_S = (0.5, 5.0)
"""s over which the line compares: for a clamp that gives way to a push, and for one that creeps. Not varied."""
_SHARE = 0.75
"""Share of the limits of offset and rotation below which nothing is doubted. A lower one opens the contact whenever a
breath begins after a pause (2.5 mm in half a second, `tools/study/session.py`); a higher one sees slips only beyond
their limit."""
_USUAL, _MEMORY, _LEARNED = 5.0, 20.0, 4.0
"""Multiple of the usual disagreement (RMS) that is doubted; how long disagreement counts as usual, and how long it is
learned before anything is doubted, both in multiples of the time over which it adds up. A lower multiple opens the
contact with breathing patients; a higher one sees nothing in them. At 5 no session of docs/alarms.md was doubted; no
rate was derived, because breaths have no known distribution."""

_LASTING = 3
"""Pictures in a row that must disagree: a torn or shifted one is recognised by the next two, which are where they were.
More take longer."""


@dataclass(frozen=True, slots=True, eq=False)
class _Apart:
    """Holds the difference of the paths by tracker and picture since the sums began.

    way: (3,) lateral mm, axial mm, rad.
    """

    t_ns: int
    way: Array


class SlowSlip(Detector):
    """Compares the path of the picture plane by poses and X with that by registration.

    over_s: s over which disagreement adds up. A longer time sees slower slips, and more of the tissue's own motion.
    """

    def __init__(self, limits: Limits, reference: Calibration, over_s: float) -> None:
        self._over_s = over_s
        self._X = rigid(reference.rotation, reference.offset_mm)
        self._back = inverse(self._X)
        self._least = _SHARE * np.array([limits.offset_mm, limits.offset_mm, np.deg2rad(limits.rotation_deg)])
        self._usual, self._learned_s = np.zeros(3), 0.0
        self._pose: Matrix4 | None = None
        self._sums: deque[_Apart] = deque()
        self._latest: deque[tuple[float, Array]] = deque()
        self._latest_s = 0.0
        self._beyond = 0

    def see(self, seen: Observation) -> bool:
        """See Detector. Returns True where the two have drifted apart by more than is usual."""
        if seen.repeated:
            return False
        if seen.pose is None or seen.moved is None or self._pose is None:
            self._restart()
            self._pose = seen.pose
            return False
        step = self._X @ inverse(self._pose) @ seen.pose @ self._back
        self._pose = seen.pose
        predicted = np.array([step[0, 3], step[1, 3], vector_from_rotation(step[:3, :3])[2]])
        before = self._sums[-1].way if self._sums else np.zeros(3)
        self._sums.append(_Apart(seen.t_ns, before + predicted - seen.moved))
        return self._drifted()

    def pause(self, t_ns: int) -> None:
        """See Detector."""
        self._restart()

    def forget_pictures(self, since_ns: int) -> None:
        """See Detector."""
        self._restart()

    def forget_poses(self, since_ns: int) -> None:
        """See Detector."""
        self._restart()

    def checks(self) -> tuple[Check, ...]:
        """Returns no checks, because the detector names no fault."""
        return ()

    def _restart(self) -> None:
        self._pose = None
        self._sums.clear()
        self._latest.clear()
        self._latest_s = 0.0
        self._beyond = 0

    def _drifted(self) -> bool:
        now, over_ns = self._sums[-1], self._over_s * 1e9
        if now.t_ns - self._sums[0].t_ns < over_ns:
            return False
        while len(self._sums) > 1 and now.t_ns - self._sums[1].t_ns >= over_ns:
            self._sums.popleft()
        apart = now.way - self._sums[0].way
        beyond = np.any(np.abs(apart) > np.maximum(self._least, _USUAL * np.sqrt(self._usual)))
        self._beyond = self._beyond + 1 if beyond and self._learned_s >= _LEARNED * self._over_s else 0
        drifted = self._beyond == _LASTING
        self._learn((now.t_ns - self._sums[-2].t_ns) / 1e9, apart)
        if drifted:
            # What is usual is learned again: doubts in a row would leave no motion to name a fault from.
            self._restart()
            self._learned_s = 0.0
        return drifted

    def _learn(self, taken_s: float, apart: Array) -> None:
        """Learns the usual disagreement from what is older than the sums, so that no slip hides itself."""
        self._latest.append((taken_s, apart))
        self._latest_s += taken_s
        if self._latest_s < self._over_s:
            return
        taken_s, apart = self._latest.popleft()
        self._latest_s -= taken_s
        self._learned_s += taken_s
        share = min(taken_s / min(self._learned_s, _MEMORY * self._over_s), 1.0)
        self._usual += share * (np.square(apart) - self._usual)
