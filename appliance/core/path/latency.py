"""Estimates the latency of the tracker against the video from the two paths alone.

The centre of the picture follows a path w(t) by the tracker; the picture's own path c(t) must be a linear map of it.
For each candidate lag the best 2 × 3 map is fitted and its residual is the cost, so errors of scale and rotation of the
calibration do not matter. Poses are first smoothed over about one frame: interpolation of noisy poses would otherwise
favour half a frame (docs/method.md, section 5).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.rigid import Array

_GRID_S = 0.01
"""Spacing of the lags, s: a parabola finds the minimum between them. A finer one costs time; one coarser than a third
of a picture at 30 Hz flattens the minimum.
"""
_REACH, _FAR_REACH, _NEAR = 30, 120, 8
"""Lags that are searched, in steps of the grid either way: in general, in a recording, and about the best lag. The
farthest is more than is returned, so that the alias of a lag beyond that is not returned instead.
"""
_FAR_S, _FAR_NATS, _APART_S = 1.0, 15.0, 0.15
"""Largest lag that is returned for a recording, s; and by how much, in log likelihood, it must beat every lag that is
at least `_APART_S`, s, from it and no farther from zero. Less takes the next stroke for the lag, more returns none for
more recordings. In PLUS's water tank the next stroke is 23 behind, in its N-wire phantom every other lag is 19 behind;
both recordings were looked at.
"""
_NEAR_S = _GRID_S * np.arange(-_NEAR, _NEAR + 1, 2)
_PARABOLA = np.linalg.pinv(np.vander(_NEAR_S, 3))
"""Matrix, (3, k), that gives the coefficients of the parabola through k values at `_NEAR_S`."""
_STRIDE = 3
"""One step in this many is evaluated where all lags are searched: a third of the work. About the best lag, and in a
recording, all steps are.
"""
_LAGS_S = (0.08, 0.16, 0.32)
"""Lengths of the steps, s. Short ones show a lag sharply but drown in tracker noise, long ones the reverse; their
disagreement goes into sigma. Not varied by themselves.
"""
_LEAST = 12
"""Least number of pictures, of poses, and of steps of one length: twice the number of parameters that are fitted to
them. At 30 Hz, .3 s are too few (tests/appliance/core/path/test_latency.py).
"""
_LEAST_DEPTH = 5.0
"""Amount, in log likelihood, by which the best lag must beat the median one. Less takes chance for a lag, more leaves
it unknown in slow sweeps. Not measured.
"""
_VAGUE_S = 0.15
"""Sigma, s, from which there is no lag, half of the reach. More lets the solver sharpen chance: a window of 10 s that
ended in 9 s of rest gave .26 ± .33 s, from which the solver made +236 ± 5 ms on a punctual tracker. Less starts fewer
solutions near the lag. Not varied.
"""
MEMORY_S = 0.35
"""Time, s, below which steps begin too close to one another to be independent. More widens sigma; with this one it
covers the error in 95 % of runs (tests/appliance/core/path/test_latency.py).
"""
_MAP_PARAMETERS = 6
"""Number of parameters of the 2 × 3 map."""
_DOUBTFUL = 4.0
"""Square of a step's residual ÷ the usual one, at which the step counts half: twice the usual length. More lets single
bad pictures decide, less discards the very steps that show the lag. Not measured.
"""
_ROBUST_ROUNDS = 3
"""Number of fits of the map, each with the weights of the one before; each costs as much as the first. Not measured."""


@dataclass(frozen=True, slots=True)
class Latency:
    """Represents a latency of the tracker and its sigma.

    value_s > 0 where the tracker is late: the pose stamped t + value belongs to the image stamped t.
    """

    value_s: float
    sigma_s: float


def estimate_latency(
    t_s: Array, chain: NDArray[np.int64], path_mm: Array, pose_t_s: Array, centre_mm: Array
) -> Latency | None:
    """Estimates the latency. t_s, chain (n,), path_mm (2, n): the picture's path. pose_t_s (m,), centre_mm (3, m):
    image centre in tracker axes.

    Returns None where the motion does not show it: too short, too still, without a change of velocity, or not to
    `_VAGUE_S`.
    """
    search = _Search.of(t_s, chain, path_mm, pose_t_s, centre_mm, _REACH, _STRIDE)
    found = None if search is None else search.latency(search.best(_REACH), _REACH)
    return found if found is not None and found.sigma_s < _VAGUE_S else None


def far_latency(
    t_s: Array, chain: NDArray[np.int64], path_mm: Array, pose_t_s: Array, centre_mm: Array
) -> Latency | None:
    """Estimates the latency up to a second, positive or negative, for a recording that is at hand as a whole.

    Returns None also where another lag, no farther from zero, explains the motion nearly as well. If all strokes are
    alike, a lag of half a stroke more explains them as well, so the far lag is returned only where it is better than
    the usual one by `_FAR_NATS`.
    """
    search = _Search.of(t_s, chain, path_mm, pose_t_s, centre_mm, _FAR_REACH, 1)
    if search is None:
        return None
    usual, best = search.best(_REACH), search.best(_FAR_REACH)
    apart = abs(int(search.lags[usual] - search.lags[best])) * _GRID_S >= _APART_S
    if apart and search.score[usual] - search.score[best] < _FAR_NATS:
        best = usual
    reach = max(abs(int(search.lags[best])), _REACH)
    found = search.latency(best, reach) if search.ahead_nats(best, reach) >= _FAR_NATS else None
    return found if found is not None and abs(found.value_s) <= _FAR_S else None


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """Holds the scores of the lags that were searched; the lower, the better.

    lags: (k,) steps of the grid. rough: (k, lengths) scores of each, by every `stride`-th step of the path; score: (k,)
    their mean.
    """

    steps: "list[_Steps]"
    places: "_Places"
    lags: NDArray[np.int64]
    rough: Array
    score: Array

    @classmethod
    def of(
        cls,
        t_s: Array,
        chain: NDArray[np.int64],
        path_mm: Array,
        pose_t_s: Array,
        centre_mm: Array,
        reach: int,
        stride: int,
    ) -> "_Search | None":
        """Searches lags up to `reach` steps of the grid either way; returns None where pictures or poses are
        too few.
        """
        if t_s.size < _LEAST or pose_t_s.size < _LEAST:
            return None
        period_s, range_s = float(np.median(np.diff(t_s))), (reach + _NEAR) * _GRID_S
        smooth = _smoothed(pose_t_s, centre_mm, max(period_s, float(np.median(np.diff(pose_t_s)))))
        covered = (t_s - range_s >= pose_t_s[0]) & (t_s + range_s <= pose_t_s[-1])
        steps = [_Steps(path_mm, chain, covered, max(1, round(lag / period_s)), period_s) for lag in _LAGS_S]
        steps = [s for s in steps if s.first.size >= _LEAST]
        if not steps:
            return None
        places, lags = _Places(t_s, pose_t_s, smooth, range_s), np.arange(-reach, reach + 1, 2)
        rough = _scores(steps, places.at(lags), stride)
        return cls(steps, places, lags, rough, rough.mean(axis=1))

    def best(self, reach: int) -> int:
        """Returns the index of the best lag up to `reach` either way."""
        return int(np.argmin(np.where(np.abs(self.lags) <= reach, self.score, np.inf)))

    def ahead_nats(self, best: int, reach: int) -> float:
        """Returns by how much, in log likelihood, this lag beats every other up to `reach` that is `_APART_S` or more
        from it.
        """
        apart = np.abs(self.lags - self.lags[best]) * _GRID_S >= _APART_S
        return float(self.score[apart & (np.abs(self.lags) <= reach)].min() - self.score[best])

    def latency(self, best: int, reach: int) -> Latency | None:
        """Returns the best lag as a latency; None where it lies at the end of the range that was searched, or is hardly
        better than the median one.
        """
        if best in (0, len(self.lags) - 1) or np.median(self.score) - self.score[best] < _LEAST_DEPTH:
            return None
        near = self.lags[best] + np.arange(-_NEAR, _NEAR + 1, 2)
        looked_at = np.abs(self.lags) <= reach
        minima_s = self.lags[looked_at][np.argmin(self.rough[looked_at], axis=0)] * _GRID_S
        return _minimum(near * _GRID_S, _scores(self.steps, self.places.at(near), 1), minima_s, self.steps)


class _Places:
    """Interpolates the centre's place, mm, at grid steps after each picture, linearly on a grid of `_GRID_S`."""

    def __init__(self, t_s: Array, pose_t_s: Array, centre_mm: Array, range_s: float) -> None:
        start_s = t_s[0] - range_s - _GRID_S
        grid_s = np.arange(start_s, t_s[-1] + range_s + 3 * _GRID_S, _GRID_S)
        self._grid_mm = np.stack([np.interp(grid_s, pose_t_s, x) for x in centre_mm])
        index = np.floor((t_s - start_s) / _GRID_S)
        self._index = index.astype(np.intp)
        self._share = (t_s - start_s) / _GRID_S - index

    def at(self, steps: NDArray[np.int64]) -> Array:
        """Returns the places at (k,) grid steps after each picture, (3, k, n) mm."""
        before = self._index + steps[:, None]
        low, high = (np.take(self._grid_mm, index, axis=1) for index in (before, before + 1))
        return np.asarray(low + self._share * (high - low))


