"""A leap in a path that a hand makes smoothly: fitted as a step within a cubic, weighed against what the fit leaves.

An outlier makes the fit worse, not the step certain: what is left grows with it.
"""

from dataclasses import dataclass

import numpy as np

from drivers.rigid import Array

_DEGREE, _LEAST_SPARE = 3, 4
"""Of the polynomial in time, and readings beyond the unknowns below which it is one less. A lower one takes the turn of
a hand for a leap, a higher one the leap for a turn; a third of a second of a gesture at 1.5 s is a cubic to .01 mm."""

_CLEAN = 0.25
"""Of a leap. An outlier of two of the readings after it leaves .3 and more; the noise of a leap of 8 sigmas .3 at
most, and .15 usually."""


@dataclass(frozen=True, slots=True, eq=False)
class Leap:
    """size, sigma: of each row, in its unit; sigma from what the fit left of its kind (moves, turns). left: the most
    that it left of a row of one reading."""

    size: Array
    sigma: Array
    left: Array

    @property
    def certain(self) -> float:
        """The largest size in its own sigmas."""
        return float(np.max(np.abs(self.size) / self.sigma))

    @property
    def clean(self) -> bool:
        """Whether every reading lies much nearer to the fit than the surest row leapt: an outlier leaves one far."""
        row = int(np.argmax(np.abs(self.size) / self.sigma))
        return bool(self.left[row] <= _CLEAN * abs(self.size[row]))


def fit_leap(t_s: Array, path: Array, after: int, floor: Array) -> Leap | None:
    """The step between readings after − 1 and after; None where there are too few.

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
    sigma = np.sqrt(np.maximum(kinds, floor**2) * np.square(inverse[0]).sum())
    return Leap(found[0], sigma, left.max(axis=0))
