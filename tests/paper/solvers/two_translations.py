"""Two translations; the third constraint is their cross product (the paper, after Andreff, Horaud and Espiau 2001).

In a picture R_x (t_b1 × t_b2) lies along the elevational axis: with u_3 = 0 it completes the three translations. In a
volume the scales come first, from |Λu_1|² = |t_b1|², |Λu_2|² = |t_b2|² and Λu_1 · Λu_2 = t_b1 · t_b2, three equations
that are linear in λ²; the rotation follows from the two pairs and their cross products by Horn's method.
"""

import numpy as np

from probewatch.appliance.core.handeye.motions import HandEye, independent, without_offset
from probewatch.drivers.rigid import Array, nearest_rotation
from tests.paper.solvers.three_translations import solve_three_translations


def solve_two_translations(u: Array, t_b: Array) -> HandEye:
    """u: (2, 2) px or (2, 3) voxels; t_b: (2, 3) mm. ValueError where they are parallel or tell no positive λ²."""
    independent(t_b, 2, "two translations")
    across = np.cross(t_b[0], t_b[1])
    if u.shape[1] == 2:
        # As long as the others, so that the three are equally well conditioned.
        across *= np.linalg.norm(t_b) / np.linalg.norm(across)
        return solve_three_translations(np.vstack([u, np.zeros(2)]), np.vstack([t_b, across]))
    products = np.stack([u[0] * u[0], u[1] * u[1], u[0] * u[1]])
    independent(products, 3, "squares and products of two voxel translations")
    square = np.linalg.solve(products, [t_b[0] @ t_b[0], t_b[1] @ t_b[1], t_b[0] @ t_b[1]])
    if not np.all(square > 0):
        raise ValueError("two translations whose lengths and angle agree with no positive scale")
    t_a = u * np.sqrt(square)
    seen = np.vstack([t_a, np.cross(t_a[0], t_a[1])])
    return without_offset(nearest_rotation(seen.T @ np.vstack([t_b, across])), np.sqrt(square))