class _Steps:
    """Holds the displacements of the picture over `frames` frames, each within one chain, inside the span that every
    lag can reach.

    first: index of the picture where each begins. independent: degrees of freedom; a hand's motion, and what the map
    leaves of it, change over about `MEMORY_S`.
    """

    def __init__(
        self, path_mm: Array, chain: NDArray[np.int64], covered: NDArray[np.bool_], frames: int, period_s: float
    ) -> None:
        self._path_mm, self._frames = path_mm, frames
        self.first = np.flatnonzero((chain[frames:] == chain[:-frames]) & covered[:-frames] & covered[frames:])
        apart = max(frames, round(MEMORY_S / period_s))
        self.independent = max(2 * self.first.size / apart - _MAP_PARAMETERS, 0.0)

    def misfit(self, places_mm: Array, stride: int) -> Array:
        """Returns the robust mean square, (k,) mm², of the residual of the best linear map of the tracker's steps at
        each of k lags.

        places_mm: (3, k, n). stride: one step in this many is evaluated.
        """
        first = self.first[::stride]
        last = first + self._frames
        w = (np.take(places_mm, last, axis=2) - np.take(places_mm, first, axis=2)).swapaxes(0, 1)
        moved = np.take(self._path_mm, last, axis=1) - np.take(self._path_mm, first, axis=1)
        # The cost of (16) by reweighted least squares, for all lags at once; a slight ridge keeps H invertible where
        # the motion lacks a direction.
        weight = np.ones((len(w), first.size))
        left_square, middle = np.zeros_like(weight), first.size // 2
        for _ in range(_ROBUST_ROUNDS):
            weighted = w * weight[:, None]
            H = weighted @ w.swapaxes(1, 2)
            H += np.eye(3) * (1e-6 * np.trace(H, axis1=1, axis2=2) + 1e-12)[:, None, None]
            map_back = np.linalg.solve(H, weighted @ moved.T)
            left = moved - map_back.swapaxes(1, 2) @ w
            left_square = left[:, 0] ** 2 + left[:, 1] ** 2
            usual = np.maximum(np.partition(left_square, middle, axis=1)[:, middle, None], 1e-6)
            weight = 1 / (1 + left_square / (_DOUBTFUL * usual))
        return np.asarray((weight * left_square).sum(axis=1) / weight.sum(axis=1))


