"""Cramér–Rao bounds: how well a session's motion can show each parameter at all.

By central differences of what tracker and picture would say, apart from the solver's own derivatives: measured less
predicted steps of the picture's middle and turn, white tracker noise on an offset of each chain, and the random walk
that leaving the plane adds (docs/method.md, equations 15 and 20).
"""

from dataclasses import replace
from math import radians

import numpy as np
from scipy.linalg import solve_triangular

from appliance.types import Calibration
from drivers.rigid import Array, inverse, rigid, rotation_from_vector
from tools.study.session import Session, picture_path

BOUND_S = 30.0
"""Of motion: as long as a verification lasts, so what it cannot show is not to be had."""
_FPS = 30.0  # of the simulated scanner
_WALK_MM2_PER_MM = 0.002
"""Measured on tissue; .01 to .1 on wires in water (the drift of a path per mm out of the plane)."""
_TURN_WALK_DEG = 0.02
_CHAIN_WALK_MM = 0.01
"""Drift per √s of the registration along its chain: the floors that the line itself believes in."""
_SMALL = np.array([1e-4] * 3 + [1e-4] * 2 + [1e-2] * 3 + [1e-3])
"""Half of a difference, rad, relative, mm, s: the second order is six digits below."""
SCALE_TO_UNITS = np.array([np.rad2deg(1.0)] * 3 + [100.0] * 2 + [1.0] * 3 + [1000.0])
"""deg, %, mm and ms."""


def bounds(session: Session, noise_mm: float, noise_deg: float, span_s: float = BOUND_S) -> Array:
    """(9,) least standard deviation of PARAMETERS and the latency, in deg, %, mm and ms, from the first span_s; inf
    where the motion tells nothing. Breathing is taken as known.
    """
    t_s = np.arange(0.0, span_s, 1 / _FPS)
    t_s = t_s[session.touches(t_s)]
    still = replace(session, tissue="still")
    path, turn = picture_path(still.pictures(t_s))
    steps = np.stack([_steps(still, t_s, path, turn, part) for part in np.vstack([np.diag(_SMALL), -np.diag(_SMALL)])])
    J = (steps[:9] - steps[9:]) / (2 * _SMALL[:, None, None])
    elevation_mm = np.abs(_elevation(still.pictures(t_s)))
    reach = float(np.linalg.norm(session.reference.offset_mm))
    white_mm2 = noise_mm**2 + (reach * radians(noise_deg)) ** 2
    walk_mm2 = _WALK_MM2_PER_MM * elevation_mm + _CHAIN_WALK_MM**2 * np.diff(t_s)
    walk_rad2 = radians(_TURN_WALK_DEG) ** 2 * np.diff(t_s)
    rows = [
        _whitened(J[:, 0], white_mm2, walk_mm2),
        _whitened(J[:, 1], white_mm2, walk_mm2),
        _whitened(J[:, 2], radians(noise_deg) ** 2, walk_rad2),
    ]
    information = sum(row @ row.T for row in rows) / np.outer(SCALE_TO_UNITS, SCALE_TO_UNITS)
    values, axes = np.linalg.eigh(information)
    known = np.where(values > 1e-9 * values[-1], 1 / np.maximum(values, 1e-300), np.inf)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(np.where(axes**2 > 1e-9, axes**2 * known, 0.0).sum(axis=1)))


def _steps(session: Session, t_s: Array, path: Array, turn: Array, theta: Array) -> Array:
    """(3, n − 1): measured less predicted step, lateral and axial in the chain's axes, mm, and turn, rad, where the
    truth differs from the calibration in use by theta.
    """
    reference = session.reference
    body = np.broadcast_to(_matrix(reference), (t_s.size, 4, 4))
    believed = rotation_from_vector(theta[:3]) @ reference.rotation, reference.offset_mm + theta[5:8]
    seen = session.sensor(t_s + theta[8], body) @ inverse(rigid(*believed))
    A = inverse(seen[1:]) @ seen[:-1]
    told = -np.exp(-1j * turn[1:]) * (A[:, 0, 3] + 1j * A[:, 1, 3])
    around = np.exp(-1j * turn)
    own = path / around
    measured = np.diff(around * ((1 + theta[3]) * own.real + 1j * (1 + theta[4]) * own.imag))
    missed = measured - told
    return np.stack(
        [missed.real, missed.imag, np.diff(turn) - np.arctan2(A[:, 1, 0] - A[:, 0, 1], A[:, 0, 0] + A[:, 1, 1])]
    )


def _matrix(calibration: Calibration) -> Array:
    return rigid(calibration.rotation, calibration.offset_mm)


def _elevation(poses: Array) -> Array:
    """(n − 1,) mm out of the plane from each picture to the next."""
    return np.asarray((inverse(poses[1:]) @ poses[:-1])[:, 2, 3])


def _whitened(rows: Array, white: float, walk: Array) -> Array:
    """(p, m) differences → (p, m) of unit variance; walk (m,) between two pictures."""
    covariance = np.diag(2 * white + walk)
    neighbours = np.arange(walk.size - 1)
    covariance[neighbours, neighbours + 1] = covariance[neighbours + 1, neighbours] = -white
    return np.asarray(solve_triangular(np.linalg.cholesky(covariance), rows.T, lower=True).T)
