"""Sees the marker body jump on the probe: the tracker leaps, the picture does not.

A probe in a hand cannot leap. Where the tracker does, between two readings, and the picture, which that leap ought to
have moved or changed through X, shows none of it, it was the marker body that moved: bent (it turned) or slid (it only
shifted). Leaps add up, so one that is undone is forgiven; an outlier, which leaps out and back, is none.

A tracker's camera that is bumped, or pose times that swing by a tenth of a second, leap alike: the operator's text
names both. After a bump motion verifies again, and forgives the leap; poses relative to a reference tool do not leap.

Four kinds name nothing, but what was shown before them counts no more: a leap that no picture witnesses; one beyond a
limit that a hand could have gone while the tracker was away for a moment, and that the pictures do not show; a step as
far between two readings of a slow or flickering tracker, where nothing shows how the hand went; and a leap to a place
of before from which the path goes on as it went then: poses that suddenly come late do that, and a body that slips does
not.
"""

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import hypot, log, sqrt

import numpy as np

from probewatch.appliance.core.detectors.body_slip import ALIKE, DENIED, LAGS_NS, SHIFT_NS, BodySlip, extent
from probewatch.appliance.core.detectors.leap import Leap, around_step, fit_leap, retraced, uneven_step
from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.core.times import MOST_APART_NS
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration, Check, Fault, VerdictKind
from probewatch.drivers.rigid import Array, inverse, vector_from_rotation
from probewatch.drivers.samples import Matrix4

REPORTS_FAULTS = (Fault.ROTATION, Fault.OFFSET)

_LEAST_MM, _LEAST_RAD = 1.0, np.deg2rad(0.75)
"""Smallest leap that is added up, a quarter of its limit. A smaller one lets noise of .25 mm wake the fit at every
reading; a larger one loses slips in small steps. Markers that are covered let a fit leap by 1 to 2 mm, and back."""
_FAST_MM_PER_S, _FAST_RAD_PER_S = 60.0, np.deg2rad(45.0)
"""How much faster a hand may suddenly go. More hides leaps: at 20 poses a second, 3 mm of each are taken for a hand. In
the longest gap that is bridged it is 15 mm, so there no leap beyond a limit passes that the pictures do not show.
"""
_HISTORY_NS = 250_000_000
"""What went before a leap, for what the hand does usually. Longer takes a turn of the hand for its straight course."""
_SMOOTH_NS = 700_000_000
"""Longest path in which a leap is looked for that a hand could have gone while the tracker was away: what went before,
gap, and what comes after. With more, a gesture read five times a second was doubted twice a minute for nothing; with
less, so is no leap in a longer gap (paths without pictures, two seeds)."""
_LEAST_STEPS = 4
"""Before a leap is looked for: fewer do not show what the hand does usually, and more are lost after each gap."""
_STAYS_NS = 100_000_000
"""How long the marker must stay where it leapt to: an outlier of two poses at 20 Hz is over by then."""
_CERTAIN = 8.0
"""Sigmas by which a leap is one. Noise alone reaches them once in 1000 h of 60 fits a second of six rows (Student's t
of 40 degrees of freedom, by calculation); with less, a .25 mm tracker alarms for nothing, with more it misses slides of
4 mm. Tails heavier than that widen the sigma, which is of the same readings."""
_FLOOR = np.repeat([0.03, np.deg2rad(0.01)], 3)
"""mm and rad: least scatter of a reading, as of the best optical trackers. Less trusts a window that happens to fit."""
_PIECES, _ON_ITS_WAY_NS = 3, 35_000_000
"""Readings, and time, that may lie on the way: a clamp that gives way is through in 50 ms. More takes a quick hand for
it. One reading may in any case: of a slow tracker two steps in a row were none."""
_LEAST_AFTER = 3
"""Readings from the leap on, before it is given up: one on the way, and two that show where the hand goes then."""
_USUAL, _MEMORY_S = 2.5, 1.0
"""How many times the usual difference from a steady course is odd, and for how long differences count as usual. Less
spends a fit on every reading of a tracker of .25 mm, more hides slips at 20 Hz in a lively hand."""
_PAST_NS = 1_200_000_000
"""Path that a leap may repeat: lags of 1 s are named (`appliance.core.path.explanation`), a leap takes .1 s more."""
_RETRACED = 4.0
"""Mean square of what a path differs from an earlier part of itself, in that of noise, up to which it repeats it. Of
poses that fell back by .1 to .8 s it was .1 to 1.1, of slips by 5 mm or 3.5° 90 and more (60 each, in-plane and gesture
of the study, seed 1). Less names late poses as slips, more doubts slips without naming them."""


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """A picture. moved: (3,) way of the picture plane since the one before, mm, mm, rad; None for one that is no
    witness."""

    t_ns: int
    moved: Array | None
    likeness: float

    @property
    def away_mm(self) -> float:
        """How far out of the plane its keyframe's is by their likeness exp(−d²/2): rather more than the true way up to
        .75 mm, less beyond 1 mm (tests/appliance/core/registration/test_registration.py)."""
        return sqrt(-2 * log(max(self.likeness, ALIKE)))


