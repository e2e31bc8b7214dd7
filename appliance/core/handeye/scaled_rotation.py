"""Solves for the nine linear parameters of the scaled rotation and factorises them by QR or polar decomposition (Eq.
4).

t_b = R_xᵀ Λ u = M u: M (three columns for a volume, two for a picture, whose third is unseen) is found by least
squares. The tracker is the noisy side and stands on the left, so M is unbiased. Its columns are the rows of R_x times
λ. QR with a positive diagonal takes the first column as it is; polar treats all alike.
"""

from dataclasses import replace
from typing import Literal

import numpy as np

from probewatch.appliance.core.handeye.motions import HandEye, independent, rows_to_rotation, without_offset
from probewatch.appliance.core.handeye.sums import Sums
from probewatch.drivers.rigid import Array, nearest_rotation


def solve_scaled_rotation(u: Array, v: Array, factor: Literal["qr", "polar"] = "polar") -> HandEye:
    """Solves for rotation and scales. u: (n, 2) px or (n, 3) voxels; v: (n, 3) mm, t_b or `Motions.displacements`.
    Raises ValueError where u lacks rank.
    """
    return scaled_rotation(Sums.of(u, v), factor)


def scaled_rotation(sums: Sums, factor: Literal["qr", "polar"] = "polar") -> HandEye:
    """Solves the same problem from running sums; with polar, also for the covariance that the residual implies for
    independent motions.
    """
    independent(sums.uu, len(sums.uu), "displacements of the picture")
    found = factorised(np.asarray(np.linalg.solve(sums.uu, sums.uv).T, dtype=np.float64), factor)
    if factor == "qr":
        return found
    noise_mm = max(sums.noise_mm(found.rotation, found.scale), 1e-12)
    information = sums.information(found.rotation, found.scale, noise_mm)
    covariance = np.zeros_like(information)
    covariance[:-3, :-3] = np.linalg.pinv(information[:-3, :-3])
    covariance[range(-3, 0), range(-3, 0)] = np.inf
    return replace(found, covariance=covariance)


def factorised(M: Array, factor: Literal["qr", "polar"] = "polar") -> HandEye:
    """Factorises M = R_xᵀ Λ, (3, 2) or (3, 3), into R_x and λ > 0. Raises ValueError where QR finds a volume mirrored
    against the tracker.
    """
    if factor == "qr":
        q, r = np.linalg.qr(M)
        rows = (q * np.sign(np.diag(r))).T
        rotation = rows if len(rows) == 3 else np.vstack([rows, np.cross(rows[0], rows[1])])
        if np.linalg.det(rotation) < 0:
            raise ValueError("the volume is mirrored against the tracker: give its polarity")
        return without_offset(rotation, np.abs(np.diag(r)))
    directions = (M / np.linalg.norm(M, axis=0)).T
    rotation = nearest_rotation(directions) if len(directions) == 3 else rows_to_rotation(directions)
    # Along its own row a column's noise has mean zero; the length of the column would grow with the noise across it.
    return without_offset(rotation, np.einsum("jk,kj->j", rotation[: M.shape[1]], M))
