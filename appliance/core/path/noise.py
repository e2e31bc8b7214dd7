"""Models the noise of the residual path as a sum of parts, whose variances are learned from the path itself.

A row of the path (lateral, axial, turn) has white tracker noise, a walk in time, what leaving the plane adds, breathing
and pulse, and one offset for each chain (docs/method.md, section 7). The parts are dense covariances over blocks of a
tenth of a second or more: half a minute makes two hundred blocks, few enough to be factorised for every solution.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs, dtrtrs

from probewatch.appliance.core.path.blocks import BREATHING, MEMORY, PARTS, POSITIONS, PULSE, WHITE, Blocks
from probewatch.drivers.rigid import Array

_LEFT = np.array([1.0, 0.04, 0.04, 0.04, 1.0, 0.002, 0.5])
"""Share of each part's variance that is left at first where breaths are followed; it is learned from there. A larger
one takes more rounds to come down, a smaller one to come up. What breathing without a rhythm leaves in the walks does
not belong to them.
"""
_PULSE_HZ = np.arange(0.7, 2.51, 0.05)
"""Pulse rates that are tried, Hz: 42 to 150 a minute. A closer spacing costs time and changes nothing, given
`_BEATS_S`.
"""
_BEATS_S = 2.0
"""Time, s, for which a pulse keeps its rhythm: two beats, so that a rate 8 % beside the one tried still counts as that.
Without a rhythm, a pulse hides the tremor: sigma of the axial scale would be .8 instead of .25 % with known breaths
(in-plane, 30 s); a memory of 5 s gains nothing more.
"""
_FASTEST = 3.0
"""Factor by which a variance may grow or shrink in one round, squared where breaths are followed: without it, a part
that the motion does not show would run away.
"""
_TINY = 1e-12
"""Divisor used instead of zero: less than any motion shows of a variance."""
_OFFSET_MM, _OFFSET_RAD = 1e3, 10.0
"""Standard deviations, mm and rad, of a chain's unknown offset: as good as unknown, and small enough for double
precision.
"""
POSITION_FLOORS, ANGLE_FLOORS = (
    np.square([0.02, 0.01, 0.01, 0.012, 1e-3, 1e-3, 1e-3]),
    np.square(np.deg2rad([0.01, 0.02, 0.02, 0.02, 1e-4, 1e-4, 1e-4])),
)
"""Least noise that is believed, of each part (mm, mm/√s, mm/√mm, rad, mm; rad for the turn), squared: well below any
tracker's, so that a window which happens to fit does not count as certain, and equal poses do not divide by zero.
Larger floors would be reported as the sigma of a tracker that is better. Not measured.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Habit:
    """Holds what the breaths of one row of a path have in common.

    shape_mm: (8,) as in the state of `appliance.core.path.breaths.Breaths`. length_s: the usual length.
    """

    shape_mm: Array
    length_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """Holds the sizes of the parts of a path's noise.

    variances: (rows, PARTS), mm² or rad², in the units of `Blocks.parts`. followed: (rows, PARTS) what is left of them
    where breaths are followed, NaN in rows where they are not. habits: those of each row in which breaths were
    followed.
    """

    variances: Array
    followed: Array | None = None
    habits: Mapping[int, Habit] = field(default_factory=dict)


def _left(variances: Array) -> Array:
    """Returns the variances, (PARTS,), from which learning starts where breaths are followed. The part of a pulse that
    has no rhythm may be the tracker's.
    """
    left = variances * _LEFT
    left[MEMORY] += variances[PULSE] - left[PULSE]
    return np.asarray(left)


def _rhythm(apart_s: Array, hz: float) -> Array:
    return np.asarray(np.cos(2 * np.pi * hz * apart_s) * np.exp(-np.square(apart_s / _BEATS_S) / 2))


def covariances(blocks: Blocks, parts: Array, noise: Noise) -> Array:
    """Returns the covariance of the path, (rows, m, m) mm² or rad², each chain with an unknown offset, for noise that
    is known. parts: those of the blocks.
    """
    is_mm = np.isin(np.arange(len(noise.variances)), POSITIONS)
    sizes = np.maximum(noise.variances, np.where(is_mm[:, None], POSITION_FLOORS, ANGLE_FLOORS))
    offsets = np.square(np.where(is_mm, _OFFSET_MM, _OFFSET_RAD))
    return np.asarray(np.tensordot(sizes, parts, 1) + offsets[:, None, None] * blocks.same)


