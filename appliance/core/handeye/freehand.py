"""Solves the freehand two-row form: Λ u = [R_x v]_xy, where the picture shows two components of a motion in all three.

v is the displacement of the picture's centre in sensor axes with the nominal lever arm (`Motions.displacements`), which
is accurate enough within 5 mm of the truth. For each axis λ u = r · v with |r| = 1: with λ eliminated, r is the lowest
eigenvector of Σ v vᵀ − Σ u v Σ u vᵀ / Σ u². Tracker noise adds a multiple of the identity there, so r is unbiased, and
λ = Σ u r·v / Σ u² is regressed on the clean side. In purely planar motion the plane's normal would serve as r equally
well, so v must span 3 directions.
"""

import numpy as np

from probewatch.appliance.core.handeye.motions import HandEye, independent, rows_to_rotation, without_offset
from probewatch.appliance.core.handeye.sums import Sums
from probewatch.drivers.rigid import Array

_SEPARATION = 3.0
"""Variance along the second-smallest direction ÷ that along the smallest, which is noise. Less lets noise choose the
row where the motion is planar; more refuses slight motion out of the plane. Not measured.
"""


def solve_freehand(u: Array, v: Array) -> HandEye:
    """Solves for the calibration. u: (n, 2) px, v: (n, 3) mm. Raises ValueError where v does not span three directions
    or u two.
    """
    return freehand(Sums.of(u, v))


def freehand(sums: Sums) -> HandEye:
    """Solves the same problem from running sums."""
    independent(sums.uu, 2, "displacements of the picture")
    independent(sums.vv, 3, "displacements of the sensor")
    rotation = rows_to_rotation(np.stack([_row(sums, axis) for axis in (0, 1)]))
    scale = np.einsum("ji,ji->j", sums.uv, rotation[:2]) / np.diag(sums.uu)
    if not np.all(scale > 0):
        raise ValueError("the rows of R_x that fit best contradict each other: the motion does not determine them")
    return without_offset(rotation, scale)


def _row(sums: Sums, axis: int) -> Array:
    cross = sums.uv[axis]
    values, vectors = np.linalg.eigh(sums.vv - np.outer(cross, cross) / sums.uu[axis, axis])
    noise = max(float(values[0]), 1e-9 * float(values[2]))
    if values[1] < _SEPARATION * noise:
        raise ValueError("the out-of-plane motion does not rise above the noise: use the planar form")
    row = vectors[:, 0]
    return np.asarray(row if row @ cross > 0 else -row)
