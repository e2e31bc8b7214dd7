"""Keeps up the sums that the translational forms need motion by motion, so that no cost grows with history."""

from dataclasses import dataclass

import numpy as np

from probewatch.drivers.rigid import Array, skew


@dataclass(frozen=True, slots=True, eq=False)
class Sums:
    """Holds sums over weighted motions: weight Σ1, uu Σ u uᵀ (k, k) px², uv Σ u vᵀ (k, 3) px mm, vv Σ v vᵀ (3,
    3) mm².
    """

    weight: float
    uu: Array
    uv: Array
    vv: Array

    @classmethod
    def of(cls, u: Array, v: Array) -> "Sums":
        """Adds up n motions, u: (n, k) px, v: (n, 3) mm."""
        return cls(float(len(u)), u.T @ u, u.T @ v, v.T @ v)

    @classmethod
    def empty(cls, axes: int = 2) -> "Sums":
        """Returns the sums of no motion."""
        return cls(0.0, np.zeros((axes, axes)), np.zeros((axes, 3)), np.zeros((3, 3)))

    def after(self, u: Array, v: Array, keep: float = 1.0) -> "Sums":
        """Returns the sums after one motion more, u (k,), v (3,). keep ≤ 1: weight left to everything before; 1 / (1 −
        keep) motions count.
        """
        return Sums(
            keep * self.weight + 1,
            keep * self.uu + np.outer(u, u),
            keep * self.uv + np.outer(u, v),
            keep * self.vv + np.outer(v, v),
        )

    def information(self, rotation: Array, scale: Array, noise_mm: float) -> Array:
        """Returns the information, (6 + k) square, on rotation rad, relative scale, offset mm (none), for noise per
        axis of v.

        Only what the picture shows counts: [Λu]× and Λu, not v, whose noise would pass for motion.
        """
        k = len(scale)
        t_a = np.zeros((3, 3))
        t_a[:k, :k] = self.uu * np.outer(scale, scale)
        crosses = np.array([skew(axis) for axis in np.eye(3)])
        by = np.concatenate([np.transpose(crosses, (1, 2, 0)), np.zeros((3, k, 3))], axis=1)
        by[np.arange(k), 3 + np.arange(k), np.arange(k)] = 1.0
        information = np.zeros((6 + k, 6 + k))
        information[: 3 + k, : 3 + k] = np.einsum("rpa,ab,rqb->pq", by, t_a, by) / noise_mm**2
        return information

    def noise_mm(self, rotation: Array, scale: Array) -> float:
        """Returns the standard deviation, mm per axis and motion, of what R_x v leaves of Λu, over all three rows."""
        k = len(scale)
        cross = np.zeros((3, 3))
        cross[:k] = scale[:, None] * self.uv
        left = np.trace(self.vv) - 2 * np.trace(rotation.T @ cross) + np.trace(self.uu * np.outer(scale, scale))
        return float(np.sqrt(max(left, 0.0) / max(3 * self.weight - 3 - k, 1.0)))