class Whitener:
    """Whitens one row with one set of variances.

    inverse: that of the covariance, (m, m). log_volume: log det of the covariance. It is factorised at the first use:
    where breaths are followed, every other whitener is replaced before that. Raises ValueError then, where the
    covariance is not positive definite.
    """

    def __init__(self, parts: Array, offsets: Array, variances: Array, followed: Array | None = None) -> None:
        self._parts, self._offsets, self._variances, self._followed = parts, offsets, variances, followed

    @cached_property
    def _tissue(self) -> Array:
        """Returns the covariance of the tissue's own motion, (m, m)."""
        flat = self._parts[BREATHING:].reshape(PARTS - BREATHING, -1)
        tissue = (self._variances[BREATHING:] @ flat).reshape(self._offsets.shape)
        if self._followed is not None:
            tissue += self._followed
        return np.asarray(tissue)

    @cached_property
    def _factor(self) -> Array:
        """Returns the lower triangle of Cholesky, (m, m)."""
        flat = self._parts[:BREATHING].reshape(BREATHING, -1)
        C = (self._variances[:BREATHING] @ flat).reshape(self._offsets.shape)
        C += self._tissue
        C += self._offsets
        factor, refused = dpotrf(C, lower=True, clean=True, overwrite_a=True)
        if refused:
            raise ValueError("the noise of the path leaves its covariance not positive definite")
        return np.asarray(factor)

    @cached_property
    def log_volume(self) -> float:
        """Returns the log det of the covariance."""
        return 2 * float(np.log(self._factor.diagonal()).sum())

    @cached_property
    def inverse(self) -> Array:
        """Returns the inverse of the covariance, (m, m)."""
        lower, _ = dpotri(self._factor, lower=True)
        whole = lower + lower.T
        whole.ravel("K")[:: len(whole) + 1] /= 2
        return np.asarray(whole)

    @cached_property
    def counted(self) -> Array:
        """Returns the spurious information, (2,), from tracker noise of variance 1: white, and with a memory."""
        white = self.inverse.diagonal() @ self._parts[WHITE].diagonal()
        return np.array([white, np.vdot(self.inverse, self._parts[MEMORY])])

    @cached_property
    def pretended(self) -> float:
        """Returns the spurious information on the scale from the tissue's own motion, which is in the picture's
        path.
        """
        return float(np.vdot(self.inverse, self._tissue))

    @cached_property
    def left_in(self) -> float:
        """Returns the same where the most likely motion of the tissue is taken out of the picture's path."""
        share = self.inverse @ self._tissue
        return max(float(np.trace(share) - np.vdot(share.T, share)), 0.0)

    def tissue(self, path: Array) -> Array:
        """Returns the most likely motion of the tissue, (m,), in a path (m,)."""
        return np.asarray(self._tissue @ self._pulled(path))

    def weighed(self, columns: Array, path: Array) -> Array:
        """Returns the products, (p,), of columns (p, m) with a path (m,), weighted by the inverse of the covariance."""
        return np.asarray(columns @ self._pulled(path))

    def _pulled(self, path: Array) -> Array:
        pulled, _ = dpotrs(self._factor, path, lower=True)
        return np.asarray(pulled)

    def white(self, columns: Array) -> Array:
        """Returns the innovations (…, m) of columns (…, m), of unit variance and in time order."""
        flat = columns.reshape(-1, columns.shape[-1])
        innovations, _ = dtrtrs(self._factor, flat.T, lower=True)
        return np.asarray(innovations.T).reshape(columns.shape)

    def coloured(self, innovations: Array) -> Array:
        """Returns the row, (m,), of which these are the innovations, (m,)."""
        return np.asarray(self._factor @ innovations)


