"""Noise of the residual path: white tracker noise and a random walk, on an offset of its own for each chain.

Within a chain the differences of successive residuals are free of the offset; their covariance is tridiagonal, so
whitening costs time in proportion to the pictures.
"""

from dataclasses import astuple, dataclass
from functools import cached_property
from math import sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded
from scipy.linalg.lapack import dtbtrs

from appliance.core.geometry import Array

_SAME_NOISE = 0.1
_LEAST_QUIET = 8
_LOST_MM = 2.0
"""mm² of random walk per mm out of the picture plane: a slanted structure moves through the picture as fast as the
probe leaves its plane, and goes on doing so for about two millimetres.
"""
_LONG_LAG_S = 0.7
_CHANCE = 2.5
_SHORT_WAY_S = 1.0
"""Drift is an error of the picture's path, on which the scales are regressed: over ways shorter than this it shrinks
them. White noise as large as the drift over that time lets the longer ways count.
"""
_POSITION_FLOOR_MM, _ANGLE_FLOOR_RAD = 0.02, np.deg2rad(0.01)
_POSITION_DRIFT_FLOOR, _ANGLE_DRIFT_FLOOR = 0.01, np.deg2rad(0.02)


@dataclass(frozen=True, slots=True)
class Noise:
    """White sd and random-walk sd per √s, of positions (mm) and angles (rad)."""

    position_mm: float
    position_drift: float
    angle_rad: float
    angle_drift: float

    def like(self, other: "Noise") -> bool:
        """Whether another round with this noise would give the same answer."""
        own, others = np.array(astuple(self)), np.array(astuple(other))
        return bool(np.all(np.abs(own - others) <= _SAME_NOISE * others))


@dataclass(frozen=True, eq=False)
class Times:
    """t_s, chain (n,) of the residuals, in time order; hidden_mm (n,): way out of the picture plane before each."""

    t_s: Array
    chain: NDArray[np.int64]
    hidden_mm: Array

    @cached_property
    def joined(self) -> NDArray[np.bool_]:
        """(n − 1,) whether a residual and the next belong to one chain."""
        return np.asarray(self.chain[1:] == self.chain[:-1])

    @cached_property
    def period_s(self) -> float:
        """Usual time between two pictures."""
        return max(float(np.median(np.diff(self.t_s))), 1e-3)

    def quiet(self, lag: int) -> NDArray[np.bool_]:
        """(n − lag,) whether nothing was hidden between a residual and the one `lag` later in its chain."""
        hidden = np.cumsum(self.hidden_mm)
        return np.asarray((self.chain[lag:] == self.chain[:-lag]) & (hidden[lag:] - hidden[:-lag] <= 1e-9))

    def estimated_noise(self, residual: Array) -> Noise:
        """Of a residual path (n, ≥ 3): in-plane mm (2), angle rad; by its structure function, which outliers spare."""
        white, drift = self._structure(residual[:, :2], _POSITION_FLOOR_MM, _POSITION_DRIFT_FLOOR)
        position = max(white, drift * sqrt(_SHORT_WAY_S)), drift
        angle = self._structure(residual[:, 2:3], _ANGLE_FLOOR_RAD, _ANGLE_DRIFT_FLOOR)
        return Noise(*position, *angle)

    def _structure(self, path: Array, floor: float, drift_floor: float) -> tuple[float, float]:
        """White noise and drift from the squared differences at one frame and at `_LONG_LAG_S`."""
        long_lag = max(2, min(round(_LONG_LAG_S / self.period_s), path.shape[0] // 3))
        short, long = (self._lagged_variance(path, lag) for lag in (1, long_lag))
        chance = 1 + _CHANCE * np.sqrt(3 / max((path.shape[0] - long_lag) * path.shape[1], 1))
        drift_variance = max((long - short * chance) / ((long_lag - 1) * self.period_s), drift_floor**2)
        white = max((short - drift_variance * self.period_s) / 2, floor**2)
        return float(np.sqrt(white)), float(np.sqrt(drift_variance))

    def _lagged_variance(self, path: Array, lag: int) -> float:
        told = self.quiet(lag)
        if np.count_nonzero(told) < _LEAST_QUIET:
            told = self.chain[lag:] == self.chain[:-lag]
        change = np.abs((path[lag:] - path[:-lag])[told]).ravel()
        middle = change.size // 2
        return float((1.4826 * np.partition(change, middle)[middle]) ** 2) if change.size else 0.0


class Whitener:
    """Turns the steps of a residual path into innovations of unit variance, one fewer than pictures in each chain.

    rows: columns of the path: in-plane position (2), angle[, elevational position, tilt (2)].
    """

    def __init__(self, times: Times, noise: Noise, rows: int) -> None:
        self._joined = times.joined
        dt_s = np.diff(times.t_s)[self._joined]
        lost_mm2 = _LOST_MM * times.hidden_mm[1:][self._joined]
        # Two successive differences share a residual where no chain ended between them.
        self._shared = np.diff(np.flatnonzero(self._joined)) == 1
        position = _factor(noise.position_drift**2 * dt_s + lost_mm2, self._shared, noise.position_mm)
        angle = _factor(noise.angle_drift**2 * dt_s, self._shared, noise.angle_rad)
        kinds = [(position, [0, 1]), (angle, [2])]
        self._kinds = kinds if rows == 3 else [(position, [0, 1, 3]), (angle, [2, 4, 5])]
        self.log_volume = sum(2 * float(np.log(factor[0]).sum()) * len(columns) for factor, columns in self._kinds)

    def __call__(self, steps: Array) -> Array:
        """(n, rows, …), of which the first of each chain is left out → (m, rows, …)."""
        steps = steps[1:][self._joined]
        out = np.empty_like(steps)
        for factor, columns in self._kinds:
            block = steps[:, columns]
            white, _ = dtbtrs(factor, block.reshape(len(block), -1), uplo="L")
            out[:, columns] = white.reshape(block.shape)
        return out


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
    return np.asarray(cholesky_banded(banded, lower=True, check_finite=False))
