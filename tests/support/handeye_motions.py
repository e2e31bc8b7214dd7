"""Motions for the AX = XB solvers, made from the definitions alone: poses of a sensor, a picture fixed to it, and Eq.
1."""

import numpy as np
from scipy.spatial.transform import Rotation

from probewatch.appliance.core.handeye.motions import Motions

ROTATION = Rotation.from_rotvec([0.62, -0.41, 0.93]).as_matrix()
OFFSET_MM = np.array([11.0, 62.0, 14.0])
SCALE = np.array([0.22, 0.26, 0.31])


def rigid(rotvec, t_mm):
    """(n, 3) rad, (n, 3) mm → (n, 4, 4)."""
    matrix = np.tile(np.eye(4), (len(t_mm), 1, 1))
    matrix[:, :3, :3] = Rotation.from_rotvec(np.asarray(rotvec, float)).as_matrix()
    matrix[:, :3, 3] = t_mm
    return matrix


X = rigid([Rotation.from_matrix(ROTATION).as_rotvec()], [OFFSET_MM])[0]


def picture_moves(random, n, shift_mm, turn_rad):
    """(n, 4, 4) P_1⁻¹ P_2: how the picture moved; spreads per axis of displacement and rotation vector."""
    return rigid(random.normal(0, 1, (n, 3)) * turn_rad, random.normal(0, 1, (n, 3)) * shift_mm)


def motions(moves, seed=0, position_mm=0.0, angle_rad=0.0, scales=2, apart=True):
    """What tracker and picture report of independent pairs of poses; noise on both readings of each pair."""
    random = np.random.default_rng(seed)
    n = len(moves)
    first = rigid(random.normal(0, 1, (n, 3)) * (1.0 if apart else 0.0), random.normal(0, 100, (n, 3)))
    A = np.linalg.inv(moves)
    noisy = [_read(pose @ X, random, position_mm, angle_rad) for pose in (first, first @ moves)]
    B = np.linalg.inv(noisy[1]) @ noisy[0]
    R_a = A[:, :3, :3]
    if scales == 2:
        turn = Rotation.from_matrix(R_a).as_rotvec() * [0, 0, 1]
        R_a = Rotation.from_rotvec(turn).as_matrix()
    return Motions(A[:, :scales, 3] / SCALE[:scales], R_a, B[:, :3, :3], B[:, :3, 3])


def _read(poses, random, position_mm, angle_rad):
    n = len(poses)
    return (
        rigid(np.zeros((n, 3)), random.normal(0, position_mm, (n, 3)))
        @ poses
        @ rigid(random.normal(0, angle_rad, (n, 3)), np.zeros((n, 3)))
    )
