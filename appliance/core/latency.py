"""Latency of the tracker against the video, from the two paths alone.

The centre of the picture goes its way w(t) as the tracker tells it; the picture's own path c(t) must be a linear map of
it. For each candidate lag the best 2 × 3 map is fitted and what it leaves is the cost, so errors of scale and rotation
of the calibration do not matter. Poses are smoothed over about one frame first: interpolation of noisy poses would
otherwise favour half a frame (mathematics, section 5).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from appliance.core.geometry import Array

_GRID_S = 0.01
_REACH, _NEAR = 30, 8
"""Lags looked at, in steps of the grid either way: all, and about the best."""
_RANGE_S = (_REACH + _NEAR) * _GRID_S
"""How far from a picture poses are asked for."""
_STRIDE = 3
_LAGS_S = (0.08, 0.16, 0.32)
_LEAST = 12
_LEAST_DEPTH = 5.0
_MEMORY_S = 0.35
_MAP_PARAMETERS = 6
_ROBUST_ROUNDS = 3


@dataclass(frozen=True, slots=True)
class Latency:
    """value_s > 0 where the tracker is late: the pose stamped t + value belongs to the image stamped t."""

    value_s: float
    sigma_s: float


def estimate_latency(
    t_s: Array, chain: NDArray[np.int64], path_mm: Array, pose_t_s: Array, centre_mm: Array
) -> Latency | None:
    """t_s, chain (n,), path_mm (n, 2): the picture's path. pose_t_s (m,), centre_mm (m, 3): image centre in tracker
    axes.

    None where the motion does not show it: too short, too still, or without a change of velocity.
    """
    if t_s.size < _LEAST or pose_t_s.size < _LEAST:
        return None
    period_s = float(np.median(np.diff(t_s)))
    smooth = _smoothed(pose_t_s, centre_mm, max(period_s, float(np.median(np.diff(pose_t_s)))))
    steps = [_Steps(t_s, chain, path_mm, max(1, round(lag / period_s))) for lag in _LAGS_S]
    steps = [s for s in steps if s.usable(pose_t_s)]
    if not steps:
        return None
    places = _Places(t_s, pose_t_s, smooth)
    coarse = np.arange(-_REACH, _REACH + 1, 2)
    rough = _scores(steps, places.at(coarse), _STRIDE)
    score = rough.mean(axis=1)
    best = int(np.argmin(score))
    if best in (0, len(coarse) - 1) or np.median(score) - score[best] < _LEAST_DEPTH:
        return None
    near = coarse[best] + np.arange(-_NEAR, _NEAR + 1, 2)
    minima_s = coarse[np.argmin(rough, axis=0)] * _GRID_S
    return _minimum(near * _GRID_S, _scores(steps, places.at(near), 1), minima_s, steps)


class _Places:
    """The centre's place so many grid steps after each picture, mm; linear on a grid of `_GRID_S`."""

    def __init__(self, t_s: Array, pose_t_s: Array, centre_mm: Array) -> None:
        start_s = t_s[0] - _RANGE_S - _GRID_S
        grid_s = np.arange(start_s, t_s[-1] + _RANGE_S + 3 * _GRID_S, _GRID_S)
        self._grid_mm = np.stack([np.interp(grid_s, pose_t_s, x) for x in centre_mm.T], axis=1)
        index = np.floor((t_s - start_s) / _GRID_S)
        self._index = index.astype(np.intp)
        self._share = ((t_s - start_s) / _GRID_S - index)[:, None]

    def at(self, steps: NDArray[np.int64]) -> Array:
        """(k,) grid steps → (k, n, 3)."""
        before = self._index + steps[:, None]
        low, high = self._grid_mm[before], self._grid_mm[before + 1]
        return np.asarray(low + self._share * (high - low))


