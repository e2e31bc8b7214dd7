"""Groups a path into blocks and gives the covariance over them of each part of its noise: white tracker noise, walks,
what leaving the plane adds, breathing and pulse (docs/method.md, section 7).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf

from probewatch.appliance.core.times import QUIET_BREATH_S
from probewatch.drivers.rigid import Array

_BLOCK_S, _MOST_BLOCKS = 0.1, 200
"""Time, s, within which pictures of one chain count as one block, at their mean, and the largest number of blocks. A
longer time loses the quick part of a tremor, which ends at 8 Hz; a shorter one costs time with the third power of the
number of blocks, so a long window has longer ones.
"""
LATERAL, AXIAL, TURN, ELEVATIONAL = range(4)
"""Rows of a residual. Where the motion is known to be planar, the elevational position and the two tilts follow."""
POSITIONS = (LATERAL, AXIAL, ELEVATIONAL)
WHITE, WALK, WAY, SLANT, MEMORY, BREATHING, PULSE = range(7)
"""The parts of the noise, in the order of `Noise.variances`; those from BREATHING on are the tissue's own motion."""
PARTS = PULSE + 1
"""Number of these parts."""
TRACKER = [WHITE, MEMORY]
"""Parts that come from the poses: they are in the path that is predicted, and in its derivatives."""
_SLANT_MM = 3.0
"""Out-of-plane displacement, mm, over which a slanted structure keeps shifting the picture in the same manner: twice
the thickness of the slice. A longer one asks for more motion: with 2 and 3 mm the errors of the rotations about lateral
and about axial and of the elevational offset were 1.20, 1.22, 1.17 and 1.07, 1.21, 1.05 of their sigmas (gesture of 8 s
on rigid tissue, ten seeds); with displacements of the picture's middle alone they were 1.87, 1.41 and 1.66.
"""
_LEADING = 3
"""Number of leading rows, displacement and tilts out of the plane, that mislead a registration. The turn in the plane,
which follows them, only changes the speckle: a rock by 16° left .02 mm and .06°, a fan .07 mm and .23° (eight seeds).
"""
_SMOOTH_BLOCKS = 5
"""Number of blocks over which the out-of-plane displacement is smoothed before its length is taken: tracker noise alone
would otherwise add 3 mm/s to it.
"""
_BREATHING_S, _PULSE_S = QUIET_BREATH_S / 4, 0.15
"""Times, s, over which the tissue's own motion stays correlated: a quarter of a quiet breath, and of a beat. A rhythm
fitted over half a minute biases the axial scale by ten of its sigmas as soon as breaths differ by a tenth from one
another (four seeds of the study's tissue); this model does not.
"""
_MEMORY_S = 0.15
"""Time constant, s, with which a tracker that filters its poses forgets a reading: exp(−t/.15 s) is .9 from one reading
at 60 Hz to the next. When such noise was taken for a pulse, it was deemed to be in the picture and biased the scales.
Other time constants were not tried.
"""
AGREEMENT_LAG_S = 0.5
"""Time, s, over which the steps of the two paths are compared. With a shorter one, tracker noise spoils the correlation
of good calibrations; with a longer one, few steps are independent in a window of 3.5 s. Not measured.
"""
_LEAST_MOVED_MM = 0.2
"""Standard deviation, mm, of those steps along an axis, below which there was no motion along it and its correlation
would be noise.
"""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Represents m blocks of a path, in time order.

    t_s, chain and count of pictures: (m,). starts: index of the first picture of each block.
    """

    t_s: Array
    chain: NDArray[np.int64]
    count: Array
    starts: NDArray[np.intp]

    @classmethod
    def of(cls, t_s: Array, chain: NDArray[np.int64]) -> "Blocks":
        """Groups pictures into blocks. t_s, chain: (n,) of pictures in time order, those of a chain side by side."""
        block_s = max(_BLOCK_S, float(np.ptp(t_s)) / _MOST_BLOCKS)
        tick = np.floor(t_s / block_s).astype(np.int64)
        starts = np.flatnonzero(np.diff(tick, prepend=tick[0] - 1) | np.diff(chain, prepend=chain[0] - 1))
        count = np.diff(starts, append=t_s.size).astype(np.float64)
        return cls(np.add.reduceat(t_s, starts) / count, chain[starts], count, starts)

    def __len__(self) -> int:
        return int(self.t_s.size)

    def last(self, n: int) -> "Blocks":
        """Returns the last n blocks. They belong to the path, not to its pictures: `starts` counts from the first
        picture of all.
        """
        return Blocks(self.t_s[-n:], self.chain[-n:], self.count[-n:], self.starts[-n:])

    def means(self, columns: Array) -> Array:
        """Returns the mean of each block: (…, n) of pictures → (…, m) of blocks."""
        return np.asarray(np.add.reduceat(columns, self.starts, axis=-1) / self.count)

    def without_offsets(self, values: Array) -> Array:
        """Returns values (…, m) less the mean of each chain."""
        left = np.array(values)
        for chain in np.unique(self.chain):
            own = self.chain == chain
            left[..., own] -= values[..., own].mean(axis=-1, keepdims=True)
        return left

    def steps(self, path: Array, lag: int) -> Array:
        """Returns the steps (k,) of a path (m,) over `lag` blocks, each within one chain."""
        same = self.chain[lag:] == self.chain[:-lag]
        return np.asarray((path[lag:] - path[:-lag])[same])

    def agreement(self, seen_mm: Array, missed_mm: Array, lag_s: float = AGREEMENT_LAG_S) -> float:
        """Returns the correlation of the steps over lag_s of a measured path (m,) with those of the predicted path,
        which is the measured one less `missed_mm`; NaN where the probe has not moved, or for less than lag_s.
        """
        lag = max(1, round(lag_s / max(float(np.median(np.diff(self.t_s))), 1e-3)))
        moved, missed = self.steps(seen_mm, lag), self.steps(missed_mm, lag)
        if len(moved) <= 2 or moved.std() <= _LEAST_MOVED_MM:
            return float("nan")
        return float(np.corrcoef(moved, moved - missed)[0, 1])

    @cached_property
    def same(self) -> NDArray[np.bool_]:
        """Returns whether two blocks are of one chain, (m, m)."""
        return np.asarray(self.chain[:, None] == self.chain)

    @cached_property
    def apart_s(self) -> Array:
        """Returns the times between blocks, (m, m) s."""
        return np.asarray(np.abs(self.t_s[:, None] - self.t_s))

    def parts(self, away_mm: Array) -> Array:
        """Returns the covariance of each part for variance 1, (PARTS, m, m). away_mm: (k, m) how far the picture is out
        of its plane, as of `PathResidual`.

        The variances have these units. White: mm² of one picture. Walks: mm² per s, and per mm travelled out of the
        plane. Slant: rad² of the slope. Memory, breathing and pulse: mm² of their size.
        """
        places = np.stack([_smoothed(row) for row in np.atleast_2d(away_mm)])
        steps = np.diff(places, axis=1, prepend=places[:, :1])
        middles, steps = places - steps / 2, steps[:_LEADING]
        parts = self._of_time.copy()
        parts[WAY] = self._walk(np.sqrt(np.square(steps).sum(axis=0)).cumsum())
        parts[SLANT] = _slant(middles, steps)
        return parts

    @cached_property
    def _of_time(self) -> Array:
        """Returns `parts`, (PARTS, m, m), with zeros for those that depend on the displacement out of the plane."""
        parts = np.zeros((PARTS, len(self), len(self)))
        parts[WHITE] = np.diag(1 / self.count)
        parts[WALK] = self._walk(self.t_s)
        parts[MEMORY] = self._remembered()
        for part, memory_s in ((BREATHING, _BREATHING_S), (PULSE, _PULSE_S)):
            parts[part] = np.exp(-np.square(self.apart_s / memory_s) / 2)
        return parts

    def _remembered(self) -> Array:
        """Returns the covariance of noise with a memory, as means over whole blocks: within one, such noise averages
        out in part. When it was evaluated at the middles of the blocks, it was learned with half of its variance.
        """
        usual_s = float(np.median(np.diff(self.t_s))) if len(self) > 1 else _BLOCK_S
        length_s = self.count / np.median(self.count) * usual_s
        covariance = self._of_means(length_s)
        gaps_s = np.diff(self.t_s)
        room_s = np.minimum(np.append(gaps_s, np.inf), np.append(np.inf, gaps_s))
        # Where only some pictures were kept, blocks may overlap and the matrix may not be positive definite.
        if np.any(length_s > room_s) and dpotrf(covariance, lower=True)[1]:
            covariance = self._of_means(np.minimum(length_s, room_s))
        return covariance

    def _of_means(self, length_s: Array) -> Array:
        """Returns the covariance of such means over intervals of length_s about the time of each block; it may not be
        positive definite where these overlap too far.
        """
        length = length_s / _MEMORY_S
        shared = np.sinh(length / 2) / (length / 2)
        covariance = np.exp(-self.apart_s / _MEMORY_S) * np.outer(shared, shared)
        np.fill_diagonal(covariance, 2 * (length - 1 + np.exp(-length)) / length**2)
        return np.asarray(covariance)

    def _walk(self, along: Array) -> Array:
        """Returns the covariance of a random walk that begins with each chain. along: (m,) time or distance with which
        its variance grows.
        """
        _, first, index = np.unique(self.chain, return_index=True, return_inverse=True)
        since = along - along[first[index]]
        return np.where(self.same, np.minimum(since[:, None], since), 0.0)


def _smoothed(values: Array) -> Array:
    half = _SMOOTH_BLOCKS // 2
    padded = np.pad(values, half, mode="edge")
    return np.convolve(padded, np.full(_SMOOTH_BLOCKS, 1 / _SMOOTH_BLOCKS), mode="valid")


def _slant(places_mm: Array, steps_mm: Array) -> Array:
    """Returns the covariance (m, m) of a path that slanted structures mislead. Their slopes, one for each direction,
    are alike at places near each other: a structure that is passed twice shifts the picture twice in the same manner.

    places_mm, steps_mm: (k, m), middles of the steps and the steps.
    """
    square = np.square(places_mm).sum(axis=0)
    apart_mm = np.sqrt(np.maximum(square[:, None] + square - 2 * places_mm.T @ places_mm, 0.0))
    alike = np.exp(-apart_mm / _SLANT_MM) * (steps_mm.T @ steps_mm)
    return np.asarray(alike.cumsum(axis=0).cumsum(axis=1))
