"""Computes how much information a motion gives, in natural units: singular values of the information in 1°, 1 % and 1
mm.
"""

from dataclasses import dataclass

import numpy as np

from probewatch.drivers.rigid import Array

_SHOWN = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Observability:
    """Holds how well a motion determines the parameters, in natural units.

    singular: (p,) falling; a direction with singular value s is known to 1/s. directions: (p, p), one a row. sigma:
    (p,) of each parameter. known: (p,) bool per parameter: better than one unit.
    """

    singular: Array
    directions: Array
    sigma: Array

    @property
    def known(self) -> tuple[bool, ...]:
        return tuple(bool(s < _SHOWN) for s in self.sigma)


def natural_units(scales: int) -> Array:
    """Returns the natural units, (3 + scales + 3,): 1° in rad, 1 % and 1 mm, for rotation, relative scale and
    offset.
    """
    return np.array([np.deg2rad(1.0)] * 3 + [0.01] * scales + [1.0] * 3)


def observability(information: Array) -> Observability:
    """Computes how well an information determines the parameters. information: (p, p) of rotation rad, relative scale,
    offset mm, p = 8 for pictures and 9 for volumes.
    """
    unit = natural_units(len(information) - 6)
    values, vectors = np.linalg.eigh(information * np.outer(unit, unit))
    singular = np.sqrt(np.maximum(values[::-1], 0.0))
    directions = vectors.T[::-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = np.where(directions**2 > 1e-12, directions**2 / singular[:, None] ** 2, 0.0)
    return Observability(singular, directions, np.sqrt(shares.sum(axis=0)))