class LearnedNoise:
    """Learns the noise of the rows of one residual by restricted maximum likelihood (REML): variances rise or fall by
    the MM algorithm (Zhou, Hu, Zhou and Lange 2019), which keeps them positive.
    """

    def __init__(self, blocks: Blocks, parts: Array, noise: Noise, given: Array | None = None) -> None:
        """Starts from `noise`. parts: (PARTS, m, m) of the blocks. given: (k, m, m) covariance that is added to the
        first k rows, whatever is learned.
        """
        self._parts = [parts] * len(noise.variances)
        self._blocks = blocks
        positions = np.isin(np.arange(len(noise.variances)), POSITIONS)
        self._floors = np.where(positions[:, None], POSITION_FLOORS, ANGLE_FLOORS)
        self._offsets = [blocks.same * np.square(_OFFSET_MM if is_mm else _OFFSET_RAD) for is_mm in positions]
        for k, known in enumerate(() if given is None else given):
            self._offsets[k] = self._offsets[k] + known
        self._left_open: dict[int, Array] = {}
        self._unfollowed: dict[int, Array] = {}
        self.noise = replace(noise, variances=np.maximum(noise.variances, self._floors))
        self.rows = [self._whitener(k) for k in range(len(self._offsets))]

    def _whitener(self, k: int) -> Whitener:
        return Whitener(self._parts[k], self._offsets[k], self.noise.variances[k], self._left_open.get(k))

    def learn(self, residual: Array, J: Array, covariance: Array) -> None:
        """Learns the noise of a window by (15). residual: (rows, m) at the estimate, free of outliers. J: (rows, p, m).
        covariance: (p, p) of θ, by the noise as it is.

        Where breaths are followed, only those rows learn, in longer steps: their variances fall far at first.
        """
        variances, power = self.noise.variances.copy(), 1.0 if self._left_open else 0.5
        learning = list(self._left_open or range(len(self.rows)))
        for k in learning:
            row, parts = self.rows[k], self._parts[k]
            pulled = row.inverse @ residual[k]
            lever = row.inverse @ J[k].T
            P = row.inverse - lever @ covariance @ lever.T
            # Observed and expected size of each part, of whose ratio (15) takes the root.
            told = parts @ pulled @ pulled
            expected = parts.reshape(PARTS, -1) @ P.ravel()
            ratio = np.clip(told / np.maximum(expected, _TINY), _FASTEST**-2, _FASTEST**2)
            variances[k] *= ratio**power
        self._take(variances, learning)

    def _take(self, variances: Array, rows: Iterable[int]) -> None:
        self.noise = replace(self.noise, variances=np.maximum(variances, self._floors))
        for k in rows:
            self.rows[k] = self._whitener(k)

    def breathing(self, k: int, path: Array) -> Array:
        """Returns the most likely breathing, (m,), in a path (m,) of row k."""
        own = self.noise.variances[k, BREATHING] * self._parts[k][BREATHING]
        return np.asarray(own @ (self.rows[k].inverse @ path))

    def expect_breaths(self, inside: Mapping[int, NDArray[np.bool_]], path: Array) -> None:
        """Starts to follow breaths: the breathing keeps only what is unlike them, and the pulse gets a rhythm.

        inside: for each row with breaths, (m,) where there are any; elsewhere the breathing stays as it is. path:
        (rows, m).
        """
        first, variances = next(iter(inside)), self.noise.variances.copy()
        for k, within in inside.items():
            breathing = self.noise.variances[k, BREATHING] * self._parts[k][BREATHING]
            self._unfollowed[k] = breathing * np.outer(~within, ~within)
            known = None if self.noise.followed is None else self.noise.followed[k]
            variances[k] = _left(variances[k]) if known is None or np.isnan(known).any() else known
        parts = self._parts[first].copy()
        parts[PULSE] = _rhythm(self._blocks.apart_s, self._pulse_hz(first, path[first]))
        for k in inside:
            self._parts[k] = parts
        self._take(variances, inside)

    def follow(self, k: int, covariance: Array) -> Whitener:
        """Returns the whitener of row k from here on. covariance: (m, m) of what the breaths that are followed leave
        open.
        """
        self._left_open[k] = covariance + self._unfollowed[k]
        self.rows[k] = self._whitener(k)
        return self.rows[k]

    def left(self, rows: list[int]) -> Array:
        """Returns the variances of these rows, (rows, PARTS), as in `Noise.followed`."""
        left = np.full_like(self.noise.variances, np.nan)
        left[rows] = self.noise.variances[rows]
        return left

    def _pulse_hz(self, k: int, path: Array) -> float:
        """Returns the pulse rate, Hz, that row k shows most strongly by its noise without a pulse."""
        variances = self.noise.variances[k].copy()
        variances[PULSE] = self._floors[k, PULSE]
        row = Whitener(self._parts[k], self._offsets[k], variances)
        angle = 2 * np.pi * _PULSE_HZ[:, None] * self._blocks.t_s
        waves = row.white(np.stack([np.cos(angle), np.sin(angle)], axis=1))
        told = waves @ row.white(path)
        amplitude = np.linalg.solve(waves @ waves.swapaxes(1, 2), told[..., None])[..., 0]
        return float(_PULSE_HZ[int(np.argmax(np.sum(told * amplitude, axis=1)))])
