"""Noise of the residual path: white tracker noise and a random walk, on an offset of its own for each chain.

Within a chain the differences of successive residuals are free of the offset; their covariance is tridiagonal, so
whitening costs time in proportion to the pictures.
"""

from dataclasses import dataclass
from functools import cached_property
from math import sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpbtrf, dtbtrs

from drivers.rigid import Array, ComplexArray

SD_PER_MEDIAN = 1.4826
"""Standard deviation ÷ median of the size of a normal variable with mean 0."""
_SAME_NOISE = 0.1
"""Share by which two estimates of the noise may differ and count as the same. Less costs rounds of the solver; the
estimates themselves scatter by about as much in a window of seconds.
"""
_LEAST_QUIET = 8
"""Steps without hidden way below which all steps tell the noise: the median of fewer is chance."""
_LOST_MM = 2.0
"""mm² of random walk per mm out of the picture plane: a slanted structure moves through the picture as fast as the
probe leaves its plane, and goes on doing so for about two millimetres.
"""
_LONG_LAG_S = 0.7
"""Where drift is told from white noise. Longer leaves few steps in the short window of `Evidence`, 3.5 s; shorter lets
white noise cover the drift. Not measured.
"""
_CHANCE = 2.5
"""Standard deviations by which chance may let white noise look like drift. Less finds drift in every quiet path, which
widens the sigmas of the scales; more overlooks it, which draws the scales. Not measured.
"""
_SHORT_WAY_S = 1.0
"""Drift is an error of the picture's path, on which the scales are regressed: over ways shorter than this it shrinks
them. White noise as large as the drift over that time lets the longer ways count.
"""
_POSITION_FLOOR_MM, _ANGLE_FLOOR_RAD = 0.02, np.deg2rad(0.01)
_POSITION_DRIFT_FLOOR, _ANGLE_DRIFT_FLOOR = 0.01, np.deg2rad(0.02)
"""Least noise that is believed, and least drift per √s: well below any tracker's, so that a window which happens to fit
does not count as certain, and equal poses do not divide by zero.
"""


@dataclass(frozen=True, slots=True)
class Noise:
    """White sd and random-walk sd per √s, of positions (mm) and angles (rad)."""

    position_mm: float
    position_drift: float
    angle_rad: float
    angle_drift: float

    def like(self, other: "Noise") -> bool:
        """Whether another round with this noise would give the same answer."""
        return all(abs(own - others) <= _SAME_NOISE * others for own, others in zip(self._all, other._all, strict=True))

    @property
    def _all(self) -> tuple[float, float, float, float]:
        return self.position_mm, self.position_drift, self.angle_rad, self.angle_drift


