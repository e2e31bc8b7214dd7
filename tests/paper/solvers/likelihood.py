"""Maximum-likelihood refinement on SO(3) × R^k, with covariance, of independent motions.

Gauss–Newton on the whitened rows of Eq. 1, Λu − (R_x t_b + t_x − R_a t_x) and rotvec(R_a) − R_x rotvec(R_b), from any
start that the closed forms give. `picture_rows`: of a freehand picture only two of the former and the last of the
latter are seen, and the tilt in R_a is taken from the tracker, R_a = R_x R_b R_xᵀ with its turn replaced by α. That
shows t_z, and it puts tracker noise δ into the design: Σ tilt² grows by n Var δ, which would draw t_z towards zero.
The expectation of that excess is taken off both sides of the normal equations (errors in variables).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.handeye.motions import HandEye, Motions
from probewatch.appliance.core.handeye.observability import natural_units
from probewatch.drivers.rigid import Array, rotation_from_vector, skew, vector_from_rotation

_ROUNDS, _SMALL = 60, 1e-12
"""Most Gauss–Newton steps, and the step (rad, relative, mm) that ends them. Near a good start a few are enough; the
many are for starts some 20° off. It runs in reports, not on the cart's line.
"""
_UNSEEN, _ROUNDED = 1e-9, 1e-12
"""Least information that moves a parameter: in 1 / (natural unit)², and as a share of the largest."""


@dataclass(frozen=True, slots=True)
class TrackerNoise:
    """White standard deviations per axis of one reading; a motion has two. Both > 0."""

    position_mm: float
    angle_rad: float


def refine(motions: Motions, start: HandEye, noise: TrackerNoise, picture_rows: bool = False) -> HandEye:
    """Most likely X from a start within its reach, about 20°.

    picture_rows: freehand pictures, of which only (u, α) is known. A parameter that no motion shows keeps its start
    (an offset of NaN starts at zero) and gets an infinite variance.
    """
    found = replace(start, offset_mm=np.nan_to_num(start.offset_mm))
    for _ in range(_ROUNDS):
        step = _Rows(motions, found, noise, picture_rows).step()
        found = _moved(found, step)
        if np.all(np.abs(step) < _SMALL):
            break
    return replace(found, covariance=_Rows(motions, found, noise, picture_rows).covariance())


def _moved(found: HandEye, step: Array) -> HandEye:
    return replace(
        found,
        rotation=rotation_from_vector(step[:3]) @ found.rotation,
        scale=found.scale * (1 + step[3:-3]),
        offset_mm=found.offset_mm + step[-3:],
    )


class _Rows:
    """Normal equations of one linearisation: whitened rows, six a motion or three."""

    def __init__(self, motions: Motions, at: HandEye, noise: TrackerNoise, picture_rows: bool) -> None:
        t, self._offset = at.offset_mm, at.offset_mm
        turn_a, turn_b = vector_from_rotation(motions.R_a), vector_from_rotation(motions.R_b) @ at.rotation.T
        R_a = motions.R_a
        if picture_rows:
            R_a = rotation_from_vector(np.column_stack([turn_b[:, :2], turn_a[:, 2]]))
        moved = motions.t_b @ at.rotation.T
        seen = np.zeros((len(motions), 3))
        seen[:, : len(at.scale)] = motions.u * at.scale
        residual = np.concatenate([seen - (moved + t - R_a @ t), turn_a - turn_b], axis=1)
        by = _slopes(moved, seen, R_a, turn_b, len(at.scale))
        if picture_rows:
            by[:, :3, :3] += skew(t) @ np.diag([1.0, 1.0, 0.0]) @ skew(turn_b)
        kept = [0, 1, 5] if picture_rows else list(range(6))
        tilt_mm = abs(float(t[2])) * noise.angle_rad if picture_rows else 0.0
        position, angle = np.sqrt(2) * np.hypot(noise.position_mm, tilt_mm), np.sqrt(2) * noise.angle_rad
        sd = np.array([position] * 3 + [angle] * 3)
        rows = (residual / sd)[:, kept].ravel()
        design = (by / sd[:, None])[:, kept].reshape(rows.size, -1)
        self._normal, self._slope = design.T @ design, design.T @ rows
        self._excess = np.zeros_like(self._normal)
        if picture_rows:
            self._excess[-1, -1] = 2 * len(motions) * (angle / position) ** 2

    def step(self) -> Array:
        """Newton step of the corrected equations."""
        inverse, _ = self._inverse()
        return np.asarray(-inverse @ (self._slope - self._excess[:, -3:] @ self._offset))

    def covariance(self) -> Array:
        """Of rotation rad, relative scale, offset mm."""
        inverse, unseen = self._inverse()
        covariance = inverse @ self._normal @ inverse
        covariance[unseen, unseen] = np.inf
        return np.asarray(covariance)

    def _inverse(self) -> tuple[Array, NDArray[np.bool_]]:
        """Inverse of the corrected normal matrix where it has information, and the parameters that have none."""
        unit = natural_units(len(self._normal) - 6)
        values, vectors = np.linalg.eigh((self._normal - self._excess) * np.outer(unit, unit))
        told = values > max(_UNSEEN, _ROUNDED * float(values[-1]))
        kept = vectors[:, told]
        inverse = (kept / values[told]) @ kept.T * np.outer(unit, unit)
        return inverse, np.asarray((vectors[:, ~told] ** 2).sum(axis=1) > _UNSEEN)


def _slopes(moved: Array, seen: Array, R_a: Array, turn_b: Array, scales: int) -> Array:
    """(n, 6, 6 + k) derivative of the rows by rotation, relative scale and offset."""
    by = np.zeros((len(moved), 6, 6 + scales))
    by[:, :3, :3], by[:, 3:, :3] = skew(moved), skew(turn_b)
    axis = np.arange(scales)
    by[:, axis, 3 + axis] = seen[:, :scales]
    by[:, :3, -3:] = R_a - np.eye(3)
    return by
