"""A point elsewhere, put where a calibration says."""

from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.crosswire.checkpoint import check_point, reconstructed_mm
from probewatch.appliance.crosswire.offset import ScanRefused
from tests.support.crossings import CROSSING_MM, TRUE, guided_views

QUIET = {"noise_mm": 0.0, "noise_deg": 0.0, "noise_px": 0.0}


def test_the_true_calibration_puts_every_view_where_the_point_is() -> None:
    views = guided_views(1, 12, **QUIET)
    np.testing.assert_allclose(reconstructed_mm(TRUE, views), np.tile(CROSSING_MM, (12, 1)), atol=1e-9)
    check = check_point(TRUE, views, CROSSING_MM)
    assert check.passed
    assert check.error_mm < 1e-9


def test_noise_alone_passes_and_a_wrong_offset_does_not() -> None:
    views = guided_views(2, 12)
    assert check_point(TRUE, views).passed
    wrong = replace(TRUE, offset_mm=TRUE.offset_mm + np.array([0.0, 0.0, 6.0]))
    assert not check_point(wrong, views).passed
    assert not check_point(wrong, views, CROSSING_MM).passed


def test_an_error_that_all_views_share_shows_only_where_the_point_is_known() -> None:
    views = guided_views(3, 12)
    assert check_point(TRUE, views).passed
    assert not check_point(TRUE, views, CROSSING_MM + np.array([0, 3, 0])).passed


def test_two_views_agree_too_easily() -> None:
    with pytest.raises(ScanRefused, match="seen 2 times, 3 are needed"):
        check_point(TRUE, guided_views(4, 2))
