"""Sees the marker body jump on the probe: the tracker leaps, the picture does not.

A probe in a hand cannot leap. Where the tracker moves far between two poses while the picture shows an ordinary step,
it was the marker body that moved: bent (it turned) or slid (it only shifted). Leaps add up, so one that is undone is
forgiven; an outlier, which leaps out and back, sums to nothing.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from math import hypot

import numpy as np

from appliance.core.acquisition.pairing import MOST_APART_NS
from appliance.core.detectors.detector import Detector, Observation
from appliance.core.path.window import sensor_jump
from appliance.limits import Limits
from appliance.types import Check, Fault, VerdictKind
from drivers.rigid import angle_from_rotation, inverse
from drivers.samples import Matrix4, Pose

_LEAST_MM, _LEAST_RAD = 2.5, np.deg2rad(2.0)
"""Smallest leap. A marker that is covered for a moment lets a rigid fit jump by 1 to 2 mm; an offset limit is 4 mm."""
_FAST_MM_PER_S, _FAST_RAD_PER_S = 60.0, np.deg2rad(45.0)
"""How much faster a hand may suddenly go. More hides leaps: at 20 poses a second, 3 mm of each are taken for a hand."""
_HISTORY_NS = 250_000_000
"""What went before a leap, for what the hand does usually. Longer takes a turn of the hand for its straight course."""
_LEAST_STEPS = 4
"""Before a leap is looked for: fewer do not tell what the hand does usually, and more are lost after each gap."""
_STAYS_NS = 100_000_000
"""How long the marker must stay where it leapt to: an outlier of two poses at 20 Hz is over by then."""
_SHARED, _LIVELY = 1.5, 2.0
"""How much more than the picture shows, and than the hand did before, is still no leap: the picture shows two of three
directions, and the liveliest step of a quarter of a second may be outdone."""
_MOST_WAITING = 2_000
"""Poses that wait for a picture to testify, 5 s of the fastest tracker; later they are forgotten."""


@dataclass(frozen=True, slots=True, eq=False)
class _Leap:
    """moved_mm, turned_rad: how far the first pose lay from where the sensor would have been at t_ns without it."""

    t_ns: int
    moved_mm: float
    turned_rad: float

    def undone(self, moved_mm: float, turned_rad: float) -> bool:
        """Whether less than half of it is left."""
        return moved_mm < self.moved_mm / 2 and turned_rad < max(self.turned_rad, _LEAST_RAD) / 2


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """The sensor at t_ns, and how far it came from the pose taken_ns before: mm and rad, 0 for the first."""

    t_ns: int
    matrix: Matrix4
    taken_ns: int = 0
    moved_mm: float = 0.0
    turned_rad: float = 0.0


class MarkerSlip(Detector):
    """Sums the leaps of the marker body in its own axes: B' = B · D.

    Leaps are looked for between poses, not between the poses of pictures: those are interpolated, so that one leap
    would be spread over two of them and each half taken for the hand's.
    """

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._waiting: deque[tuple[int, Matrix4]] = deque(maxlen=_MOST_WAITING)
        self._recent: deque[_Step] = deque()
        self._slip = np.eye(4)
        self._pending: _Leap | None = None

    def pose(self, pose: Pose) -> None:
        """See Detector; it waits for a picture of its time."""
        assert pose.matrix is not None
        self._waiting.append((pose.stamp.t_ns, pose.matrix))

    def see(self, seen: Observation) -> bool:
        """See Detector; only a picture that was well followed can testify against the tracker."""
        if seen.repeated:
            return False
        if seen.step_mm is None:
            self.pause(seen.t_ns)
            return False
        return self.step(seen.t_ns, float(np.hypot(*seen.step_mm)))

    def pause(self, t_ns: int) -> None:
        """See Detector: forget the poses so far."""
        self._recent.clear()
        self._pending = None
        while self._waiting and self._waiting[0][0] <= t_ns:
            self._waiting.popleft()

    def forget_pictures(self, since_ns: int) -> None:
        """See Detector."""
        self.pause(since_ns)

    def forget_poses(self, since_ns: int) -> None:
        """See Detector; the poses before are forgotten as well."""
        self._recent.clear()
        self._waiting.clear()
        self._pending = None

    def step(self, t_ns: int, seen_mm: float) -> bool:
        """Take a picture that could be followed and weigh the poses up to its time; True when a leap was confirmed.

        seen_mm: how far the picture moved since the one before. What it shares with the tracker is no leap.
        """
        confirmed = False
        while self._waiting and self._waiting[0][0] <= t_ns:
            confirmed |= self._weigh(*self._waiting.popleft(), seen_mm)
        return confirmed

    def forgive(self, shows: Callable[[Fault], bool]) -> None:
        """See Detector."""
        if shows(Fault.ROTATION):
            self._slip[:3, :3] = np.eye(3)
        if shows(Fault.OFFSET):
            self._slip[:3, 3] = 0.0

    def checks(self) -> tuple[Check, ...]:
        """Turn and shift of the marker body since the reference, deg and mm."""
        shift, turn_rad = _extent(self._slip)
        turn = float(np.rad2deg(turn_rad))
        bent, slid = turn > self._limits.rotation_deg, shift > self._limits.offset_mm
        return (
            _check("marker-turn", Fault.ROTATION, turn, "deg", self._limits.rotation_deg, bent),
            _check("marker-shift", Fault.OFFSET, shift, "mm", self._limits.offset_mm, slid and not bent),
        )

    def _weigh(self, t_ns: int, matrix: Matrix4, seen_mm: float) -> bool:
        if self._pending is not None:
            return self._confirm(self._pending, t_ns, matrix)
        if self._recent and not 0 < t_ns - self._recent[-1].t_ns <= MOST_APART_NS:
            self._recent.clear()
        if len(self._recent) > _LEAST_STEPS:
            self._pending = self._leap(t_ns, matrix, seen_mm)
        if self._pending is not None:
            return False
        self._recent.append(self._step_to(t_ns, matrix))
        while len(self._recent) > _LEAST_STEPS + 1 and t_ns - self._recent[1].t_ns > _HISTORY_NS:
            self._recent.popleft()
        return False

    def _step_to(self, t_ns: int, matrix: Matrix4) -> _Step:
        if not self._recent:
            return _Step(t_ns, matrix)
        before = self._recent[-1]
        return _Step(t_ns, matrix, t_ns - before.t_ns, *_extent(sensor_jump(before.matrix, matrix)))

    def _leap(self, t_ns: int, matrix: Matrix4, seen_mm: float) -> _Leap | None:
        """The newest step against the usual ones before it; None where a hand may have made it."""
        dt_ns = t_ns - self._recent[-1].t_ns
        dt_s = dt_ns / 1e9
        moved_mm, turned_rad = _extent(sensor_jump(self._expected(t_ns), matrix))
        usual_mm, usual_rad = self._liveliest_step(dt_ns)
        far = moved_mm > max(_LEAST_MM, _FAST_MM_PER_S * dt_s) + _SHARED * seen_mm + _LIVELY * usual_mm
        turned = turned_rad > max(_LEAST_RAD, _FAST_RAD_PER_S * dt_s) + _LIVELY * usual_rad
        return _Leap(t_ns, max(moved_mm, _LEAST_MM), turned_rad) if far or turned else None

    def _liveliest_step(self, dt_ns: int) -> tuple[float, float]:
        """What the liveliest of the recent steps would be over dt_ns, mm and rad: a probe in full swing may well turn
        round."""
        steps = [(step, max(dt_ns / step.taken_ns, 1.0)) for step in islice(self._recent, 1, None)]
        return max(one.moved_mm * by for one, by in steps), max(one.turned_rad * by for one, by in steps)

    def _expected(self, t_ns: int) -> Matrix4:
        """The latest pose carried on with the mean velocity of the recent ones, in sensor axes."""
        oldest, latest = self._recent[0], self._recent[-1]
        step = np.eye(4)
        share = (t_ns - latest.t_ns) / (latest.t_ns - oldest.t_ns)
        step[:3, 3] = (inverse(oldest.matrix) @ latest.matrix)[:3, 3] * share
        expected: Matrix4 = latest.matrix @ step
        return expected

    def _confirm(self, leap: _Leap, t_ns: int, matrix: Matrix4) -> bool:
        """A leap counts once the marker has stayed where it leapt to, beside the way that the hand goes on."""
        found = sensor_jump(self._expected(t_ns), matrix)
        if leap.undone(*_extent(found)):
            self._pending = None
            return False
        if t_ns - leap.t_ns < _STAYS_NS:
            return False
        self._slip = self._slip @ found
        self._pending = None
        self._recent.clear()
        return True


def _extent(step: Matrix4) -> tuple[float, float]:
    """Length mm and angle rad of a rigid step."""
    return hypot(*step[:3, 3].tolist()), angle_from_rotation(step[:3, :3])


def _check(name: str, fault: Fault, value: float, unit: str, limit: float, failed: bool) -> Check:
    return Check(name, fault, value, 0.0, unit, limit, VerdictKind.FAULT if failed else VerdictKind.OK)
