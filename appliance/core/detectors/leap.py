"""Finds a leap in the smooth path of a hand: fits it as a step within a cubic and compares it with the residuals.

An outlier makes the fit worse and not the step certain, because the residuals grow with it.
"""

from dataclasses import dataclass

import numpy as np

from probewatch.drivers.rigid import Array

_DEGREE, _LEAST_SPARE = 3, 4
"""Degree of the polynomial in time, and the readings beyond the unknowns below which the degree is one less. A lower
degree takes the turn of a hand for a leap, a higher one a leap for a turn; a third of a second of a gesture with a
period of 1.5 s is a cubic to .01 mm."""

_CLEAN = 0.25
"""Largest residual of a clean fit, as a share of the leap. An outlier of two of the readings after it leaves .3 and
more; the noise of a leap of 8 sigmas leaves .3 at most, and .15 usually."""
_LEAST_BESIDE, _OF_BOTH = 2, 1.5
"""Fewest readings that must be compared with the past, and the variance of such a difference, in that of one reading,
where the past is interpolated between two: 1.5 half-way, 2 at a reading."""


@dataclass(frozen=True, slots=True, eq=False)
class Leap:
    """Holds a fitted leap.

    size, sigma: of each row, in its unit; sigma comes from the residuals of all rows of its kind (moves, turns). left:
    largest residual of each row. noise: standard deviation of a reading, from the same residuals.
    """

    size: Array
    sigma: Array
    left: Array
    noise: Array

    @property
    def certain(self) -> float:
        """Returns the largest size of a row, in its own sigmas."""
        return float(np.max(np.abs(self.size) / self.sigma))

    @property
    def clean(self) -> bool:
        """Returns whether every reading is much nearer to the fit than the most certain row leapt.

        An outlier leaves one reading far from the fit.
        """
        row = int(np.argmax(np.abs(self.size) / self.sigma))
        return bool(self.left[row] <= _CLEAN * abs(self.size[row]))


def fit_leap(t_s: Array, path: Array, after: int, floor: Array) -> Leap | None:
    """Fits the step between readings after − 1 and after; returns None where there are too few readings.

    t_s: (n,). path: (n, 3 k), k kinds of three rows each. floor: (3 k,) least standard deviation of a reading.
    """
    n = t_s.size
    degree = _DEGREE if n - _DEGREE - 2 >= _LEAST_SPARE else _DEGREE - 1
    spare = n - degree - 2
    if spare < 1 or after < 2 or n - after < 2:
        return None
    span_s = float(t_s[-1] - t_s[0])
    powers = ((t_s - t_s[after]) / span_s)[:, None] ** np.arange(degree + 1)
    basis = np.column_stack([np.arange(n) >= after, powers])
    inverse = np.linalg.pinv(basis)
    found = inverse @ path
    left = np.abs(path - basis @ found)
    kinds = np.repeat(np.square(left).sum(axis=0).reshape(-1, 3).mean(axis=1) / spare, 3)
    noise = np.sqrt(np.maximum(kinds, floor**2))
    return Leap(found[0], noise * float(np.linalg.norm(inverse[0])), left.max(axis=0), noise)


def around_step(t_ns: Array, after: int, to: int, within_ns: int) -> list[int]:
    """Returns the indices of four readings in order, of which the two in the middle are the ends of a step.

    The outer two are within_ns before and after it, and show the velocity there; the first two are the same where
    nothing precedes the step.
    """
    first = int(np.searchsorted(t_ns, t_ns[after - 1] - within_ns, side="right")) - 1
    last = int(np.searchsorted(t_ns, t_ns[to] + within_ns))
    return [min(max(first, 0), after - 1), after - 1, to, min(max(last, to + 1), t_ns.size - 1)]


def uneven_step(t_s: Array, path: Array) -> Array:
    """Returns how far a step is, (rows,), from what the mean of the velocities before and after it predicts.

    For a wave of angular frequency ω that is the share (ω dt)²/2 of the step. path: (4, rows) at the four readings of
    `around_step`. t_s: their times, in any unit.
    """
    later = (path[3] - path[2]) / (t_s[3] - t_s[2])
    before = (path[1] - path[0]) / (t_s[1] - t_s[0]) if t_s[0] < t_s[1] else later
    return np.asarray(path[2] - path[1] - (t_s[2] - t_s[1]) * (before + later) / 2)


def retraced(past_s: Array, past: Array, t_s: Array, path: Array, noise: Array) -> float:
    """Returns how closely a path repeats what went before: the least mean square of the difference over all lags.

    It is in units of the mean square of the noise of both, and infinite where no lag compares two readings with the
    past. past_s: (m,) ascending. past: (m, rows). t_s: (n,) later times. path: (n, rows). noise: (rows,) standard
    deviation of a reading.
    """
    period_s = float(np.median(np.diff(past_s)))
    lags_s = np.arange(t_s[0] - past_s[-1], t_s[0] - past_s[0], period_s)
    asked_s = t_s - lags_s[:, None]
    known = (asked_s <= past_s[-1]) & (asked_s >= past_s[0])
    then = np.stack([np.interp(asked_s, past_s, row) for row in past.T], axis=-1)
    apart = (path - then) * known[..., None] / (noise * np.sqrt(_OF_BOTH))
    # Between two lags the difference changes linearly, so its least square is found in closed form.
    first, change = apart[:-1], np.diff(apart, axis=0)
    both = np.logical_and(known[:-1], known[1:])
    first, change = first * both[..., None], change * both[..., None]
    power = np.square(change).sum(axis=(1, 2))
    share = np.clip(-(first * change).sum(axis=(1, 2)) / np.maximum(power, 1e-12), 0.0, 1.0)
    counted = np.count_nonzero(both, axis=1)
    squares = np.square(first + share[:, None, None] * change).mean(axis=2).sum(axis=1) / np.maximum(counted, 1)
    return float(np.min(squares[counted >= _LEAST_BESIDE], initial=np.inf))
