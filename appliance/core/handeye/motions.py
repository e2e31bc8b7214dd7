"""Defines the input and result types of all AX = XB solvers, and chooses the polarity, which motion alone does not
determine.
"""

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from probewatch.drivers.rigid import Array, angle_from_rotation, inverse, rigid, rotation_from_vector

_LEAST_RATIO = 1e-6
"""Smallest singular value, as a share of the largest, at which a direction still counts as moved."""


@dataclass(frozen=True, slots=True, eq=False)
class Motions:
    """Holds n relative motions A_i, B_i with A_i X = X B_i.

    `u` has shape (n, 2), px, for pictures and (n, 3), voxels, for volumes; t_a = Λ u. `R_a` has shape (n, 3, 3); for
    pictures these are in-plane turns. `R_b` (n, 3, 3) and `t_b` (n, 3), mm, are the parts of B = B_2⁻¹ B_1.
    """

    u: Array
    R_a: Array
    R_b: Array
    t_b: Array

    @classmethod
    def of_pictures(
        cls, u_px: Array, alpha_rad: Array, first: Array, second: Array, polarity: tuple[int, int] = (1, 1)
    ) -> "Motions":
        """Builds the motions from registered pictures: u_px (n, 2), alpha_rad (n,); first, second: (n, 4, 4) sensor →
        tracker.

        A mirrored axis mirrors the displacement along it and the sense of the turn.
        """
        turn = np.zeros((len(alpha_rad), 3))
        turn[:, 2] = np.asarray(alpha_rad) * polarity[0] * polarity[1]
        B = inverse(second) @ first
        return cls(np.asarray(u_px) * np.array(polarity), rotation_from_vector(turn), B[:, :3, :3], B[:, :3, 3])

    def displacements(self, lever_mm: Array) -> Array:
        """Returns v = t_b + (I − R_b) c, (n, 3) mm: then t_a = R_x v holds however the probe turns. lever_mm: c = R_xᵀ
        t_x; the nominal value is accurate enough.
        """
        return self.t_b + lever_mm - self.R_b @ lever_mm

    def __len__(self) -> int:
        return len(self.t_b)


@dataclass(frozen=True, slots=True, eq=False)
class HandEye:
    """Holds X and the scales, as estimated by one method.

    `rotation` is R_x, (3, 3), a proper rotation. `scale` is (2,) or (3,), mm per px, > 0. `offset_mm` is t_x, (3,), NaN
    where the motion does not determine it. `free` is t_n of Eq. 7, (3,), the direction in which t_x stays undetermined;
    NaN where there is none. `covariance` is square, 3 + k + 3 wide: rotation in rad (R = exp([δ]×) R_x), relative
    scale, offset in mm; None where the method gives none.
    """

    rotation: Array
    scale: Array
    offset_mm: Array
    free: Array
    covariance: Array | None = None

    def matrix(self) -> Array:
        """Returns X as a (4, 4) matrix; undetermined entries are NaN."""
        return rigid(self.rotation, self.offset_mm)


UNKNOWN = np.full(3, np.nan)
"""Offset or direction, (3,), that the motion does not determine."""


def without_offset(rotation: Array, scale: Array) -> HandEye:
    """Builds the result of a method that uses translations only: the offset is undetermined."""
    return HandEye(rotation, scale, UNKNOWN, UNKNOWN)


def nearest_polarity(found: HandEye, nominal_rotation: Array) -> tuple[HandEye, tuple[int, int]]:
    """Returns the same motion with the polarity that puts R_x nearest to the nominal one, and that polarity.

    `found` was solved with polarity (1, 1). Mirroring both the picture's axes s and R_x by diag(s_x, s_y, s_x s_y)
    changes no prediction (docs/method.md, equation 7), so only the distance to the nominal rotation decides. The rows
    of t_x are mirrored with their axes.
    """
    best = max(
        product((1, -1), repeat=2), key=lambda s: float(np.trace(nominal_rotation.T @ _mirror(s) @ found.rotation))
    )
    mirror = _mirror(best)
    turned = replace(
        found, rotation=mirror @ found.rotation, offset_mm=mirror @ found.offset_mm, free=mirror @ found.free
    )
    return turned, (int(best[0]), int(best[1]))


def rodrigues_rad(rotation: Array) -> float:
    """Returns the angle of a rotation (3, 3), rad: the magnitude of its Rodrigues vector, 0 … π, as in Table 1."""
    return angle_from_rotation(rotation)


def independent(vectors: Array, rank: int, what: str) -> None:
    """Raises ValueError unless the (n, 3) vectors span `rank` directions."""
    values = np.linalg.svd(np.asarray(vectors, dtype=np.float64), compute_uv=False)
    if values.size < rank or not values[rank - 1] > _LEAST_RATIO * max(float(values[0]), 1e-12):
        raise ValueError(f"{what} must span {rank} directions; these do not")


def rows_to_rotation(rows: Array) -> Array:
    """Returns the proper rotation nearest to (2, 3) estimates of the first two rows of R_x; r₃ = r₁ × r₂."""
    u, _, vt = np.linalg.svd(rows / np.linalg.norm(rows, axis=1, keepdims=True), full_matrices=False)
    first = u @ vt
    return np.vstack([first, np.cross(first[0], first[1])])


def _mirror(polarity: tuple[int, ...]) -> Array:
    return np.diag([*polarity, polarity[0] * polarity[1]]).astype(np.float64)