class MarkerSlip(BodySlip):
    """Sums the leaps of the marker body in its own axes: B' = B · D.

    Leaps are looked for between poses, not between the poses of pictures: those are interpolated, so that one leap
    would be spread over two of them and each half taken for the hand's.
    """

    def __init__(self, limits: Limits, reference: Calibration) -> None:
        super().__init__(limits, reference)
        self._reach_mm = reference.scale_mm_per_px * reference.image_size_px / np.sqrt(12)
        self._track: deque[tuple[int, Matrix4]] = deque()
        self._past: deque[tuple[int, Matrix4]] = deque()
        self._pictures: deque[_Seen] = deque()
        self._slip = np.eye(4)
        self._usual = np.zeros(2)
        self._leapt_ns: int | None = None
        self._before_ns = 0

    def see(self, seen: Observation) -> bool:
        """See Detector; True also for a leap that no picture witnessed, and for poses that fell back."""
        if seen.repeated:
            return False
        witness = seen.moved is not None and seen.likeness >= ALIKE
        self._pictures.append(_Seen(seen.t_ns, seen.moved if witness else None, seen.likeness))
        while self._pictures[0].t_ns < seen.t_ns - 2 * (_HISTORY_NS + _STAYS_NS) - MOST_APART_NS:
            self._pictures.popleft()
        leapt = False
        while self._waiting and self._waiting[0][0] <= seen.t_ns:
            leapt |= self._weigh(*self._waiting.popleft())
        return leapt

    def pause(self, t_ns: int) -> None:
        """See Detector: forget pictures and poses so far."""
        self._pictures.clear()
        super().pause(t_ns)

    def on_verified(self, shows: Callable[[Fault], bool], until_ns: int) -> None:
        """See Detector."""
        if shows(Fault.ROTATION):
            self._slip[:3, :3] = np.eye(3)
        if shows(Fault.OFFSET):
            self._slip[:3, 3] = 0.0

    def checks(self) -> tuple[Check, ...]:
        """Turn and shift of the marker body since the reference, deg and mm; of the shift also what is across the
        picture, which motion does not recover.
        """
        shift, turn_rad = extent(self._slip)
        across = float(self._X[2, :3] @ self._slip[:3, 3])
        turn, most_mm = float(np.rad2deg(turn_rad)), self._limits.offset_mm
        bent = turn > self._limits.rotation_deg
        return (
            _check("marker-turn", Fault.ROTATION, turn, "deg", self._limits.rotation_deg, bent),
            _check("marker-shift", Fault.OFFSET, shift, "mm", most_mm, shift > most_mm and not bent),
            _check("marker-elevational", Fault.OFFSET, across, "mm", most_mm, abs(across) > most_mm and not bent),
        )

    def _restart(self) -> None:
        self._track.clear()
        self._past.clear()
        self._leapt_ns = None

    def _weigh(self, t_ns: int, matrix: Matrix4) -> bool:
        if self._track and not 0 < t_ns - self._track[-1][0] <= MOST_APART_NS:
            self._restart()
        odd = self._is_odd(t_ns, matrix)
        before_ns = self._track[-1][0] if self._track else t_ns
        self._track.append((t_ns, matrix))
        self._past.append((t_ns, matrix))
        while self._past[0][0] < t_ns - _PAST_NS:
            self._past.popleft()
        if odd and self._leapt_ns is None:
            self._leapt_ns, self._before_ns = t_ns, before_ns
        since_ns = (t_ns if self._leapt_ns is None else self._before_ns) - _HISTORY_NS
        while len(self._track) > _LEAST_STEPS + 1 and self._track[1][0] < since_ns:
            self._track.popleft()
        leapt_ns = self._leapt_ns
        if leapt_ns is None or t_ns - leapt_ns < _STAYS_NS:
            return False
        leapt = self._conclude(leapt_ns)
        if not leapt and self._track[-_LEAST_AFTER][0] < leapt_ns:
            self._leapt_ns = leapt_ns
        elif odd and not leapt:
            self._leapt_ns, self._before_ns = t_ns, before_ns
        return leapt

    def _is_odd(self, t_ns: int, matrix: Matrix4) -> bool:
        """Whether the reading is where no steady hand would have brought the marker: then it is worth a fit."""
        if not self._track:
            return False
        off = self._off_course(t_ns, matrix)
        if len(self._track) <= _LEAST_STEPS:
            return bool(np.any(off > (self._limits.offset_mm, np.deg2rad(self._limits.rotation_deg))))
        odd = off > np.maximum((_LEAST_MM, _LEAST_RAD), _USUAL * np.sqrt(self._usual))
        share = min((t_ns - self._track[-1][0]) / 1e9 / _MEMORY_S, 1.0)
        self._usual += share * (np.minimum(off, (_LEAST_MM * 2, _LEAST_RAD * 2)) ** 2 - self._usual)
        return bool(odd.any())

    def _off_course(self, t_ns: int, matrix: Matrix4) -> Array:
        """(2,) mm and rad: how far the step to this reading is from the mean velocity of the recent ones, if there is
        more than one, in sensor axes; turns are small.
        """
        (first_ns, first), (last_ns, last) = self._track[0], self._track[-1]
        step, way = last[:3, :3].T @ matrix[:3], first[:3, :3].T @ last[:3]
        share = (t_ns - last_ns) / (last_ns - first_ns) if first_ns < last_ns else 0.0
        moved = last[:3, :3].T @ (matrix[:3, 3] - last[:3, 3] - (last[:3, 3] - first[:3, 3]) * share)
        turned = _turn(step) - _turn(way) * share
        return np.array([hypot(*moved.tolist()), hypot(*turned.tolist())])

    def _conclude(self, leapt_ns: int) -> bool:
        """Weigh the leap now that it is seen whether the marker stays; True where something leapt."""
        self._leapt_ns = None
        t_ns = np.array([t for t, _ in self._track])
        after = int(np.searchsorted(t_ns, leapt_ns))
        base = self._track[after - 1][1]
        path = self._path(base, self._track)
        found, taken_ns = self._surest(t_ns, path, after)
        if found is None:
            return self._stole_away(t_ns, path, after)
        unseen = self._unseen(found.size, int(t_ns[after - 1]), leapt_ns)
        if unseen is None:
            self._leave(after)
            return True
        if not self._too_far(found.size, taken_ns):
            doubted = self._spoils(unseen)
            self._leave(after if doubted else 0)
            return doubted
        if not self._too_far(unseen, 0):
            return False
        if not self._falls_back(base, t_ns, path, after, found):
            self._slip = self._slip @ self._of_body(unseen)
        self._leave(after)
        return True

    def _stole_away(self, t_ns: Array, path: Array, after: int) -> bool:
        """Whether the body went beyond a limit in the step to that reading or in two, unseen, where too few readings
        before it show what the hand did. Unasked, 5 mm out of the plane within a gap of 100 ms stayed verified for
        24 s, and with a tracker of 4 to 8 Hz for as long as was looked.
        """
        if after > _LEAST_STEPS and self._smooth(t_ns):
            return False
        for to in (after, after + 1):
            if to + 1 == t_ns.size or (to > after and t_ns[to] - t_ns[after - 1] > MOST_APART_NS):
                break
            nodes = around_step(t_ns, after, to, _STAYS_NS)
            leap = uneven_step(t_ns[nodes], path[nodes])
            if not self._spoils(leap):
                continue
            unseen = self._unseen(leap, int(t_ns[after - 1]), int(t_ns[to]), t_ns[nodes])
            if unseen is None or self._spoils(unseen):
                self._leave(to)
                return True
        return False

    def _falls_back(self, base: Matrix4, t_ns: Array, path: Array, after: int, found: Leap) -> bool:
        """Whether the readings from the leap on repeat those of before it."""
        past = [reading for reading in self._past if reading[0] < t_ns[after]]
        past_s = np.array([t for t, _ in past]) / 1e9
        later_s, later = t_ns[after:] / 1e9, path[after:]
        return retraced(past_s, self._path(base, past), later_s, later, found.noise) <= _RETRACED

    def _leave(self, after: int) -> None:
        """What came before the leap says nothing of what the hand does after it."""
        for _ in range(after):
            self._track.popleft()

    def _path(self, base: Matrix4, readings: Iterable[tuple[int, Matrix4]]) -> Array:
        """(n, 6) of the picture plane against where it was at base, in its axes: mm and rad, as X and the poses say."""
        motion = self._X @ inverse(base) @ np.array([matrix for _, matrix in readings]) @ self._back
        turns = np.array([vector_from_rotation(one[:3, :3]) for one in motion])
        return np.column_stack([motion[:, :3, 3], turns])

    def _surest(self, t_ns: Array, path: Array, after: int) -> tuple[Leap | None, int]:
        """The surest of the fits without, one or two readings on the way, and the time, ns, that the leap took; None
        where none is a leap of more than a hand does, or of what the limits allow."""
        best: Leap | None = None
        best_ns = 0
        smooth = self._smooth(t_ns)
        for pieces in range(_PIECES):
            kept = np.r_[:after, after + pieces : t_ns.size]
            if pieces > 1 and (after + pieces >= t_ns.size or t_ns[after + pieces] - t_ns[after] > _ON_ITS_WAY_NS):
                break
            found = fit_leap(t_ns[kept] / 1e9, path[kept], after, _FLOOR)
            if found is None or found.certain < _CERTAIN or not found.clean:
                continue
            taken_ns = int(t_ns[kept][after] - t_ns[after - 1])
            if not (self._too_far(found.size, taken_ns) or (smooth and self._spoils(found.size))):
                continue
            if best is None or found.certain > best.certain:
                best, best_ns = found, taken_ns
        return best, best_ns

    @staticmethod
    def _smooth(t_ns: Array) -> bool:
        """Whether the readings are near enough to recognise a leap that a hand could have gone."""
        return bool(t_ns[-1] - t_ns[0] <= _SMOOTH_NS)

    def _too_far(self, size: Array, taken_ns: int) -> bool:
        """Whether the marker went further than a hand may suddenly go in that time."""
        moved_mm, turned_rad = extent(self._of_body(size))
        taken_s = taken_ns / 1e9
        return moved_mm > max(_LEAST_MM, _FAST_MM_PER_S * taken_s) or turned_rad > max(
            _LEAST_RAD, _FAST_RAD_PER_S * taken_s
        )

    def _unseen(self, size: Array, before_ns: int, leapt_ns: int, nodes_ns: Array | None = None) -> Array | None:
        """(6,) what of a leap between two readings the pictures do not show; None where they are not enough. nodes_ns:
        (4,) times of the readings from which alone it is known.
        """
        since_ns = before_ns - SHIFT_NS
        around = [one for one in self._pictures if since_ns <= one.t_ns <= leapt_ns + SHIFT_NS]
        if len(around) < 2 or any(one.moved is None for one in around):
            return None
        left = size.copy()
        wanted = size[[0, 1, 5]]
        left[[0, 1, 5]] -= (
            self._seen_leap(wanted, before_ns, leapt_ns) if nodes_ns is None else self._seen_step(wanted, nodes_ns)
        )
        out_mm = hypot(size[2], size[3] * self._reach_mm[1], size[4] * self._reach_mm[0])
        before = [one.away_mm for one in self._pictures if since_ns - 2 * _HISTORY_NS <= one.t_ns < since_ns]
        shown_mm = max(one.away_mm for one in around) - max(before, default=0.0)
        if shown_mm > DENIED * out_mm:
            left[2:5] = 0.0
        return left

    def _seen_leap(self, wanted: Array, before_ns: int, leapt_ns: int) -> Array:
        """(3,) leap of the picture near that time that is most like the wanted one; nothing where that is nearer. Its
        way is what the tracker could see of it: nothing for as long as no reading came.
        """
        since_ns, away_ns = before_ns - _HISTORY_NS - SHIFT_NS / 2, leapt_ns - before_ns
        pictures = [one for one in self._pictures if one.t_ns >= since_ns]
        moved = [np.zeros(3) if one.moved is None else one.moved for one in pictures]
        path = np.cumsum(moved, axis=0)
        t_ns = np.array([one.t_ns for one in pictures])
        best = np.zeros(3)
        for after in np.flatnonzero(np.abs(t_ns - leapt_ns) <= SHIFT_NS):
            seen = (t_ns <= t_ns[after] - away_ns) | (t_ns >= t_ns[after])
            first = int(np.count_nonzero(seen[:after]))
            found = fit_leap(t_ns[seen] / 1e9, path[seen], first, _FLOOR[:3])
            if found is not None:
                best = self._nearer(wanted, best, found.size)
        return best

    def _seen_step(self, wanted: Array, nodes_ns: Array) -> Array:
        """(3,) the same of the picture's way at those times, or somewhat earlier or later."""
        t_ns = np.array([one.t_ns for one in self._pictures])
        path = np.cumsum([np.zeros(3) if one.moved is None else one.moved for one in self._pictures], axis=0)
        best = np.zeros(3)
        for late_ns in LAGS_NS:
            way = np.stack([np.interp(nodes_ns + late_ns, t_ns, row) for row in path.T], axis=-1)
            best = self._nearer(wanted, best, uneven_step(nodes_ns, way))
        return best

    def _nearer(self, wanted: Array, one: Array, other: Array) -> Array:
        """The one of two ways of the picture, mm, mm, rad, that is more like the wanted one."""
        reach = np.array([1.0, 1.0, hypot(*self._reach_mm)])
        apart = [np.linalg.norm((wanted - way) * reach) for way in (one, other)]
        return one if apart[0] <= apart[1] else other


def _turn(step: Array) -> Array:
    """(3,) rotation vector, rad, of a small turn."""
    return np.array([step[2, 1] - step[1, 2], step[0, 2] - step[2, 0], step[1, 0] - step[0, 1]]) / 2


def _check(name: str, fault: Fault, value: float, unit: str, limit: float, failed: bool) -> Check:
    return Check(name, fault, value, 0.0, unit, limit, VerdictKind.FAULT if failed else VerdictKind.OK)
