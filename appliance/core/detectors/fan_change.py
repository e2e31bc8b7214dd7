"""Computes the shift and stretch between two fans: what a grabber or another depth does to the whole picture.

A stretch and a shift move all borders; a shadow, a narrower sector or a darker depth moves some of them. So what
stretch and shift leave unchanged (both opening angles, the ratio of the radii) must be alike, or nothing is concluded.
"""

from dataclasses import dataclass

import numpy as np

from probewatch.appliance.core.detectors.fan import Fan
from probewatch.appliance.core.detectors.fan_borders import BOTTOM_RADIUS, LEFT_SLOPE
from probewatch.drivers.rigid import Array

_ROUNDS = 3
"""Rounds of least squares: they find a stretch by a half and a shift by half of the picture to 10⁻⁴."""
_MOST_MISFIT = 16.0
"""Largest χ² of what stretch and shift leave, over 2 or 3 numbers, for a pair to be one picture stretched. A lower one
misses changes where sigma is small; a higher one takes shadows for stretches."""
_NARROWED = 0.02
"""Logarithm of the stretch from which a narrower sector may explain the change as well, where no arc decides; no sector
is narrowed by less. A lower value misses lateral stretches of fans whose arcs are seen badly."""
_CONTENT_SHARE = 0.0005
"""Relative difference of opening angles and radii that is allowed beyond their sigmas where a picture was stretched,
because pixels are whole."""


@dataclass(frozen=True, slots=True, eq=False)
class FanChange:
    """Holds the change from one fan to another.

    stretch: (2,) logarithms, lateral and axial. shift_px: (2,) shift of the picture's middle. covariance: (4, 4) of
    these four. deeper: whether the lower arc is at another depth, as where the scanner shows another one, or not seen.
    """

    stretch: Array
    shift_px: Array
    covariance: Array
    deeper: bool

    @property
    def sigmas(self) -> Array:
        """Returns the standard deviations, (4,), of stretch and shift."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def change_between(before: Fan, now: Fan, size_px: tuple[int, int]) -> FanChange | None:
    """Returns the change of the fan in pictures of this size; None where no stretch and shift explains it."""
    arcs = np.isfinite(before.numbers[BOTTOM_RADIUS]) and np.isfinite(now.numbers[BOTTOM_RADIUS])
    for numbers in ([7] if arcs else []) + [6]:
        found = _explained(before, now, size_px, numbers)
        if found is not None:
            much = float(np.max(np.abs(found.stretch))) > _NARROWED
            return None if much and _narrowed(before, now, numbers) else found
    return None


def _narrowed(before: Fan, now: Fan, numbers: int) -> bool:
    """Returns whether both may be one fan except for the opening angles: apex, aspect and radii are alike."""
    kept = [k for k in range(numbers) if k not in (LEFT_SLOPE, LEFT_SLOPE + 1)]
    left = (_logarithms(now.numbers) - _logarithms(before.numbers))[kept]
    doubt = (_doubt(before) + _doubt(now))[np.ix_(kept, kept)]
    return float(left @ np.linalg.solve(doubt, left)) <= _MOST_MISFIT


def _explained(before: Fan, now: Fan, size_px: tuple[int, int], numbers: int) -> FanChange | None:
    """Solves for the change by the first `numbers` numbers of the fans; None where it does not explain them."""
    middle = (np.array(size_px) - 1) / 2
    one, other = _logarithms(before.numbers)[:numbers], _logarithms(now.numbers)[:numbers]
    doubt = _doubt(before)[:numbers, :numbers] + _doubt(now)[:numbers, :numbers]
    doubt = doubt + _CONTENT_SHARE**2 * np.diag([0, 0, 1, 1, 0, 0, 1])[:numbers, :numbers]
    weight = np.linalg.inv(doubt)
    # Gauss–Newton: the slopes are linearised again about the change of the last round.
    change = np.zeros(4)
    for _ in range(_ROUNDS):
        left = other - _changed(one, change, middle)
        slopes = _slopes(one, change, middle)
        covariance = np.linalg.inv(slopes.T @ weight @ slopes)
        change = change + covariance @ slopes.T @ weight @ left
    left = other - _changed(one, change, middle)
    if float(left @ weight @ left) > _MOST_MISFIT:
        return None
    return FanChange(change[:2], change[2:], np.asarray(covariance, np.float64), numbers == 6)


def _logarithms(numbers: Array) -> Array:
    """Returns the numbers of a fan, (7,), with logarithms of all but the apex."""
    return np.concatenate([numbers[:LEFT_SLOPE], np.log(numbers[LEFT_SLOPE:])])


def _doubt(fan: Fan) -> Array:
    """Returns the covariance, (7, 7), of these logarithms.

    Errors that all pictures share are left out, because both fans of a pair have them.
    """
    inner = np.concatenate([[1, 1], 1 / fan.numbers[LEFT_SLOPE:]])
    return np.asarray(fan.noise * np.outer(inner, inner))


def _changed(fan: Array, change: Array, middle: Array) -> Array:
    """Returns a fan after a stretch about the picture's middle and a shift, both fans as in `_logarithms`."""
    lateral, axial = change[:2]
    apex = middle + np.exp(change[:2]) * (fan[:2] - middle) + change[2:]
    beside = lateral - axial
    return np.concatenate([apex, fan[2:] + np.array([beside, beside, -beside, axial, axial])[: fan.size - 2]])


def _slopes(fan: Array, change: Array, middle: Array) -> Array:
    """Returns the derivatives, (n, 4), of that fan by the change."""
    slopes = np.zeros((7, 4))
    slopes[[0, 1], [0, 1]] = np.exp(change[:2]) * (fan[:2] - middle)
    slopes[[0, 1], [2, 3]] = 1
    slopes[2:4, 0], slopes[2:4, 1] = 1, -1
    slopes[4, :2] = -1, 1
    slopes[5:, 1] = 1
    return slopes[: fan.size]