@dataclass(frozen=True, eq=False)
class Times:
    """t_s, chain (n,) of the residuals, in time order; hidden_mm (n,): way out of the picture plane before each."""

    t_s: Array
    chain: NDArray[np.int64]
    hidden_mm: Array

    @cached_property
    def period_s(self) -> float:
        """Usual time between two pictures."""
        return max(float(np.median(np.diff(self.t_s))), 1e-3)

    @cached_property
    def walk(self) -> tuple[NDArray[np.intp], Array, Array, NDArray[np.bool_]]:
        """Of the m differences of successive residuals in one chain: index of the later one; time s and mm² of random
        walk between the two; and, (m − 1,), whether one shares a residual with the next: no chain ended there.
        """
        later = np.flatnonzero(self.chain[1:] == self.chain[:-1]) + 1
        return later, self.t_s[later] - self.t_s[later - 1], _LOST_MM * self.hidden_mm[later], np.diff(later) == 1

    @cached_property
    def _quiet(self) -> dict[int, NDArray[np.bool_]]:
        return {}

    def quiet(self, lag: int) -> NDArray[np.bool_]:
        """(n − lag,) whether nothing was hidden between a residual and the one `lag` later in its chain."""
        if lag not in self._quiet:
            hidden = np.cumsum(self.hidden_mm)
            self._quiet[lag] = (self.chain[lag:] == self.chain[:-lag]) & (hidden[lag:] - hidden[:-lag] <= 1e-9)
        return self._quiet[lag]

    def estimated_noise(self, in_plane_mm: ComplexArray, angle_rad: Array) -> Noise:
        """Of a residual path (n,), by its structure function, which outliers spare."""
        white, drift = self._structure(in_plane_mm, _POSITION_FLOOR_MM, _POSITION_DRIFT_FLOOR)
        position = max(white, drift * sqrt(_SHORT_WAY_S)), drift
        angle = self._structure(angle_rad, _ANGLE_FLOOR_RAD, _ANGLE_DRIFT_FLOOR)
        return Noise(*position, *angle)

    def _structure(self, path: Array | ComplexArray, floor: float, drift_floor: float) -> tuple[float, float]:
        """White noise and drift from the squared differences at one frame and at `_LONG_LAG_S`."""
        long_lag = max(2, min(round(_LONG_LAG_S / self.period_s), path.size // 3))
        short, long = (self._lagged_variance(path, lag) for lag in (1, long_lag))
        axes = 2 if np.iscomplexobj(path) else 1
        chance = 1 + _CHANCE * sqrt(3 / max((path.size - long_lag) * axes, 1))
        drift_variance = max((long - short * chance) / ((long_lag - 1) * self.period_s), drift_floor**2)
        white = max((short - drift_variance * self.period_s) / 2, floor**2)
        return sqrt(white), sqrt(drift_variance)

    def _lagged_variance(self, path: Array | ComplexArray, lag: int) -> float:
        told = self.quiet(lag)
        if np.count_nonzero(told) < _LEAST_QUIET:
            told = self.chain[lag:] == self.chain[:-lag]
        change = np.abs((path[lag:] - path[:-lag])[told].view(np.float64))
        middle = change.size // 2
        return float((SD_PER_MEDIAN * np.partition(change, middle)[middle]) ** 2) if change.size else 0.0


class Whitener:
    """Turns the steps of a residual path into innovations of unit variance, one fewer than pictures in each chain.

    position_log_volume, angle_log_volume: log det of the covariance of one row of each.
    """

    def __init__(self, times: Times, noise: Noise) -> None:
        self._later, dt_s, lost_mm2, shared = times.walk
        self._position = _factor(noise.position_drift**2 * dt_s + lost_mm2, shared, noise.position_mm)
        self._angle = _factor(noise.angle_drift**2 * dt_s, shared, noise.angle_rad)
        self.position_log_volume = 2 * float(np.log(self._position[0]).sum())
        self.angle_log_volume = 2 * float(np.log(self._angle[0]).sum())

    def positions(self, steps: Array | ComplexArray) -> Array | ComplexArray:
        """(…, n), of which the first of each chain is left out → (…, m). Complex: lateral + i · axial."""
        return self._innovations(self._position, steps)

    def angles(self, steps: Array | ComplexArray) -> Array | ComplexArray:
        """(…, n), of which the first of each chain is left out → (…, m)."""
        return self._innovations(self._angle, steps)

    def _innovations(self, factor: Array, steps: Array | ComplexArray) -> Array | ComplexArray:
        if np.iscomplexobj(steps):
            lateral, axial = (self._innovations(factor, part) for part in (steps.real, steps.imag))
            return np.asarray(lateral + 1j * axial)
        white, _ = dtbtrs(factor, np.take(steps, self._later, axis=-1).T, uplo="L", overwrite_b=True)
        return np.asarray(white.T)


def position_weight(noise: Noise, period_s: float) -> float:
    """1/mm²: what one picture's position counts beside its neighbours, the mean diagonal of the inverse covariance."""
    walk = noise.position_drift**2 * period_s
    white = noise.position_mm**2
    return float((1 - np.sqrt(walk / (walk + 4 * white))) / white)


def _factor(walk: Array, shared: NDArray[np.bool_], white: float) -> Array:
    """(2, m) banded Cholesky factor of the covariance of differences: 2 w² + walk, and −w² between neighbours."""
    banded = np.zeros((2, walk.size))
    banded[0] = 2 * white**2 + walk
    banded[1, :-1] = np.where(shared, -(white**2), 0.0)
    factor, refused = dpbtrf(banded, lower=True)
    if refused:
        raise ValueError("the noise of the path leaves its covariance not positive definite")
    return np.asarray(factor)
