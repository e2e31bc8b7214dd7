"""Detects a marker body that slips in parts, in several gaps of the tracker's readings.

Each part is within what a hand could have moved meanwhile, so the parts are added up. A hand moves no faster while the
tracker is away than between the gaps, and where it leaves the plane, the likeness of the pictures to their keyframe
falls. So the detector doubts a motion beyond a limit for which the hand was too slow and which no picture shows. It
names nothing: what was shown before no longer counts.
"""

from collections import deque
from dataclasses import dataclass
from math import hypot, log, sqrt

import numpy as np

from probewatch.appliance.core.detectors.body_slip import ALIKE, DENIED, LAGS_NS, SHIFT_NS, BodySlip
from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.core.times import MOST_APART_NS
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration, Check
from probewatch.drivers.rigid import Array, inverse, vector_from_rotation
from probewatch.drivers.samples import Matrix4

_WITHIN_NS = 2_000_000_000
"""ns from the first gap to the end of the last. A longer time sees parts that are less frequent, and adds up more of
the hand's own motion. Not varied."""
_GAP, _LEAST_GAP_NS = 2.5, 45_000_000
"""Multiple of the shortest time between two readings, and least ns, beyond which there is a gap between readings. Lower
values take a single missing reading for a gap; higher ones see no slip in shorter gaps. Not varied."""
_CHUNK_NS = 100_000_000
"""ns of readings between the gaps over which each velocity of the hand is taken. A shorter time takes the noise of a
tracker for velocities; a longer one misses how fast a hand moves to and fro. Not varied."""
_LEAST_CHUNKS, _FASTER = 8, 1.5
"""Fewest such velocities that must be known, and how many times as fast a hand may move in the gaps. With lower values,
a fan of which half of the readings were missing was doubted over tissue that looks alike everywhere; with higher ones,
less is seen among many gaps, or in the first two seconds of a rest (paths without pictures, two seeds)."""
_LEAST_GAPS = 2
"""Gaps from which a slip is looked for; `MarkerSlip` handles a single one."""
_PLANE = [0, 1, 5]
"""Components, of the six of a motion, that lie in the plane."""


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """Holds the step from one reading to the next.

    way: (6,) motion of the picture plane in its own axes, by X and the poses, mm and rad.
    """

    since_ns: int
    t_ns: int
    before: Matrix4
    after: Matrix4
    way: Array

    @property
    def taken_ns(self) -> int:
        return self.t_ns - self.since_ns


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """Holds a picture that was followed. moved: as in `Observation`."""

    t_ns: int
    moved: Array
    likeness: float
    keyframe: int


