"""Latency from the two paths alone: its sign, its sigma, what it does not need to know, and when it stays silent."""

from dataclasses import replace

import numpy as np
import pytest

from probewatch.drivers.rigid import rigid, rotation_from_vector
from tests.support.motions import TRUTH, planar_path, tilting_path
from tests.support.windows import elevational_path, filled


@pytest.mark.parametrize("late_s", [-0.1, -0.03, 0.0, 0.02, 0.075, 0.2])
def test_a_late_tracker_has_a_positive_latency(late_s: float) -> None:
    found = filled(planar_path, 6.0, 1, late_s=late_s).latency()
    assert found is not None
    assert found.value_s == pytest.approx(late_s, abs=0.008)
    assert found.sigma_s < 0.03


@pytest.mark.parametrize("late_s", [-0.285, 0.285])
def test_a_lag_at_the_end_of_what_is_looked_at_is_told_or_not_but_breaks_nothing(late_s: float) -> None:
    found = filled(planar_path, 6.0, 1, late_s=late_s).latency()
    assert found is None or found.value_s == pytest.approx(late_s, abs=0.02)


def test_ten_degrees_and_ten_percent_of_wrong_calibration_do_not_matter() -> None:
    wrong = replace(
        TRUTH,
        rotation=rotation_from_vector(np.array([0.1, -0.1, 0.1])) @ TRUTH.rotation,
        scale_mm_per_px=TRUTH.scale_mm_per_px * [1.1, 0.9],
    )
    found = filled(planar_path, 6.0, 2, reference=wrong, late_s=0.06).latency()
    assert found is not None
    assert found.value_s == pytest.approx(0.06, abs=0.015)


def test_tracker_noise_does_not_pull_it_towards_the_middle_between_two_poses() -> None:
    """Poses half a period off the frames: interpolated noise is least there; unsmoothed it would lock."""
    errors = [
        filled(planar_path, 6.0, seed, late_s=1 / 240, position_mm=0.3).latency().value_s - 1 / 240
        for seed in range(12)
    ]
    assert abs(np.mean(errors)) < 0.003


def test_sigma_covers_the_error() -> None:
    found = [filled(tilting_path, 5.0, seed, late_s=0.04, position_mm=0.25).latency() for seed in range(20)]
    assert all(latency is not None for latency in found)
    assert np.mean([abs(latency.value_s - 0.04) < 2 * latency.sigma_s for latency in found]) >= 0.95


def steady(t_s: np.ndarray) -> np.ndarray:
    """10 mm/s along one line: any lag explains it as well as any other."""
    return rigid(np.tile(np.eye(3), (len(t_s), 1, 1)), np.stack([10 * t_s, 0 * t_s, 0 * t_s], axis=1))


@pytest.mark.parametrize(
    "path", [steady, elevational_path, lambda t: rigid(np.tile(np.eye(3), (len(t), 1, 1)), np.zeros((len(t), 3)))]
)
def test_motion_that_does_not_show_it_gives_none(path) -> None:  # type: ignore[no-untyped-def]
    assert filled(path, 5.0, 3).latency() is None


def test_too_little_gives_none() -> None:
    assert filled(planar_path, 0.3, 1).latency() is None
