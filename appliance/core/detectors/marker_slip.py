"""Detects that the marker body jumps on the probe: the tracker leaps, the picture does not.

A probe in a hand cannot leap. Where the tracker leaps between two readings, and the picture shows nothing of what
should have moved or changed it through X, the marker body has moved: it was bent (it turned) or slid (it only shifted).
Leaps add up, so one that is undone is forgiven; an outlier, which leaps out and back, does not count.

A bumped camera of the tracker, or pose times that swing by a tenth of a second, cause the same leaps: the operator's
text names both. After a bump, motion verifies again and forgives the leap; poses relative to a reference tool do not
leap.

Four kinds of leap name nothing, but discard what was shown before them: a leap that no picture witnesses; one beyond a
limit that a hand could have made while the tracker was away for a moment, and that the pictures do not show; a step as
large between two readings of a slow or flickering tracker, where nothing shows how the hand moved; and a leap to an
earlier place from which the path goes on as it did then: poses that suddenly come late do that, a body that slips does
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
"""Smallest leap that is added up, mm and rad, a quarter of its limit. A smaller one lets noise of .25 mm cause a fit at
every reading; a larger one loses slips in small steps. Covered markers make the pose leap by 1 to 2 mm, and back."""
_FAST_MM_PER_S, _FAST_RAD_PER_S = 60.0, np.deg2rad(45.0)
"""Sudden change of a hand's velocity that is possible. Higher values hide leaps: at 20 poses a second, 3 mm of each
leap are taken for the hand. In the longest gap that is bridged it is 15 mm, so a leap beyond a limit passes there only
if the pictures show it."""
_HISTORY_NS = 250_000_000
"""ns before a leap that show what the hand usually does. A longer time takes a turn of the hand for its straight
course."""
_SMOOTH_NS = 700_000_000
"""ns, longest path (what precedes the gap, the gap, and what follows it) in which a leap is looked for that a hand
could have made while the tracker was away. With a longer one, a gesture read five times a second was doubted twice a
minute for nothing; with a shorter one, no leap in a longer gap is doubted (paths without pictures, two seeds)."""
_LEAST_STEPS = 4
"""Fewest steps before a leap is looked for: fewer do not show what the hand usually does; if more are required, more
are lost after each gap."""
_STAYS_NS = 100_000_000
"""ns for which the marker must stay where it leapt to: an outlier of two poses at 20 Hz is over by then."""
_CERTAIN = 8.0
"""Sigmas from which a leap is certain. Noise alone reaches them once in 1000 h of 60 fits a second of six rows
(Student's t with 40 degrees of freedom, by calculation). With fewer, a tracker of .25 mm alarms for nothing; with more,
slides of 4 mm are missed. Heavier tails widen the sigma, which comes from the same readings."""
_FLOOR = np.repeat([0.03, np.deg2rad(0.01)], 3)
"""mm and rad, least scatter of a reading, that of the best optical trackers. A lower one trusts a window that happens
to fit."""
_PIECES, _ON_ITS_WAY_NS = 3, 35_000_000
"""Fits, with none, one and two readings on the way of the leap, and the time, ns, that two may take: a clamp gives way
within 50 ms. Higher values take a quick hand for a leap. One reading is allowed in any case: without it, two steps in a
row of a slow tracker were not a leap."""
_LEAST_AFTER = 3
"""Readings from the leap on before it is given up: one on the way, and two that show where the hand goes then."""
_USUAL, _MEMORY_S = 2.5, 1.0
"""Multiple of the usual deviation from a steady course that is odd, and s for which deviations count as usual. A lower
multiple spends a fit on every reading of a tracker of .25 mm; a higher one hides slips at 20 Hz in a lively hand."""
_PAST_NS = 1_200_000_000
"""ns of path that a leap may repeat: lags of 1 s are named (`appliance.core.path.explanation`), a leap takes .1 s more.
"""
_RETRACED = 4.0
"""Largest mean square of the difference between a path and an earlier part of itself, in that of the noise, at which it
repeats that part. It was .1 to 1.1 for poses that fell back by .1 to .8 s, and 90 and more for slips by 5 mm or 3.5°
(60 each, in-plane and gesture of the study, seed 1). A lower value names late poses as slips; a higher one doubts slips
without naming them."""


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """Holds a picture.

    moved: (3,) motion of the picture plane since the one before, mm, mm, rad; None for one that is not a witness.
    """

    t_ns: int
    moved: Array | None
    likeness: float

    @property
    def away_mm(self) -> float:
        """Returns its distance out of the plane of its keyframe, mm, by their likeness exp(−d²/2).

        That is rather more than the true distance up to .75 mm, and less beyond 1 mm
        (tests/appliance/core/registration/test_registration.py).
        """
        return sqrt(-2 * log(max(self.likeness, ALIKE)))


class MarkerSlip(BodySlip):
    """Accumulates the leaps of the marker body in its own axes: B' = B · D.

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
        """See Detector. Returns True also for a leap that no picture witnessed, and for poses that fell back."""
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
        """See Detector. Pictures and poses so far are forgotten."""
        self._pictures.clear()
        super().pause(t_ns)

    def on_verified(self, shows: Callable[[Fault], bool], until_ns: int) -> None:
        """See Detector."""
        if shows(Fault.ROTATION):
            self._slip[:3, :3] = np.eye(3)
        if shows(Fault.OFFSET):
            self._slip[:3, 3] = 0.0

    def checks(self) -> tuple[Check, ...]:
        """Returns the turn, deg, and the shift, mm, of the marker body since the reference.

        The part of the shift across the picture, which motion does not recover, has a check of its own.
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
        """Adds a reading to the track and returns whether the leap under examination has been found or doubted."""
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
            self._leapt_ns = leapt_ns  # too few readings since: it is examined again at the next one
        elif odd and not leapt:
            self._leapt_ns, self._before_ns = t_ns, before_ns
        return leapt

    def _is_odd(self, t_ns: int, matrix: Matrix4) -> bool:
        """Returns whether a steady hand would not have moved the marker to this reading, which is then worth a fit."""
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
        """Returns how far, (2,) mm and rad, the step to this reading is from the mean velocity of the recent ones.

        The velocity counts as 0 where there is only one. The axes are the sensor's; turns are taken as small.
        """
        (first_ns, first), (last_ns, last) = self._track[0], self._track[-1]
        step, way = last[:3, :3].T @ matrix[:3], first[:3, :3].T @ last[:3]
        share = (t_ns - last_ns) / (last_ns - first_ns) if first_ns < last_ns else 0.0
        moved = last[:3, :3].T @ (matrix[:3, 3] - last[:3, 3] - (last[:3, 3] - first[:3, 3]) * share)
        turned = _turn(step) - _turn(way) * share
        return np.array([hypot(*moved.tolist()), hypot(*turned.tolist())])

    def _conclude(self, leapt_ns: int) -> bool:
        """Examines the leap once it shows whether the marker stays; returns whether something leapt or is doubted."""
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
        """Returns whether the body went beyond a limit unseen, in the step to that reading or in two steps.

        This is asked where too few readings before it show what the hand did. Without it, 5 mm out of the plane within
        a gap of 100 ms stayed verified for 24 s, and with a tracker of 4 to 8 Hz for as long as it was observed.
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
        """Returns whether the readings from the leap on repeat those before it."""
        past = [reading for reading in self._past if reading[0] < t_ns[after]]
        past_s = np.array([t for t, _ in past]) / 1e9
        later_s, later = t_ns[after:] / 1e9, path[after:]
        return retraced(past_s, self._path(base, past), later_s, later, found.noise) <= _RETRACED

    def _leave(self, after: int) -> None:
        """Drops the readings before the leap, which say nothing about what the hand does after it."""
        for _ in range(after):
            self._track.popleft()

    def _path(self, base: Matrix4, readings: Iterable[tuple[int, Matrix4]]) -> Array:
        """Returns the path, (n, 6) mm and rad, of the picture plane from its place at base, in its axes there.

        It follows from X and the poses alone.
        """
        motion = self._X @ inverse(base) @ np.array([matrix for _, matrix in readings]) @ self._back
        turns = np.array([vector_from_rotation(one[:3, :3]) for one in motion])
        return np.column_stack([motion[:, :3, 3], turns])

    def _surest(self, t_ns: Array, path: Array, after: int) -> tuple[Leap | None, int]:
        """Returns the most certain of the fits with none, one or two readings on the way, and the leap's time, ns.

        Returns None where no fit is a leap further than a hand goes, or beyond what the limits allow.
        """
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
        """Returns whether the readings are near enough in time to recognise a leap that a hand could have made."""
        return bool(t_ns[-1] - t_ns[0] <= _SMOOTH_NS)

    def _too_far(self, size: Array, taken_ns: int) -> bool:
        """Returns whether the marker went further than a hand may suddenly go in that time."""
        moved_mm, turned_rad = extent(self._of_body(size))
        taken_s = taken_ns / 1e9
        return moved_mm > max(_LEAST_MM, _FAST_MM_PER_S * taken_s) or turned_rad > max(
            _LEAST_RAD, _FAST_RAD_PER_S * taken_s
        )

    def _unseen(self, size: Array, before_ns: int, leapt_ns: int, nodes_ns: Array | None = None) -> Array | None:
        """Returns the part, (6,), of a leap between two readings that the pictures do not show.

        Returns None where there are too few pictures. nodes_ns: (4,) times of the only readings from which it is known.
        """
        since_ns = before_ns - SHIFT_NS
        around = [one for one in self._pictures if since_ns <= one.t_ns <= leapt_ns + SHIFT_NS]
        if len(around) < 2 or any(one.moved is None for one in around):
            return None
        # In the plane the motion of the pictures is subtracted; out of it all is, where their likeness fell far enough.
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
        """Returns the leap of the picture, (3,), near that time that is most like the wanted one, or 0 if 0 is nearer.

        Its path is the part that the tracker could see, so pictures from the time without readings are left out.
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
        """Returns the same, (3,), for a step, from the path of the picture at those times or a little beside them."""
        t_ns = np.array([one.t_ns for one in self._pictures])
        path = np.cumsum([np.zeros(3) if one.moved is None else one.moved for one in self._pictures], axis=0)
        best = np.zeros(3)
        for late_ns in LAGS_NS:
            way = np.stack([np.interp(nodes_ns + late_ns, t_ns, row) for row in path.T], axis=-1)
            best = self._nearer(wanted, best, uneven_step(nodes_ns, way))
        return best

    def _nearer(self, wanted: Array, one: Array, other: Array) -> Array:
        """Returns which of two motions of the picture, mm, mm, rad, is more like the wanted one."""
        reach = np.array([1.0, 1.0, hypot(*self._reach_mm)])
        apart = [np.linalg.norm((wanted - way) * reach) for way in (one, other)]
        return one if apart[0] <= apart[1] else other


def _turn(step: Array) -> Array:
    """Returns the rotation vector, (3,) rad, of a small turn."""
    return np.array([step[2, 1] - step[1, 2], step[0, 2] - step[2, 0], step[1, 0] - step[0, 1]]) / 2


def _check(name: str, fault: Fault, value: float, unit: str, limit: float, failed: bool) -> Check:
    return Check(name, fault, value, 0.0, unit, limit, VerdictKind.FAULT if failed else VerdictKind.OK)
