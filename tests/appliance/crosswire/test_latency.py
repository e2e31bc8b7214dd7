"""The moving bottom of a simulated tank: the lag it shows, and when it shows none."""

import numpy as np
import pytest

from probewatch.appliance.crosswire.latency import BottomLine
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp


def session(
    late_s: float, amplitude_mm: float = 12.0, line_grey: float = 200.0, leap_s: int = 0, period_s: float = 0.0
) -> BottomLine:
    """leap_s: of all stamps, from 8 s on. period_s: of strokes that are all alike; 0 for others."""
    random = np.random.default_rng(4)
    bottom = BottomLine()
    rows = np.arange(300)[:, None]

    def height_mm(t_s: float) -> float:
        if period_s:
            return float(amplitude_mm * np.sin(2 * np.pi * t_s / period_s))
        return amplitude_mm * np.sin(2 * np.pi * t_s / 2.3) + 0.3 * amplitude_mm * np.sin(2 * np.pi * t_s / 0.9)

    for index in range(180):
        t_s = index / 12
        line = line_grey * np.exp(-(((rows - 150 - height_mm(t_s) / 0.15) / 3) ** 2))
        image = np.clip(line + random.normal(20, 6, (300, 200)), 0, 255)
        image[20:24] = 220  # the probe's face, which never moves
        bottom.step(
            Frame(Stamp(10**9 + round(t_s * 1e9) + leap_s * 10**9 * (t_s > 8), 500), index, image.astype(np.uint8))
        )
    for index in range(-30, 780):
        t_s = index / 46
        pose = np.eye(4)
        pose[:3, 3] = np.array([0.2, 0.9, 0.4]) * height_mm(t_s - late_s) + random.normal(0, 0.1, 3)
        bottom.step(
            Pose(Stamp(10**9 + round(t_s * 1e9) + leap_s * 10**9 * (t_s > 8), 500), index, pose, 0.1, PoseStatus.OK)
        )
    return bottom


@pytest.mark.parametrize("late_s", [-0.6, -0.08, 0.0, 0.05, 0.45, 0.95])
def test_the_lag_is_found_within_its_sigma(late_s: float) -> None:
    found = session(late_s).latency()
    assert found is not None
    assert abs(found.value_s - late_s) < 3 * found.sigma_s
    assert found.sigma_s < 0.01


@pytest.mark.parametrize("late_s", [-0.25, 0.0, 0.25])
def test_strokes_of_two_seconds_that_are_all_alike_tell_a_lag_of_less_than_a_quarter_of_them(late_s: float) -> None:
    found = session(late_s, period_s=2.0).latency()
    assert found is not None
    assert abs(found.value_s - late_s) < 3 * found.sigma_s < 0.06


def test_a_lag_of_more_than_a_second_is_not_told_as_another() -> None:
    assert session(1.1).latency() is None


def test_a_probe_at_rest_or_a_tank_without_bottom_tells_nothing() -> None:
    assert session(0.0, amplitude_mm=0.0).latency() is None
    dark = session(0.0, line_grey=0.0)
    assert dark.latency() is None
    assert dark.seen < 20
    assert BottomLine().latency() is None


def test_stamps_that_leap_by_years_tell_nothing() -> None:
    """The grid of times between them took terabytes."""
    assert session(0.0, leap_s=4_000_000_000).latency() is None
