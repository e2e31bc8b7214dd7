"""Rigid transforms as trackers tell them: quaternion and position into a matrix, and one tool seen from another."""

import math

import numpy as np

from drivers.samples import Matrix4

UNIT_TOLERANCE = 1e-3
"""How far the length of a reported quaternion may be from 1. TX rounds to 1e-4, so whole ones are within 1e-4; more
lets damage pass, less would refuse what rounding does."""

FURTHEST_MM = 1e6
"""A kilometre: no tracker sees so far, so such a number is damage. Damage within it is left to check sums and to
the second look at leaps; less room would find more of it, and none of it near the tool."""


def pose_matrix(quaternion: tuple[float, float, float, float], translation_mm: tuple[float, float, float]) -> Matrix4:
    """(4, 4) tool → tracker, mm. quaternion: (q0, qx, qy, qz); the rotation is orthonormal whatever its rounding."""
    length = math.hypot(*quaternion)
    w, x, y, z = (q / length for q in quaternion)
    tx, ty, tz = translation_mm
    return np.array(
        (
            (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), tx),
            (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x), ty),
            (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y), tz),
            (0.0, 0.0, 0.0, 1.0),
        )
    )


def seen_from(reference: Matrix4, probe: Matrix4) -> Matrix4:
    """(4, 4) probe → reference, from both in the tracker's frame: reference⁻¹ probe."""
    moved = probe.copy()
    moved[:3, 3] -= reference[:3, 3]
    relative: Matrix4 = np.eye(4)
    relative[:3] = reference[:3, :3].T @ moved[:3]
    return relative
