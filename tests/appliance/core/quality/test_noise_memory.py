"""Noise of a rest starts the next solution, and accuses no motion that follows."""

import numpy as np

from probewatch.appliance.core.path.blocks import PARTS
from probewatch.appliance.core.path.noise import Noise
from probewatch.appliance.core.quality.noise_memory import NoiseMemory

S = 1_000_000_000
MOVED_MM, STILL_MM = 10.0, 1.5


def noise(size: float) -> Noise:
    return Noise(np.full((3, PARTS), size))


def test_after_a_long_rest_new_motion_is_held_against_the_noise_of_the_motion_before() -> None:
    noises, moving, resting = NoiseMemory(), noise(1.0), noise(0.01)
    noises.learn(10 * S, moving, 10 * S, MOVED_MM)
    for t_s in range(11, 61):
        noises.learn(t_s * S, resting, 30 * S, STILL_MM)
    assert noises.until(60 * S) is resting
    assert noises.of_motion(50 * S) is moving


def test_a_rest_alone_leaves_nothing_to_hold_motion_against() -> None:
    noises = NoiseMemory()
    for t_s in range(10, 40):
        noises.learn(t_s * S, noise(0.01), 10 * S, STILL_MM)
    assert noises.until(40 * S) is not None
    assert noises.of_motion(40 * S) is None


def test_motion_is_held_against_what_was_learned_before_it() -> None:
    noises = NoiseMemory()
    learned = [noise(float(t_s)) for t_s in range(40)]
    for t_s, one in enumerate(learned):
        noises.learn(t_s * S, one, 10 * S, MOVED_MM)
    assert noises.of_motion(30 * S) is learned[30]
    assert noises.of_motion(0) is learned[29], "the oldest that is kept"
