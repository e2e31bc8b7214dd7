"""Predicts steps of the picture from steps of the sensor by a calibration: A = X B X⁻¹ (Eq. 1), many at a time.

With the lever arm l = R_xᵀ t_x, t_a = R_x (t_b + (I − R_b) l) is linear in the 3 × 4 products of R_x with (1, l). Time
is the last axis throughout; the picture plane is the complex plane, so turning by α is multiplying by exp(iα).
"""

from dataclasses import dataclass

import numpy as np

from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array, inverse, skew

_GENERATORS = skew(np.eye(3))
"""Generators of the rotations, (3, 3, 3): [e]× of each axis."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorSteps:
    """Holds the steps B_j⁻¹ B_{j−1} of the sensor; the first is the identity.

    moved: (12, n), row by row of (3, 4): t_b, mm, and I − R_b, which is what the step moves for each mm of lever arm.
    turn: (3, n) small rotation vector, rad.
    """

    moved: Array
    turn: Array

    @classmethod
    def between(cls, poses: Array) -> "SensorSteps":
        """Computes the steps between poses, (n, 4, 4) sensor → tracker, in time order."""
        steps = np.broadcast_to(np.eye(4), poses.shape).copy()
        np.matmul(inverse(poses[1:]), poses[:-1], out=steps[1:])
        B = np.ascontiguousarray(steps.transpose(1, 2, 0))
        moved = np.concatenate([B[:3, 3:], np.eye(3)[..., None] - B[:3, :3]], axis=1)
        twice = np.stack([B[2, 1] - B[1, 2], B[0, 2] - B[2, 0], B[1, 0] - B[0, 1]])
        return cls(moved.reshape(12, -1), 0.5 * twice)

    def rate_until(self, later: "SensorSteps", apart_s: float) -> "SensorSteps":
        """Returns the change per second to the same steps apart_s later."""
        return SensorSteps((later.moved - self.moved) / apart_s, (later.turn - self.turn) / apart_s)


def products_and_slopes(R: Array, offset: Array) -> tuple[Array, Array]:
    """Returns the derivatives of R ⊗ (1, l) by rotation, [δ]× R, and by offset, then its value, (7, 3, 12), whose
    product with `SensorSteps.moved` gives those of the steps; and the same of R, (7, 3, 3).
    """
    turned, lever = np.zeros((7, 3, 3)), np.zeros((7, 1, 1, 4))
    turned[:3], turned[6] = _GENERATORS @ R, R
    lever[:3, 0, 0, 1:], lever[3:6, 0, 0, 1:], lever[6] = offset @ _GENERATORS @ R, R, _arm(R, offset)
    products = R[..., None] * lever
    products[:3] += turned[:3, ..., None] * lever[6]
    return products.reshape(7, 3, 12), turned


def _arm(R: Array, offset: Array) -> Array:
    """Returns 1 and the lever arm, mm, in sensor axes, (4,)."""
    return np.concatenate([[1.0], offset @ R])


def picture_steps(R: Array, offset: Array, steps: SensorSteps) -> tuple[Array, Array]:
    """Returns the steps, (3, n) mm and (3, n) rad, along and about lateral, axial and elevational, for X = (R,
    offset).
    """
    products = (R[..., None] * _arm(R, offset)).reshape(3, 12)
    return products @ steps.moved, R @ steps.turn


def predicted_path(poses: Array, reference: Calibration) -> Array:
    """Returns the path of the image centre in its own turning axes, (3, m) mm, lateral, axial and elevational, for
    successive poses (m, 4, 4).

    The in-plane part is what a perfect registration would integrate, however the probe tilts meanwhile.
    """
    moved, turned = picture_steps(reference.rotation, reference.offset_mm, SensorSteps.between(poses))
    straight = (moved[0] + 1j * moved[1]) * np.exp(-1j * np.cumsum(turned[2]))
    return -np.cumsum([straight.real, straight.imag, moved[2]], axis=1)
