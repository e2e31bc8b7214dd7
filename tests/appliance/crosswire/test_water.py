"""The published speed of sound, and a calibration carried from a tank to tissue."""

from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.crosswire.water import for_tissue, speed_of_sound_m_s
from tests.support.crossings import TRUE


@pytest.mark.parametrize(("water_c", "m_s"), [(0, 1402.385), (20, 1482.38), (25, 1496.73), (48, 1540.27), (74, 1555.1)])
def test_the_speed_is_that_of_the_tables(water_c: float, m_s: float) -> None:
    assert speed_of_sound_m_s(water_c) == pytest.approx(m_s, abs=0.05)


@pytest.mark.parametrize("water_c", [-1, 96, float("nan")])
def test_no_speed_outside_of_water(water_c: float) -> None:
    with pytest.raises(ValueError, match="outside of 0 to 95"):
        speed_of_sound_m_s(water_c)


def test_in_tissue_depths_grow_from_the_probes_face() -> None:
    tank = replace(TRUE, scale_mm_per_px=TRUE.scale_mm_per_px * [1, 1482.38 / 1540])
    tissue = for_tissue(tank, 1482.38, face_row_px=30)

    def in_sensor(calibration, column: float, row: float) -> np.ndarray:
        in_picture = [*((np.array([column, row]) - [319.5, 239.5]) * calibration.scale_mm_per_px), 0.0]
        return calibration.rotation.T @ (np.array(in_picture) - calibration.offset_mm)

    np.testing.assert_allclose(tissue.scale_mm_per_px, TRUE.scale_mm_per_px, rtol=1e-12)
    np.testing.assert_allclose(in_sensor(tank, 100, 30), in_sensor(tissue, 100, 30), atol=1e-9)
    grown = np.linalg.norm(in_sensor(tissue, 100, 430) - in_sensor(tissue, 100, 30))
    assert grown == pytest.approx(400 * 0.07)
