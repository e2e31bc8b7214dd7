"""The solvers against each other and the Cramér–Rao bound, on planar motions without pictures."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from probewatch.appliance.core.handeye.motions import HandEye, Motions
from probewatch.appliance.core.handeye.scaled_rotation import solve_scaled_rotation
from probewatch.drivers.rigid import vector_from_rotation
from tests.paper.solvers.likelihood import TrackerNoise, refine
from tests.paper.solvers.norm_constraint import solve_norm_constraint
from tests.paper.solvers.planar import solve_planar
from tests.support.handeye_motions import OFFSET_MM, ROTATION, SCALE, motions, picture_moves

NOISES_MM = (0.1, 0.25)
RUNS = 200
_ANGLE_RAD = float(np.deg2rad(0.02))
_LEVER_MM = ROTATION.T @ OFFSET_MM
_STEP_MM, _TURN_RAD, _MOTIONS = 1.0, 0.03, 100

BOUND = "Cramér–Rao bound"
METHODS: dict[str, Callable[[Motions, TrackerNoise], HandEye]] = {
    "norm constraint + Horn": lambda m, _: solve_norm_constraint(m.u, m.displacements(_LEVER_MM)),
    "nine parameters, QR": lambda m, _: solve_scaled_rotation(m.u, m.displacements(_LEVER_MM), "qr"),
    "nine parameters, polar": lambda m, _: solve_scaled_rotation(m.u, m.displacements(_LEVER_MM)),
    "planar, Eq. 5–7": lambda m, _: solve_planar(m),
    "maximum likelihood": lambda m, noise: refine(m, solve_planar(m), noise),
}


@dataclass(frozen=True)
class Score:
    """bias: largest |mean error| of rotations and scales in standard deviations; NaN for the bound. scale_percent:
    RMS of both scales. rotation_deg: RMS of the whole rotation.
    """

    noise_mm: float
    method: str
    bias: float
    scale_percent: float
    rotation_deg: float


def scores() -> Iterator[Score]:
    """Every method at every noise, RUNS times 100 motions of 1 mm and 2°, and the bound where t_x is unknown."""
    for noise_mm in NOISES_MM:
        noise = TrackerNoise(noise_mm, _ANGLE_RAD)
        given = [_motions(seed, noise_mm) for seed in range(RUNS)]
        for name, method in METHODS.items():
            errors = np.array([_error(method(m, noise)) for m in given])
            bias = np.max(np.abs(errors.mean(axis=0)) / errors.std(axis=0))
            yield _score(noise_mm, name, float(bias), np.mean(errors**2, axis=0))
        yield _score(noise_mm, BOUND, np.nan, np.mean([_bound(seed, noise) for seed in range(20)], axis=0))


def _score(noise_mm: float, name: str, bias: float, mean_square: np.ndarray) -> Score:
    scale, rotation = np.sqrt(np.mean(mean_square[3:])), np.sqrt(np.sum(mean_square[:3]))
    return Score(noise_mm, name, bias, float(100 * scale), float(np.degrees(rotation)))


def _motions(seed: int, noise_mm: float, angle_rad: float = _ANGLE_RAD) -> Motions:
    spread = np.array([_STEP_MM, _STEP_MM, 0.0]), np.array([0.0, 0.0, _TURN_RAD])
    return motions(picture_moves(np.random.default_rng(seed), _MOTIONS, *spread), seed, noise_mm, angle_rad)


def _bound(seed: int, noise: TrackerNoise) -> np.ndarray:
    """(5,) variances from the information of the same motions without their noise."""
    clean = _motions(seed, 0.0, 0.0)
    covariance = refine(clean, solve_planar(clean), noise).covariance
    assert covariance is not None
    return np.diag(covariance)[:5]


def _error(found: HandEye) -> np.ndarray:
    return np.concatenate([vector_from_rotation(found.rotation @ ROTATION.T), found.scale / SCALE[:2] - 1])
