"""Computes Cramér–Rao bounds: how well a session's motion can show each parameter at all.

It uses central differences of what tracker and picture would report, independently of the solver's own derivatives:
measured less predicted steps of the picture's middle and turn, white tracker noise on an offset of each chain, and the
random walk that leaving the plane adds (docs/method.md, equations 15 and 20).
"""

from functools import lru_cache
from math import log, radians

import numpy as np
from scipy.linalg import solve_triangular

from probewatch.appliance.core.parameters import PER_UNIT
from probewatch.drivers.rigid import Array, ComplexArray, inverse, rigid, rotation_from_vector
from probewatch.tools.study.session import FPS, Session, picture_path, steps_between

BOUND_S = 30.0
"""Seconds of motion: as long as a verification lasts, so what it cannot show cannot be known."""
FALSE_ALARM_H = 1000.0
"""Hours: mean time between two false alarms of the test whose least delay is given; longer makes it surer, and so
later."""
LN_A = log(FALSE_ALARM_H * 3600 * FPS)
"""Value that the log-likelihood ratio must reach for that (Shiryaev and Roberts), about 18.5."""
_WALK_MM2_PER_MM = 0.002
"""Drift of a path per mm out of the plane, mm², measured on tissue; .01 to .1 on wires in water."""
_TURN_WALK_DEG = 0.02
_CHAIN_WALK_MM = 0.01
"""Drift per √s of the registration along its chain: the floors that the line itself assumes."""
_SMALL = np.array([1e-4] * 3 + [1e-4] * 2 + [1e-2] * 3 + [1e-3])
"""Half of a difference, rad, relative, mm, s: the second order is six digits below."""


@lru_cache(maxsize=8)
def bounds(session: Session, noise_mm: float, noise_deg: float, span_s: float = BOUND_S) -> Array:
    """Returns the least standard deviation, (9,), of PARAMETERS and the latency, in deg, %, mm and ms, from the first
    span_s; inf where the motion shows nothing. Breathing is taken as known.
    """
    t_s = np.arange(0.0, span_s, 1 / FPS)
    t_s = t_s[session.touches(t_s)]
    still = session.at_rest
    path, turn = picture_path(still.pictures(t_s))
    steps = np.stack([_steps(still, t_s, path, turn, part) for part in np.vstack([np.diag(_SMALL), -np.diag(_SMALL)])])
    J = (steps[:9] - steps[9:]) / (2 * _SMALL[:, None, None])
    noises = _noises(still, t_s, noise_mm, noise_deg)
    rows = [_whitened(J[:, row], white, walk) for row, (white, walk) in enumerate(noises)]
    information = sum(row @ row.T for row in rows) / np.outer(PER_UNIT, PER_UNIT)
    # Where the motion shows nothing along an axis, its variance is infinite, and so is that of each parameter in it.
    values, axes = np.linalg.eigh(information)
    known = np.where(values > 1e-9 * values[-1], 1 / np.maximum(values, 1e-300), np.inf)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(np.where(axes**2 > 1e-9, axes**2 * known, 0.0).sum(axis=1)))


def least_delay_s(session: Session, change: Array, noise_mm: float, noise_deg: float, from_s: float = 0.0) -> float:
    """Returns the seconds from from_s on until a test that expects one false alarm in FALSE_ALARM_H hours can be sure
    of this change on average: until the divergence (Kullback and Leibler) of truth and calibration in use reaches LN_A.
    Returns infinity where BOUND_S of the motion do not suffice. Noise and breathing are taken as known, and nothing
    else as changed.

    change: (9,) of PARAMETERS and latency, in rad, relative, mm and s.
    """
    t_s = np.arange(from_s, min(from_s + BOUND_S, session.duration_s), 1 / FPS)
    t_s = t_s[session.touches(t_s)]
    if t_s.size < 2:
        return np.inf
    still = session.at_rest
    path, turn = picture_path(still.pictures(t_s))
    missed = _steps(still, t_s, path, turn, change) - _steps(still, t_s, path, turn, np.zeros(9))
    noises = _noises(still, t_s, noise_mm, noise_deg)
    told = sum(_whitened(missed[None, row], white, walk)[0] ** 2 for row, (white, walk) in enumerate(noises))
    enough = np.flatnonzero(np.cumsum(told) / 2 >= LN_A)
    return float(t_s[1 + enough[0]] - from_s) if enough.size else np.inf


def _noises(session: Session, t_s: Array, noise_mm: float, noise_deg: float) -> list[tuple[float, Array]]:
    """Returns the white variance and the random walk between pictures of the lateral and axial path, mm², and of the
    turn, rad².
    """
    elevation_mm = np.abs(steps_between(session.pictures(t_s))[2])
    reach = float(np.linalg.norm(session.reference.offset_mm))
    white_mm2 = noise_mm**2 + (reach * radians(noise_deg)) ** 2
    walk_mm2 = _WALK_MM2_PER_MM * elevation_mm + _CHAIN_WALK_MM**2 * np.diff(t_s)
    walk_rad2 = radians(_TURN_WALK_DEG) ** 2 * np.diff(t_s)
    return [(white_mm2, walk_mm2), (white_mm2, walk_mm2), (radians(noise_deg) ** 2, walk_rad2)]


def _steps(session: Session, t_s: Array, path: ComplexArray, turn: Array, theta: Array) -> Array:
    """Returns the measured less the predicted step, (3, n − 1): lateral and axial in the chain's axes, mm, and turn,
    rad, where the truth differs from the calibration in use by theta.
    """
    reference = session.reference
    believed = rotation_from_vector(theta[:3]) @ reference.rotation, reference.offset_mm + theta[5:8]
    seen = session.sensor(t_s + theta[8], session.world.sensor_to_picture) @ inverse(rigid(*believed))
    moved, turned, _ = steps_between(seen)
    # The steps that the tracker predicts with theta, then those that the picture shows in its changed scales.
    told = -np.exp(-1j * turn[1:]) * moved
    around = np.exp(-1j * turn)
    own = path / around
    measured = np.diff(around * ((1 + theta[3]) * own.real + 1j * (1 + theta[4]) * own.imag))
    missed = measured - told
    return np.stack([missed.real, missed.imag, np.diff(turn) - turned])


def _whitened(rows: Array, white: float, walk: Array) -> Array:
    """Whitens differences, (p, m) → (p, m) of unit variance; walk (m,) is that between two pictures."""
    covariance = np.diag(2 * white + walk)
    neighbours = np.arange(walk.size - 1)
    covariance[neighbours, neighbours + 1] = covariance[neighbours + 1, neighbours] = -white
    return np.asarray(solve_triangular(np.linalg.cholesky(covariance), rows.T, lower=True).T)
