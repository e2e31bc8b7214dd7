"""Steps of the picture that a calibration predicts from steps of the sensor: A = X B X⁻¹ (Eq. 1), many at a time."""

from dataclasses import dataclass

import numpy as np

from appliance.core.geometry import Array, skew
from appliance.types import Calibration


@dataclass(frozen=True, slots=True, eq=False)
class SensorSteps:
    """R_b (n, 3, 3), t_b (n, 3) mm and small rotation vector (n, 3) rad of B_j⁻¹ B_{j−1}; the first is the identity."""

    R_b: Array
    t_b: Array
    turn: Array

    @classmethod
    def between(cls, poses: Array) -> "SensorSteps":
        """poses: (n, 4, 4) sensor → tracker, in time order."""
        R, t = poses[:, :3, :3], poses[:, :3, 3]
        R_b, t_b = np.tile(np.eye(3), (len(R), 1, 1)), np.zeros((len(R), 3))
        back = np.swapaxes(R[1:], -1, -2)
        R_b[1:] = back @ R[:-1]
        t_b[1:] = np.einsum("nij,nj->ni", back, t[:-1] - t[1:])
        twice = np.stack(
            [R_b[:, 2, 1] - R_b[:, 1, 2], R_b[:, 0, 2] - R_b[:, 2, 0], R_b[:, 1, 0] - R_b[:, 0, 1]], axis=1
        )
        return cls(R_b, t_b, 0.5 * twice)


def picture_steps(R: Array, offset: Array, steps: SensorSteps) -> Array:
    """(n, 6): t_x, t_y mm, α, t_z, tilt x, tilt y, for X = (R, offset)."""
    lever = R.T @ offset
    t_a = (steps.t_b + lever - steps.R_b @ lever) @ R.T
    turn = steps.turn @ R.T
    return np.column_stack([t_a[:, :2], turn[:, 2], t_a[:, 2], turn[:, :2]])


def picture_slopes(R: Array, offset: Array, steps: SensorSteps) -> Array:
    """(n, 6, 9) derivative of picture_steps by rotation and offset; the columns of scale and latency stay zero."""
    R_a = R @ steps.R_b @ R.T
    slopes = np.zeros((len(R_a), 6, 9))
    slopes[:, [0, 1, 3], :3] = skew((steps.R_b @ (R.T @ offset) - steps.t_b) @ R.T) - R_a @ skew(offset)
    slopes[:, [4, 5, 2], :3] = -skew(steps.turn @ R.T)
    slopes[:, [0, 1, 3], 5:8] = np.eye(3) - R_a
    return slopes


def plane_rotation(angle_rad: Array) -> Array:
    """(n,) → (n, 2, 2)."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)


def predicted_path(poses: Array, reference: Calibration) -> Array:
    """(m, 4, 4) successive poses → (m, 3) mm: way of the image centre in its own turning axes: lateral, axial,
    elevational.

    The in-plane part is what a perfect registration would integrate, whatever the probe tilts on its way.
    """
    step = picture_steps(reference.rotation, reference.offset_mm, SensorSteps.between(poses))
    unturn = plane_rotation(-np.cumsum(step[:, 2]))
    in_plane = np.einsum("nij,nj->ni", unturn, step[:, :2])
    return -np.cumsum(np.column_stack([in_plane, step[:, 3]]), axis=0)
