"""Planar motion: in-plane translation and turn (Eq. 5–7, corrected).

Eq. 5 as printed drops (I − R_a) t_x; with it, per motion and in units of the picture,

    R_a R_x = R_x R_b        ⇒  rotvec(R_b) = α r₃
    R_x t_b + (I − R_a) t_x − D_u λ = 0    ⇒  r₃ · t_b = 0 in its third row

The third rows give r₃; r₁ and r₂ are unit, at right angles to it and to each other, so one angle about r₃ is left.
With t_xy and λ eliminated it is the lower eigenvector of a 2 × 2 matrix; the two signs of r₃ are both tried and the
one kept that explains the motion with positive scales. Tracker noise adds a multiple of the identity to both
matrices, so their eigenvectors stay unbiased. (I − R_a) has rank 2: t_x = t_o + ζ t_n with t_n = (0, 0, 1) and ζ left
to the cross-wire (Eq. 7).
"""

import numpy as np

from probewatch.appliance.core.handeye.motions import UNKNOWN, HandEye, Motions, independent
from probewatch.drivers.rigid import Array, vector_from_rotation

_LEAST_TURN_RAD = 1e-6
"""A turn below this is rounding, not motion. Less would solve for an offset from nothing; no tracker measures a turn as
small as that, so more would lose nothing either.
"""
_NORMAL = np.array([0.0, 0.0, 1.0])


def solve_planar(motions: Motions, rad_per_mm: float = 0.0035) -> HandEye:
    """Needs pictures (u (n, 2)) displaced in two directions; t_o only where they turn, else it is NaN.

    rad_per_mm: orientation noise of the tracker over its position noise. ValueError where the motion does not
    determine R_x.
    """
    independent(motions.u, 2, "displacements of the picture")
    alpha, turn = vector_from_rotation(motions.R_a)[:, 2], vector_from_rotation(motions.R_b)
    normal = _normal(motions.t_b, turn, alpha, rad_per_mm)
    signs = (1.0,) if alpha @ turn @ normal > _LEAST_TURN_RAD**2 else (1.0, -1.0)
    found = [_about(sign * normal, motions) for sign in signs]
    residual, best = min(found, key=lambda answer: (not np.all(answer[1].scale > 0), answer[0]))
    if not np.all(best.scale > 0) or not np.isfinite(residual):
        raise ValueError("no rotation explains the planar motion with positive scales: is the polarity right?")
    return best


def _normal(t_b: Array, turn: Array, alpha: Array, rad_per_mm: float) -> Array:
    """r₃ up to sign, or with the sign of the turns where there are any."""
    across = t_b.T @ t_b + ((turn**2).sum() * np.eye(3) - turn.T @ turn) / rad_per_mm**2
    values, vectors = np.linalg.eigh(across)
    if not values[1] > 1e-12 * max(values[2], 1e-12):
        raise ValueError("the plane of motion is not determined: the probe went along a single line")
    normal = vectors[:, 0]
    return np.asarray(normal if alpha @ turn @ normal >= 0 else -normal)


def _about(normal: Array, motions: Motions) -> tuple[float, HandEye]:
    """Misfit and solution for a given r₃."""
    first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    # Unknown (cos φ, sin φ): r₁ = cos φ e₁ + sin φ e₂, r₂ = −sin φ e₁ + cos φ e₂.
    x, y = motions.t_b @ first, motions.t_b @ second
    by_angle = np.stack([np.column_stack([x, y]), np.column_stack([y, -x])], axis=1)
    others, turned = _others(motions)
    eliminated = by_angle.reshape(-1, 2)
    width = np.linalg.norm(others, axis=0)
    solved = np.linalg.lstsq(others / width, eliminated, rcond=None)[0] / width[:, None]
    values, vectors = np.linalg.eigh(eliminated.T @ (eliminated - others @ solved))
    angle = vectors[:, 0]
    rest = -solved @ angle
    if np.sum(rest[:2]) < 0:
        angle, rest = -angle, -rest
    rotation = np.stack([angle[0] * first + angle[1] * second, -angle[1] * first + angle[0] * second, normal])
    offset = np.array([*rest[2:], 0.0]) if turned else UNKNOWN
    return float(values[0]), HandEye(rotation, rest[:2], offset, _NORMAL if turned else UNKNOWN)


def _others(motions: Motions) -> tuple[Array, bool]:
    """(2n, 2 or 4) columns of λ and, where the picture turned, t_xy: −D_u and I − R_a of the in-plane rows."""
    columns = np.zeros((len(motions), 2, 4))
    columns[:, 0, 0], columns[:, 1, 1] = -motions.u[:, 0], -motions.u[:, 1]
    columns[:, :, 2:] = np.eye(2) - motions.R_a[:, :2, :2]
    turned = bool(np.abs(columns[:, :, 2:]).max() > _LEAST_TURN_RAD)
    return columns.reshape(-1, 4)[:, : 4 if turned else 2], turned