class SplitSlip(BodySlip):
    """Adds up by how much the tracker moved in the gaps beyond the hand's velocity between them."""

    def __init__(self, limits: Limits, reference: Calibration) -> None:
        super().__init__(limits, reference)
        height_mm, width_mm = (reference.scale_mm_per_px * reference.image_size_px / np.sqrt(12))[::-1]
        self._reach_mm = np.array([1.0, height_mm, width_mm])
        self._last: tuple[int, Matrix4] | None = None
        self._steps: deque[_Step] = deque()
        self._pictures: deque[_Seen] = deque()
        self._best = 0.0

    def see(self, seen: Observation) -> bool:
        """See Detector. Returns True where the parts add up to more than a limit."""
        if seen.repeated:
            return False
        if seen.moved is None or seen.likeness < ALIKE:
            self._restart()
            return False
        self._best = max(self._best, seen.likeness)
        self._pictures.append(_Seen(seen.t_ns, seen.moved, seen.likeness, seen.keyframe))
        while self._pictures[0].t_ns < seen.t_ns - _WITHIN_NS - 3 * SHIFT_NS:
            self._pictures.popleft()
        doubted = False
        while self._waiting and self._waiting[0][0] <= seen.t_ns - SHIFT_NS:
            doubted |= self._take(*self._waiting.popleft())
        if doubted:
            self._restart()
        return doubted

    def checks(self) -> tuple[Check, ...]:
        """Returns no checks, because the detector names no fault."""
        return ()

    def _restart(self) -> None:
        self._last = None
        self._steps.clear()
        self._pictures.clear()
        self._best = 0.0

    def _take(self, t_ns: int, matrix: Matrix4) -> bool:
        """Returns whether the motion up to this reading is doubted."""
        last, self._last = self._last, (t_ns, matrix)
        if last is None:
            return False
        if not 0 < t_ns - last[0] <= MOST_APART_NS:
            self._steps.clear()
            return False
        self._steps.append(_Step(last[0], t_ns, last[1], matrix, self._way(last[1], matrix)))
        while self._steps[0].since_ns < t_ns - _WITHIN_NS:
            self._steps.popleft()
        least_ns = max(_LEAST_GAP_NS, _GAP * min(step.taken_ns for step in self._steps))
        return self._steps[-1].taken_ns > least_ns and self._slipped(least_ns)

    def _slipped(self, least_ns: float) -> bool:
        """Returns whether the gaps, from one of them on, add up to more than a limit that the pictures do not show.

        least_ns: time, ns, that every gap exceeds.
        """
        gaps = [step for step in self._steps if step.taken_ns > least_ns]
        velocities = _velocities([step for step in self._steps if step.taken_ns <= least_ns])
        if len(gaps) < _LEAST_GAPS or len(velocities) < _LEAST_CHUNKS:
            return False
        known = np.concatenate([velocities, _FASTER * velocities])
        slowest, fastest = known.min(axis=0), known.max(axis=0)
        # The gaps are added up backwards from the latest; what the hand's velocities explain does not count.
        way, taken_ns = gaps[-1].way, gaps[-1].taken_ns
        for since in range(len(gaps) - 2, -1, -1):
            way, taken_ns = way + gaps[since].way, taken_ns + gaps[since].taken_ns
            beyond = way - np.clip(way, slowest * taken_ns, fastest * taken_ns)
            if not self._spoils(beyond) or not self._denied(gaps[since], self._steps[-1]):
                continue
            beyond[_PLANE] = self._unseen(way[_PLANE], gaps[since:])
            if self._spoils(beyond):
                return True
        return False

    def _denied(self, first: _Step, last: _Step) -> bool:
        """Returns whether the pictures left the plane by much less than the tracker did from one step to the other.

        Two pictures are no further apart than the sum of their distances from their keyframe; where there are several
        keyframes, the distances add up.
        """
        since_ns, until_ns = first.since_ns - SHIFT_NS, last.t_ns + SHIFT_NS
        if not self._pictures or self._pictures[0].t_ns > since_ns:
            return False
        away_mm: dict[int, float] = {}
        for one in self._pictures:
            if since_ns <= one.t_ns <= until_ns:
                away_mm[one.keyframe] = max(away_mm.get(one.keyframe, 0.0), self._away_mm(one))
        way = self._way(first.before, last.after)
        return 2 * sum(away_mm.values()) < DENIED * float(np.linalg.norm(way[2:5] * self._reach_mm))

    def _away_mm(self, one: _Seen) -> float:
        """Returns the distance out of its keyframe's plane, mm, by their likeness exp(−d²/2) relative to the best."""
        return sqrt(2 * log(self._best / one.likeness))

    def _unseen(self, way: Array, gaps: list[_Step]) -> Array:
        """Returns the part, (3,), of a motion in the plane that the pictures do not show in these gaps.

        It is taken at the lag at which it is least.
        """
        t_ns = np.array([one.t_ns for one in self._pictures])
        path = np.cumsum([one.moved for one in self._pictures], axis=0)
        ends_ns = np.array([(gap.since_ns, gap.t_ns) for gap in gaps])
        reach, least = np.array([1.0, 1.0, hypot(*self._reach_mm[1:])]), way
        for late_ns in LAGS_NS:
            left = way - [np.diff(np.interp(ends_ns + late_ns, t_ns, row)).sum() for row in path.T]
            if np.linalg.norm(left * reach) < np.linalg.norm(least * reach):
                least = left
        return least

    def _way(self, before: Matrix4, after: Matrix4) -> Array:
        motion = self._X @ inverse(before) @ after @ self._back
        return np.concatenate([motion[:3, 3], vector_from_rotation(motion[:3, :3])])


def _velocities(steps: list[_Step]) -> Array:
    """Returns the velocities of the picture plane, (n, 6) mm and rad per ns, each over .1 s or more of these steps."""
    found, way, taken_ns = [], np.zeros(6), 0
    for step in steps:
        way, taken_ns = way + step.way, taken_ns + step.taken_ns
        if taken_ns >= _CHUNK_NS:
            found.append(way / taken_ns)
            way, taken_ns = np.zeros(6), 0
    return np.array(found)
