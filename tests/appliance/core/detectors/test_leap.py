"""The step between two readings of which little before tells how the hand went."""

import numpy as np
import pytest

from probewatch.appliance.core.detectors.leap import around_step, uneven_step


@pytest.mark.parametrize("dt_s", [0.05, 0.125, 0.24])
def test_of_a_wave_a_step_is_off_by_half_the_square_of_its_phase(dt_s: float) -> None:
    """At the wave's steepest, from equal steps: s (1 − cos ω dt), in closed form."""
    rate = 2 * np.pi / 2.15
    t_s = dt_s * np.array([-1.5, -0.5, 0.5, 1.5])
    step = 2 * np.sin(rate * dt_s / 2)
    off = uneven_step(t_s, np.sin(rate * t_s)[:, None])
    assert off == pytest.approx(step * (1 - np.cos(rate * dt_s)), abs=1e-9)
    assert off == pytest.approx(step * (rate * dt_s) ** 2 / 2, rel=0.05)


def test_a_leap_is_found_whole_in_even_motion_however_the_readings_are_spaced() -> None:
    t_s = np.array([0.0, 0.017, 0.2, 0.383])
    path = np.outer(t_s, [20.0, -3.0]) + np.array([0, 0, 1, 1])[:, None] * [9.0, 0.1]
    assert uneven_step(t_s, path) == pytest.approx([9.0, 0.1])


def test_without_a_reading_before_the_velocity_is_that_after() -> None:
    t_s = np.array([0.2, 0.2, 0.4, 0.5])
    assert uneven_step(t_s, 5 * t_s[:, None]) == pytest.approx([0.0])


def test_velocities_are_of_readings_a_tenth_of_a_second_apart_where_there_are_such() -> None:
    t_ns = np.array([0, 17, 34, 51, 68, 85, 102, 119, 300, 317, 400]) * 1_000_000
    assert around_step(t_ns, 8, 8, 100_000_000) == [1, 7, 8, 10]
    assert around_step(t_ns[7:], 1, 2, 100_000_000) == [0, 0, 2, 3]