class _Steps:
    """Displacements of the picture over `frames` frames, each within one chain, inside the span that every lag can
    reach.
    """

    def __init__(self, t_s: Array, chain: NDArray[np.int64], path_mm: Array, frames: int) -> None:
        self._t_s, self._frames = t_s, frames
        self._same = chain[frames:] == chain[:-frames]
        self._moved = path_mm[frames:] - path_mm[:-frames]

    def usable(self, pose_t_s: Array) -> bool:
        start, end = self._t_s[: -self._frames], self._t_s[self._frames :]
        self._same = self._same & (start - _RANGE_S >= pose_t_s[0]) & (end + _RANGE_S <= pose_t_s[-1])
        return bool(np.count_nonzero(self._same) >= _LEAST)

    @property
    def independent(self) -> float:
        """Degrees of freedom: a hand's motion and what the map leaves of it change over about `_MEMORY_S`."""
        period_s = float(np.median(np.diff(self._t_s)))
        apart = max(self._frames, round(_MEMORY_S / period_s))
        return max(2 * float(np.count_nonzero(self._same)) / apart - _MAP_PARAMETERS, 0.0)

    def misfit(self, places_mm: Array, stride: int) -> Array:
        """(k, n, 3) for k lags → (k,) robust mean square, mm², of what no linear map of the tracker's steps explains.

        stride: one in how many steps is looked at.
        """
        first = np.flatnonzero(self._same)[::stride]
        w = places_mm[:, first + self._frames] - places_mm[:, first]
        moved = np.broadcast_to(self._moved[first], (*w.shape[:2], 2))
        weight = np.ones(w.shape[:2])
        left_square, middle = np.zeros_like(weight), w.shape[1] // 2
        for _ in range(_ROBUST_ROUNDS):
            weighted = np.swapaxes(w * weight[..., None], 1, 2)
            H = weighted @ w
            H += np.eye(3) * (1e-6 * np.trace(H, axis1=1, axis2=2) + 1e-12)[:, None, None]
            left = moved - w @ np.linalg.solve(H, weighted @ moved)
            left_square = np.einsum("kni,kni->kn", left, left)
            usual = np.maximum(np.partition(left_square, middle, axis=1)[:, middle, None], 1e-6)
            weight = 1 / (1 + left_square / (4 * usual))
        return np.asarray((weight * left_square).sum(axis=1) / weight.sum(axis=1))


def _smoothed(t_s: Array, values: Array, width_s: float) -> Array:
    """Triangular kernel of half-width width_s over irregular times."""
    reach = max(1, int(np.ceil(width_s / max(float(np.median(np.diff(t_s))), 1e-4))))
    total, weights = np.zeros_like(values), np.zeros(len(values))
    for shift in range(-reach, reach + 1):
        index = np.clip(np.arange(len(values)) + shift, 0, len(values) - 1)
        kernel = np.maximum(1 - np.abs(t_s[index] - t_s) / (width_s * 1.5), 0)
        total += values[index] * kernel[:, None]
        weights += kernel
    return np.asarray(total / weights[:, None])


def _scores(steps: list[_Steps], places_mm: Array, stride: int) -> Array:
    """(k, n, 3) → (k, lengths) −log likelihood of every step length, n/2 · log(cost)."""
    costs = np.stack([s.misfit(places_mm, stride) for s in steps], axis=1)
    return np.asarray(np.log(costs + 1e-9) * [s.independent / 2 for s in steps])


def _minimum(lags: Array, scores: Array, minima: Array, steps: list[_Steps]) -> Latency | None:
    """The cost is a parabola about its minimum, which gives the value; that of the mean score gives sigma.

    Where the step lengths disagree about the minimum, the disagreement is part of sigma. minima: (lengths,) of each
    over the whole range; one outside `lags` counts as it is.
    """
    score, centre = scores.mean(axis=1), float(lags[len(lags) // 2])
    curvature = float(np.polyfit(lags - centre, score, 2)[0])
    per_log = np.maximum([s.independent / 2 for s in steps], 0.5)
    steepness, vertex = _parabola(lags - centre, np.exp((score - score.min()) / per_log.mean()))
    if curvature <= 0 or steepness <= 0:
        return None
    value = centre + float(vertex)
    each = centre + _parabola(lags - centre, np.exp((scores - scores.min(axis=0)) / per_log))[1]
    minima = np.where(np.abs(minima - centre) <= lags[-1] - centre, each, minima)
    return Latency(value, float(np.sqrt(1 / (2 * curvature) + np.mean(np.square(minima - value)))))


def _parabola(x: Array, y: Array) -> tuple[Array, Array]:
    """Second coefficient and vertex, within half of the range, of the parabola through y, (k,) or (k, m)."""
    steepness, slope, _ = np.polyfit(x, y, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = np.where(steepness > 0, -slope / (2 * steepness), x[np.argmin(y, axis=0)])
    return np.asarray(steepness), np.clip(vertex, x[0] / 2, x[-1] / 2)