def _smoothed(t_s: Array, values: Array, width_s: float) -> Array:
    """Returns values (3, m) at irregular times (m,), smoothed with a triangular kernel that falls to zero at 1.5 ×
    width_s.
    """
    reach = max(1, int(np.ceil(width_s / max(float(np.median(np.diff(t_s))), 1e-4))))
    total, weights = np.zeros_like(values), np.zeros(t_s.size)
    for shift in range(-reach, reach + 1):
        index = np.clip(np.arange(t_s.size) + shift, 0, t_s.size - 1)
        kernel = np.maximum(1 - np.abs(t_s[index] - t_s) / (width_s * 1.5), 0)
        total += np.take(values, index, axis=1) * kernel
        weights += kernel
    return np.asarray(total / weights)


def _scores(steps: list[_Steps], places_mm: Array, stride: int) -> Array:
    """Returns −log likelihood, n/2 · log(cost), of every lag and step length, (k, lengths). places_mm: (3, k, n)."""
    costs = np.stack([s.misfit(places_mm, stride) for s in steps], axis=1)
    return np.asarray(np.log(costs + 1e-9) * [s.independent / 2 for s in steps])


def _minimum(lags: Array, scores: Array, minima: Array, steps: list[_Steps]) -> Latency | None:
    """Returns the latency at the minimum; None where there is none. The cost is a parabola about its minimum, which
    gives the value; that of the mean score gives sigma.

    Where the step lengths disagree about the minimum, the disagreement is part of sigma. minima: (lengths,) that of
    each over the whole range; one outside `lags` counts as it is.
    """
    score, centre = scores.mean(axis=1), float(lags[len(lags) // 2])
    curvature = float(_PARABOLA[0] @ score)
    per_log = np.maximum([s.independent / 2 for s in steps], 0.5)
    steepness, vertex = _parabola(np.exp((score - score.min()) / per_log.mean()))
    if curvature <= 0 or steepness <= 0:
        return None
    value = centre + float(vertex)
    each = centre + _parabola(np.exp((scores - scores.min(axis=0)) / per_log))[1]
    minima = np.where(np.abs(minima - centre) <= lags[-1] - centre, each, minima)
    return Latency(value, float(np.sqrt(1 / (2 * curvature) + np.mean(np.square(minima - value)))))


def _parabola(y: Array) -> tuple[Array, Array]:
    """Returns the second coefficient and the vertex, within half of the range, of the parabola through y, (k,) or (k,
    m).
    """
    steepness, slope, _ = _PARABOLA @ y
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = np.where(steepness > 0, -slope / (2 * steepness), _NEAR_S[np.argmin(y, axis=0)])
    return np.asarray(steepness), np.clip(vertex, _NEAR_S[0] / 2, _NEAR_S[-1] / 2)
