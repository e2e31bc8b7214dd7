"""Models a tracker whose error depends on the place, slowly: what its makers call volumetric accuracy. It is pure."""

import numpy as np

from probewatch.drivers.rigid import Array, rigid, rotation_from_vector

_DEG_PER_MM = 0.4
"""Degrees of a turn per mm of error of a place: .3° with .75 mm, as an optical tracker's residual against a robot's
arm."""
_WAVES, _SHORTEST_MM, _LONGEST_MM = 8, 80.0, 240.0
"""Waves that make up the error: alike over one to three centimetres. .8 mm of it grow by 2.1 % of a path (standard
deviation, 20 seeds), as a wrong scale would; shorter waves more, longer ones are an offset that no picture shows."""


def erring_by_place(poses: Array, size_mm: float, seed: int) -> Array:
    """Returns poses, (n, 4, 4) sensor → tracker, with an error of this standard deviation for each axis, and of turns
    accordingly. seed: seeds the error.
    """
    if not size_mm:
        return poses
    random = np.random.default_rng((seed, 71))
    heading = random.standard_normal((_WAVES, 3))
    length_mm = random.uniform(_SHORTEST_MM, _LONGEST_MM, (_WAVES, 1))
    waves = 2 * np.pi * heading / np.linalg.norm(heading, axis=1, keepdims=True) / length_mm
    phase = random.uniform(0, 2 * np.pi, (_WAVES, 6))
    amplitude = np.sqrt(2 / _WAVES) * size_mm * np.array([1.0] * 3 + [_DEG_PER_MM] * 3)
    error = np.sin((poses[:, :3, 3] @ waves.T)[:, :, None] + phase).sum(axis=1) * amplitude
    erring = poses @ rigid(rotation_from_vector(np.deg2rad(error[:, 3:])), np.zeros((len(poses), 3)))
    erring[:, :3, 3] += error[:, :3]
    return np.asarray(erring)
