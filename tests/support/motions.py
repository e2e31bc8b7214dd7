"""Paths of a probe as a solver sees them, made without pictures: truth in closed form, noise seeded."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from probewatch.appliance.core.path.samples import PathSamples
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array, inverse, rigid, rotation_from_vector

TRUTH = Calibration(
    rotation=rotation_from_vector(np.array([0.62, -0.41, 0.93])),
    polarity=(1, 1),
    scale_mm_per_px=np.array([0.08, 0.07]),
    offset_mm=np.array([11.0, 62.0, 14.0]),
    image_size_px=(640, 480),
)
_FPS = 30.0
_APART_S = 0.1


@dataclass(frozen=True)
class Noise:
    """Standard deviations per axis of one tracker reading and of one registered picture; drifts are per √s.

    The drifts are those measured on rendered pictures: a chain of keyframes wanders, and a hand never holds a plane.
    """

    position_mm: float = 0.1
    angle_deg: float = 0.02
    picture_px: float = 0.02
    drift_mm: float = 0.01
    drift_deg: float = 0.02


def planar_path(t_s: Array) -> Array:
    """(n,) → (n, 4, 4) picture → tissue: sweeps in both directions up to 15 mm/s, ±6° of turn, nothing out of plane."""
    centre = np.stack([6 * np.sin(2.3 * t_s), 5 * np.sin(3.1 * t_s + 1), np.zeros_like(t_s)], axis=1)
    turn = np.stack([np.zeros_like(t_s), np.zeros_like(t_s), 0.1 * np.sin(1.7 * t_s)], axis=1)
    return rigid(rotation_from_vector(turn), centre)


def tilting_path(t_s: Array) -> Array:
    """The planar path with 3 mm of elevational motion and ±2° of tilt."""
    extra = np.stack([np.zeros_like(t_s), np.zeros_like(t_s), 3 * np.sin(1.3 * t_s)], axis=1)
    tilt = np.stack([0.035 * np.sin(2.9 * t_s), 0.035 * np.sin(2.1 * t_s + 2), np.zeros_like(t_s)], axis=1)
    return planar_path(t_s) @ rigid(rotation_from_vector(tilt), extra)


def picture_path(truth: Calibration, pictures: Array) -> tuple[Array, Array]:
    """(n, 4, 4) picture → tissue to the path (u px (n, 2), α rad (n,)) that perfect registration reports, Eq. 1."""
    u_mm, alpha = np.zeros((len(pictures), 2)), np.zeros(len(pictures))
    for j in range(1, len(pictures)):
        A = inverse(pictures[j]) @ pictures[j - 1]
        turn = np.arctan2(A[1, 0] - A[0, 1], A[0, 0] + A[1, 1])
        c, s = np.cos(turn), np.sin(turn)
        u_mm[j] = np.array([[c, -s], [s, c]]) @ u_mm[j - 1] + A[:2, 3]
        alpha[j] = alpha[j - 1] + turn
    return u_mm / (truth.scale_mm_per_px * np.array(truth.polarity)), alpha * np.prod(truth.polarity)


def samples(
    path: Callable[[Array], Array],
    frames: int,
    seed: int,
    noise: Noise,
    truth: Calibration = TRUTH,
    start_s: float = 0.0,
    rigid_tissue: bool = True,
) -> PathSamples:
    """What the solver would be given for `frames` pictures on `path`. rigid_tissue: whether it knows that it is."""
    random = np.random.default_rng(seed)
    t_s = start_s + np.arange(frames) / _FPS
    u_px, alpha = picture_path(truth, path(t_s))
    X = rigid(truth.rotation, truth.offset_mm)
    wander = _wander(frames, random, noise)
    around = [_measured(path(t_s + shift) @ wander @ X, random, noise) for shift in (0.0, -_APART_S / 2, _APART_S / 2)]
    u_px = u_px + random.normal(0, noise.picture_px, u_px.shape)
    return PathSamples(t_s, np.zeros(frames, dtype=np.int64), u_px, alpha, *around, _APART_S, rigid=rigid_tissue)


def _wander(frames: int, random: np.random.Generator, noise: Noise) -> Array:
    """Random walk between what the picture shows and where the probe is, (n, 4, 4)."""
    walk = np.cumsum(random.normal(0, 1 / np.sqrt(_FPS), (frames, 6)), axis=0)
    return rigid(rotation_from_vector(walk[:, :3] * np.deg2rad(noise.drift_deg)), walk[:, 3:] * noise.drift_mm)


def _measured(poses: Array, random: np.random.Generator, noise: Noise) -> Array:
    turn = random.normal(0, np.deg2rad(noise.angle_deg), (len(poses), 3))
    shift = random.normal(0, noise.position_mm, (len(poses), 3))
    measured = poses @ rigid(rotation_from_vector(turn), np.zeros((len(poses), 3)))
    measured[:, :3, 3] += shift
    return measured
