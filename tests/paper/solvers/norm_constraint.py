"""The norm constraint and Horn's method: the paper's third way through Eq. 4. For comparison only.

|t_b|² = uᵀ Λ² u is linear in λ²; with the scales known, R_x turns the t_b onto the Λ u. Tracker noise adds to every
|t_b|², so the scales come out too large, the more so the shorter the steps (docs/method.md, equation 25;
docs/paper.md).
"""

import numpy as np

from probewatch.appliance.core.handeye.motions import HandEye, independent, without_offset
from probewatch.drivers.rigid import Array, nearest_rotation


def solve_norm_constraint(u: Array, v: Array) -> HandEye:
    """u: (n, 2) px or (n, 3) voxels; v: (n, 3) mm. ValueError where the motion gives no positive λ²."""
    independent(u**2, u.shape[1], "squared displacements of the picture")
    square = np.linalg.lstsq(u**2, (v**2).sum(axis=1), rcond=None)[0]
    if not np.all(square > 0):
        raise ValueError("the norm constraint gives no positive scale for this motion")
    scale = np.sqrt(square)
    t_a = np.zeros((len(u), 3))
    t_a[:, : u.shape[1]] = u * scale
    independent(t_a, 2, "displacements of the picture")
    return without_offset(nearest_rotation(t_a.T @ v), scale)
