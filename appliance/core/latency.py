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

_RANGE_S = 0.3
_COARSE_S, _FINE_S = 0.02, 0.01
_PARABOLA_S = 0.07
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
    independent = np.array([s.independent for s in steps])

    def scores(lags: Array) -> Array:
        """(k,) lags → (k, lengths) −log likelihood of every step length, n/2 · log(cost)."""
        costs = np.stack([s.misfit(lags, pose_t_s, smooth) for s in steps], axis=1)
        return np.asarray(np.log(costs + 1e-9) * independent / 2)

    coarse = np.arange(-_RANGE_S, _RANGE_S + _COARSE_S / 2, _COARSE_S)
    known = scores(coarse)
    score = known.mean(axis=1)
    best = int(np.argmin(score))
    if best in (0, len(coarse) - 1) or np.median(score) - score[best] < _LEAST_DEPTH:
        return None
    between = coarse[best] + _FINE_S * np.arange(-7, 8, 2)
    lags = np.concatenate([coarse, between])
    order = np.argsort(lags)
    return _minimum(lags[order], np.concatenate([known, scores(between)])[order])


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

    def misfit(self, lags_s: Array, pose_t_s: Array, centre_mm: Array) -> Array:
        """(k,) lags → (k,) robust mean square, mm², of what no linear map of the tracker's steps explains."""
        times = (self._t_s + lags_s[:, None]).ravel()
        at = np.stack([np.interp(times, pose_t_s, centre_mm[:, axis]) for axis in range(3)], axis=1)
        at = at.reshape(lags_s.size, self._t_s.size, 3)
        w = (at[:, self._frames :] - at[:, : -self._frames])[:, self._same]
        moved = np.broadcast_to(self._moved[self._same], (lags_s.size, w.shape[1], 2))
        weight = np.ones(w.shape[:2])
        left_square = np.zeros_like(weight)
        for _ in range(_ROBUST_ROUNDS):
            weighted = np.swapaxes(w * weight[..., None], 1, 2)
            H = weighted @ w
            H += np.eye(3) * (1e-6 * np.trace(H, axis1=1, axis2=2) + 1e-12)[:, None, None]
            left_square = np.square(moved - w @ np.linalg.solve(H, weighted @ moved)).sum(axis=2)
            usual = np.maximum(np.median(left_square, axis=1, keepdims=True), 1e-6)
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


def _minimum(lags: Array, scores: Array) -> Latency | None:
    """A parabola through the minimum of the mean score gives value and sigma.

    Where the step lengths disagree about the minimum, the disagreement is part of sigma.
    """
    score = scores.mean(axis=1)
    best = int(np.argmin(score))
    near = np.abs(lags - lags[best]) <= _PARABOLA_S
    curvature, slope, _ = np.polyfit(lags[near] - lags[best], score[near], 2)
    if curvature <= 0:
        return None
    shift = float(np.clip(-slope / (2 * curvature), -_PARABOLA_S / 2, _PARABOLA_S / 2))
    disagreement = lags[np.argmin(scores, axis=0)] - lags[best]
    sigma = np.sqrt(1 / (2 * curvature) + np.mean(np.square(disagreement)))
    return Latency(float(lags[best]) + shift, float(sigma))
