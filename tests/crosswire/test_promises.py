"""The promises of the cross-wire tool, on a few views and scans each time, on thousands before a release."""

import numpy as np
import pytest

from tests.crosswire.scans import scan_score, scanned
from tests.crosswire.views import drawn_view, score, world_view


@pytest.mark.parametrize(
    ("view", "number"),
    [
        pytest.param(world_view, 60, marks=pytest.mark.thorough),
        pytest.param(drawn_view, 120, marks=pytest.mark.thorough),
        pytest.param(world_view, 1000, marks=pytest.mark.slow),
        pytest.param(drawn_view, 1000, marks=pytest.mark.slow),
    ],
)
def test_the_crossing_is_found_beside_clutter_and_nowhere_else(view, number: int) -> None:
    found = score([view(seed) for seed in range(number)])
    assert found.found >= (1 if view is world_view else 0.96), "half of them each: 98 % together"
    assert found.error_mm <= (0.15 if number >= 100 else 0.2)
    assert found.false <= (0.01 if number >= 100 else 0.03)
    assert found.covered >= 0.6


@pytest.mark.parametrize("number", [15, pytest.param(200, marks=pytest.mark.slow)])
def test_scans_keep_their_sigmas_and_put_points_right(number: int) -> None:
    found = scan_score([scanned(seed) for seed in range(number)])
    assert found.accepted == 1
    assert found.zeta >= 0.98 - 1.5 / number
    assert found.closed >= 0.98 - 1.5 / number
    assert found.covered == pytest.approx(0.68, abs=0.05 + 0.5 / np.sqrt(8 * number))
    assert found.points_mm <= 0.5
