"""The general homogeneous system (Eq. 3), by its null space and in two steps.

    ⎡ I₉ − R_a ⊗ R_b     0        0   ⎤ ⎛ vec(R_x) ⎞
    ⎣ I₃ ⊗ t_bᵀ       I₃ − R_a   −D_u ⎦ ⎜   t_x    ⎟ = 0,   D_u = diag(u)
                                        ⎝    λ     ⎠

Two motions with axes that are not parallel, and with displacement along every scaled axis, determine all fifteen
unknowns; vec is row-major, vec(CDE) = (C ⊗ Eᵀ) vec(D). The null space weighs rotation and translation rows as they
come; the two-step solution (Tsai and Lenz, the paper's ref. 9) takes R_x from the first rows alone and then t_x and λ
linearly from the others.
"""

import numpy as np

from probewatch.appliance.core.handeye.motions import UNKNOWN, HandEye, Motions
from probewatch.drivers.rigid import Array, nearest_rotation

_SINGULAR = 1e-7
"""Singular value, as a share of the largest, that counts as none: a little above the root of the rounding of double
numbers, 1.5e-8, to which the eigenvalues of a product can tell it.
"""


def solve_null_space(motions: Motions) -> HandEye:
    """All unknowns at once; its first nine coefficients scale the null vector. ValueError if it is not the only one."""
    k = motions.u.shape[1]
    unit = float(np.sqrt(np.mean(motions.t_b**2))) or 1.0
    rows = [
        np.block(
            [
                [np.eye(9) - np.kron(R_a, R_b), np.zeros((9, 3 + k))],
                [np.kron(np.eye(3), t_b / unit), np.eye(3) - R_a, -D],
            ]
        )
        for R_a, R_b, t_b, D in zip(motions.R_a, motions.R_b, motions.t_b, _diagonals(motions.u), strict=True)
    ]
    system = np.concatenate(rows)
    width = np.linalg.norm(system, axis=0)
    if not np.all(width > 0):
        raise ValueError("an unknown of Eq. 3 is touched by no motion")
    _, values, vt = np.linalg.svd(system / width)
    if len(system) < 12 + k or values[-2] < _SINGULAR * values[0]:
        raise ValueError("the motions leave more than one solution of Eq. 3: two turns about different axes are needed")
    x = vt[-1] / width
    matrix = x[:9].reshape(3, 3)
    size = np.cbrt(np.linalg.det(matrix))
    return HandEye(nearest_rotation(matrix / size), x[12:] / size * unit, x[9:12] / size * unit, UNKNOWN)


def solve_two_step(motions: Motions) -> HandEye:
    """R_x from R_a R_x = R_x R_b, then t_x and λ from (I − R_a) t_x − D_u λ = −R_x t_b."""
    rotation = _rotation(motions)
    D = _diagonals(motions.u)
    design = np.concatenate([np.concatenate([np.eye(3) - motions.R_a, -D], axis=2)[i] for i in range(len(motions))])
    width = np.linalg.norm(design, axis=0)
    if not np.all(width > 0) or np.linalg.cond(design / width) > 1 / _SINGULAR:
        raise ValueError("the motions do not determine t_x and every scale")
    x = np.linalg.lstsq(design / width, -(motions.t_b @ rotation.T).ravel(), rcond=None)[0] / width
    return HandEye(rotation, x[3:], x[:3], UNKNOWN)


def _rotation(motions: Motions) -> Array:
    difference = np.eye(9) - np.stack([np.kron(a, b) for a, b in zip(motions.R_a, motions.R_b, strict=True)])
    values, vectors = np.linalg.eigh(np.einsum("nij,nik->jk", difference, difference))
    if values[1] < _SINGULAR**2 * max(values[-1], 1.0):
        raise ValueError("R_x is not determined: turns about two axes that are not parallel are needed")
    matrix = vectors[:, 0].reshape(3, 3)
    return nearest_rotation(matrix * np.sign(np.linalg.det(matrix)))


def _diagonals(u: Array) -> Array:
    """(n, k) → (n, 3, k) D_u."""
    D = np.zeros((len(u), 3, u.shape[1]))
    index = np.arange(u.shape[1])
    D[:, index, index] = u
    return D
