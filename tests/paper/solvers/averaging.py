"""Averaging many independent calibrations from one sweep (the paper's conclusion)."""

from dataclasses import dataclass, replace

import numpy as np

from probewatch.appliance.core.handeye.motions import HandEye
from probewatch.drivers.rigid import Array, rotation_from_vector, vector_from_rotation

_ROUNDS = 20
"""Most Gauss–Newton steps; a step of less than 1e-13, which ends it, comes long before, as the calibrations are near
one another.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Average:
    """mean: weighted by the information of each. scatter: mean square of the single ones about it, in their own sigmas;
    near 1 where they are what they claim to be. count: how many. Where scatter exceeds 1 the covariance grows with it.
    """

    mean: HandEye
    scatter: float
    count: int


def average(calibrations: list[HandEye]) -> Average:
    """Mean on SO(3) × R^k of rotations and scales; offsets are left out. Each needs a covariance; ValueError if none is
    given.
    """
    if not calibrations:
        raise ValueError("no calibration to average")
    information = np.stack([_information(c) for c in calibrations])
    total = np.linalg.inv(information.sum(axis=0))
    mean = calibrations[0]
    for _ in range(_ROUNDS):
        away = np.stack([_difference(c, mean) for c in calibrations])
        step = total @ np.einsum("nij,nj->i", information, away)
        mean = _moved(mean, step)
        if np.all(np.abs(step) < 1e-13):
            break
    away = np.stack([_difference(c, mean) for c in calibrations])
    freedom = max((len(calibrations) - 1) * total.shape[0], 1)
    scatter = float(np.einsum("ni,nij,nj->", away, information, away)) / freedom
    covariance = np.diag(np.full(len(total) + 3, np.inf))
    covariance[:-3, :-3] = total * max(scatter, 1.0)
    return Average(replace(mean, covariance=covariance), scatter, len(calibrations))


def _information(found: HandEye) -> Array:
    if found.covariance is None:
        raise ValueError("a calibration without covariance cannot be weighted")
    return np.asarray(np.linalg.inv(found.covariance[:-3, :-3]))


def _difference(found: HandEye, mean: HandEye) -> Array:
    turn = vector_from_rotation(found.rotation @ mean.rotation.T)
    return np.concatenate([turn, found.scale / mean.scale - 1])


def _moved(mean: HandEye, step: Array) -> HandEye:
    return replace(mean, rotation=rotation_from_vector(step[:3]) @ mean.rotation, scale=mean.scale * (1 + step[3:]))
