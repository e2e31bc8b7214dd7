"""Finds what explains the motion where calibration and poses at nearly no latency do not: a far lag, or another pose
convention.

Steps of the picture are compared with those that the reference predicts, for every lag up to more than a second and for
every convention. No parameter is fitted, so a wrong one cannot adapt. The answer only ever accuses: that the reference
explains the motion is shown elsewhere, with its sigmas (docs/method.md, sections 5 and 9).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.path.conventions import READINGS, Convention, turned_sensors
from probewatch.appliance.core.path.latency import MEMORY_S
from probewatch.appliance.core.path.steps import SensorSteps, picture_steps
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.spread_work import CONVENTIONS, LAG, LAGS, Steps
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array

_GRID_S = 0.025
"""Spacing of the lags, s; a parabola finds the best between them. A spacing of more than 40 ms skips the lag of an 8 Hz
tremor.
"""
_FARTHEST_S, _NEAR_S = 1.2, 0.1
"""Largest lags, s, positive or negative, that are searched: of the reference, and of other conventions, whose tracker
is as late as any that works. The former is more than is named, so that the alias of a lag beyond it is not named
instead.
"""
NAMED_S = 1.0
"""Largest lag that is named, s. Beyond it, a hand's next round may be meant: one takes 2 to 4 s."""
_STEP_S = 0.16
"""Length of the steps, s. Longer ones let breathing in, which is slow; shorter ones drown in tracker noise."""
_FLOORS = np.square([0.1, 0.1, np.deg2rad(0.03)])
"""Squares, mm² and rad², of the lateral and axial steps and turns that do not matter: noise of a tracker's two
readings.
"""
_LEAST_S = 0.6
"""Least time, s, from the begin of the first step with poses at a lag to that of the last, for that lag to be weighed:
nearly four steps that share nothing. Less weighs lags by a twitch of the hand, more weighs far lags later. Not varied.
"""
_MOST_STEPS = 150
"""Largest number of steps. In a longer window every other step is left out, and so on: steps overlap, and cost time."""
_LEAST_SCORE, MARGIN = 15.0, 15.0
"""Amounts, in log likelihood, by which the best explanation must beat no motion at all, and everything else. Less takes
the next round of a periodic motion for the lag; more names it later. For 450 ms and for each convention, the worst of
the study's sessions (hold, tremor alone) reaches 40 and 25 within six seconds.
"""
_ALIKE, _LEAST_ALIKE = 0.8, 2
"""Agreement of predicted and seen steps, 1 for equal ones, and how many of the three rows must have it: breathing
spoils the axial one. By chance the turn comes to .9 with other rows near 0.
"""
_RECENT_NS = (1_200_000_000, 1_600_000_000, 2_000_000_000)
"""Durations, ns, of the latest motion in which a lag that has just begun is searched for, the shortest first. A shorter
one shows no lag, as the poses of a late tracker are yet to come; a longer one includes what was before, and names the
lag later. On paths of the study's hand without pictures every lag that was found (80 to 450 ms, -120, -300) was within
9 ms of the truth from 1.4 s after it had begun, and none of healthy motion was wrong by more than 7 ms.
"""
_APART_S = 0.15
"""Distance, s, within which lags belong to the peak of the best: beyond a quarter of the period of a motion, .125 s at
2 Hz, lags agree no more. More lets a second peak pass for the first, less lets a broad peak, as of slow motion, rival
itself. Not varied."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """Represents what explains the motion far better than anything else.

    latency_s: as `Latency.value_s`. margin: how far everything else is behind, in log likelihood.
    """

    convention: Convention
    latency_s: float
    margin: float


@dataclass(frozen=True, slots=True, eq=False)
class _Fits:
    """Holds the fits of one reading of the poses at k lags (k,) s: scores (k,), the lower the better, and agreement (3,
    k).
    """

    convention: Convention
    lags_s: Array
    scores: Array
    agreement: Array

    @property
    def best(self) -> int:
        return int(np.argmin(self.scores))


def explain(window: PathWindow, reference: Calibration) -> Steps[Explanation | None]:
    """Returns what explains the motion; None where there is too little motion, where nothing explains it or where two
    explanations do so equally well.
    """
    yield LAGS.of()
    steps = _Steps.of(window, reference)
    if steps is None:
        return None
    now = steps.fits(Convention.AGREED, steps.predicted(reference.rotation), _FARTHEST_S)
    in_order = _convincing([now])
    if in_order is not None and abs(in_order.latency_s) <= _NEAR_S:
        return in_order
    yield CONVENTIONS.of()
    return _convincing([now, *_other_conventions(steps, reference)])


def recent_lag(window: PathWindow, reference: Calibration, beyond_s: float) -> Steps[tuple[int, Explanation] | None]:
    """Returns the stamp since which a lag of more than beyond_s, positive or negative, explains the latest motion, and
    that lag.

    Returns None where there is no more motion than `explain` searches anyway, where a smaller lag explains it, or where
    nothing does.
    """
    for span_ns in _RECENT_NS:
        if window.span_ns < span_ns:
            return None
        yield LAG.of()
        recent = window.since(window.now_ns - span_ns)
        steps = _Steps.of(recent, reference)
        if steps is None:
            continue
        found = _convincing([steps.fits(Convention.AGREED, steps.predicted(reference.rotation), _FARTHEST_S)])
        if found is None:
            continue
        if abs(found.latency_s) <= beyond_s:
            return None
        surely = yield from explain(recent, reference)
        agreed = surely is not None and surely.convention is Convention.AGREED
        return (recent.start_ns, found) if agreed else None
    return None


def _other_conventions(steps: "_Steps", reference: Calibration) -> Iterator[_Fits]:
    for convention, turned in turned_sensors(reference.rotation):
        yield steps.fits(convention, steps.predicted(turned), _NEAR_S)
    for convention, readings in READINGS.items():
        for read in readings:
            again = SensorSteps.between(read(steps.poses))
            yield steps.fits(convention, steps.predicted(reference.rotation, again), _NEAR_S)


def _convincing(all_fits: list[_Fits]) -> Explanation | None:
    """Returns the best fit as an explanation, where it explains the motion and nothing else does nearly as well; None
    otherwise.
    """
    best = min(all_fits, key=lambda fits: float(fits.scores.min()))
    score, lag_s = float(best.scores[best.best]), best.lags_s[best.best]
    rivals = [
        fits.scores[np.abs(fits.lags_s - lag_s) > _APART_S] if fits.convention is best.convention else fits.scores
        for fits in all_fits
    ]
    margin = min(float(scores.min(initial=0.0)) for scores in rivals) - score
    alike = np.count_nonzero(best.agreement[:, best.best] >= _ALIKE)
    convincing = score <= -_LEAST_SCORE and margin >= MARGIN and alike >= _LEAST_ALIKE
    return Explanation(best.convention, _vertex(best), margin) if convincing and abs(lag_s) <= NAMED_S else None


def _vertex(fits: _Fits) -> float:
    """Returns the lag, s, at the vertex of the parabola through the best lag and its neighbours."""
    k = fits.best
    if not 0 < k < fits.scores.size - 1:
        return float(fits.lags_s[k])
    before, here, after = np.exp((fits.scores[k - 1 : k + 2] - fits.scores[k]) / max(-fits.scores[k], 1.0))
    bend = before - 2 * here + after
    return float(fits.lags_s[k] + (_GRID_S * (before - after) / (2 * bend) if bend > 0 else 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class _Steps:
    """Holds the steps of the picture over `_STEP_S` and the poses about them.

    seen: (3, n) lateral and axial steps, mm, and turns, rad. begin, end: (n,) of each, in whole grid steps, with the
    `share` (2, n) of the next. poses: (m, 4, 4) on the grid. sensor: their steps. span_s: duration of the motion.
    """

    seen: Array
    begin: NDArray[np.intp]
    end: NDArray[np.intp]
    share: Array
    poses: Array
    sensor: SensorSteps
    offset_mm: Array
    span_s: float

    @classmethod
    def of(cls, window: PathWindow, reference: Calibration) -> "_Steps | None":
        """Returns the steps of the window; None where there are too few."""
        pictures = window.picture_steps()
        if pictures is None:
            return None
        t_s, chain, path = pictures
        ahead = max(1, round(_STEP_S / max(float(np.median(np.diff(t_s))), 1e-3)))
        start_s = float(t_s[0]) - _FARTHEST_S
        poses, known = window.poses.at(np.arange(start_s, t_s[-1] + _FARTHEST_S, _GRID_S), window.start_ns)
        bracketed = np.flatnonzero(known)
        if bracketed.size < 2:
            return None
        first, last = int(bracketed[0]), int(bracketed[-1]) + 1
        # Places of the pictures on the grid of poses; a step counts if both its ends have poses at lag 0.
        place = (t_s - start_s) / _GRID_S - first
        within = (place >= 0) & (place + 1 < last - first)
        begins = np.flatnonzero((chain[ahead:] == chain[:-ahead]) & within[ahead:] & within[:-ahead])
        begins = begins[:: 1 + begins.size // _MOST_STEPS]
        if not begins.size or t_s[begins[-1]] - t_s[begins[0]] < _LEAST_S:
            return None
        both = place[np.stack([begins, begins + ahead])]
        whole = np.floor(both).astype(np.intp)
        span_s = float(t_s[begins[-1]] - t_s[begins[0]])
        poses = poses[first:last]
        seen = path[:, begins + ahead] - path[:, begins]
        sensor = SensorSteps.between(poses)
        return cls(seen, whole[0], whole[1], both - whole, poses, sensor, reference.offset_mm, span_s)

    def predicted(self, R: Array, sensor: SensorSteps | None = None) -> Array:
        """Returns the path of the picture on the grid, (3, m), that X = (R, offset) predicts from this or another
        reading of the poses.
        """
        moved, turned = picture_steps(R, self.offset_mm, sensor or self.sensor)
        return np.cumsum([moved[0], moved[1], turned[2]], axis=1)

    def fits(self, convention: Convention, path: Array, reach_s: float) -> _Fits:
        """Returns the fits (18a) at lags up to reach_s either way."""
        lags = np.arange(-round(reach_s / _GRID_S), round(reach_s / _GRID_S) + 1)
        lags_s = np.asarray(lags * _GRID_S, dtype=np.float64)
        begin, end = self.begin + lags[:, None], self.end + lags[:, None]
        slope = np.diff(path, axis=1)
        reached = (begin >= 0) & (end < slope.shape[1])
        begin, end = np.where(reached, begin, 0), np.where(reached, end, 0)
        moved = np.take(path, end, axis=1) - np.take(path, begin, axis=1)
        moved += self.share[1] * np.take(slope, end, axis=1) - self.share[0] * np.take(slope, begin, axis=1)
        moved *= reached
        # The sums of (18a), for every lag at once; steps that a lag does not reach count in none of them.
        together = np.einsum("rn,rkn->rk", self.seen, moved)
        seen, predicted = np.square(self.seen) @ reached.T, np.square(moved).sum(axis=2)
        floor = np.maximum(reached.sum(axis=1), 1) * _FLOORS[:, None]
        left = np.log((seen + predicted - 2 * together + floor) / (seen + floor)).sum(axis=0)
        agreement = 2 * together / (seen + predicted + floor)
        span_s = self.span_s * reached.mean(axis=1)
        scores = np.where(span_s >= _LEAST_S, 0.5 * span_s / MEMORY_S * left, 0.0)
        return _Fits(convention, lags_s, scores, agreement)
