"""Three independent translations, in closed form (section "Translation Motion" of the paper).

With R_b = R_a = I, R_x t_bi = Λ u_i. Let v_1 = t_b2 × t_b3 and so on, and Δ = det[t_b1 t_b2 t_b3]; then row j of R_x is
r_j = λ_j Σ_i u_i(j) v_i / Δ. Unit rows give λ_j. One of the three must lead out of the picture.
"""

import numpy as np

from probewatch.appliance.core.handeye.motions import HandEye, independent, rows_to_rotation, without_offset
from probewatch.drivers.rigid import Array, nearest_rotation


def solve_three_translations(u: Array, t_b: Array) -> HandEye:
    """u: (3, 2) px or (3, 3) voxels; t_b: (3, 3) mm, one motion a row. ValueError if the three are not independent."""
    independent(t_b, 3, "three translations")
    v = np.stack([np.cross(t_b[1], t_b[2]), np.cross(t_b[2], t_b[0]), np.cross(t_b[0], t_b[1])])
    scaled = u.T @ v / np.linalg.det(t_b)
    length = np.linalg.norm(scaled, axis=1)
    if not np.all(length > 0):
        raise ValueError("an axis of the picture does not move at all: its scale is not determined")
    rows = scaled / length[:, None]
    return without_offset(nearest_rotation(rows) if len(rows) == 3 else rows_to_rotation(rows), 1 / length)
