"""How exactly a stretch is measured, also one that hardly moves the edges of the picture."""

import numpy as np
import pytest

from probewatch.appliance.core.detectors.picture_link import small
from probewatch.appliance.core.detectors.stretch import carried, likeness_in_place, seen_in_both, stretch_between
from tests.appliance.core.detectors.test_picture_chain import speckle, stretched


@pytest.mark.parametrize("about", [(0.5, 0.5), (0.5, 0.0), (0.2, 0.8)])
@pytest.mark.parametrize(("across", "down"), [(1.018, 1.018), (1.036, 1.036), (0.97, 0.97), (1.0, 1.04), (1.05, 1.0)])
def test_a_small_stretch_is_measured_to_a_quarter_of_a_percent(
    across: float, down: float, about: tuple[float, float]
) -> None:
    """Parts at the edge of the picture, which cannot be seen to move outwards, do not draw it to nothing."""
    found = stretch_between(small(speckle()), small(stretched(speckle(), across, down, about)), 1.0, (1.0, 1.0))
    assert found is not None
    assert found.magnification == pytest.approx((across, down), abs=0.0025)


def test_a_picture_that_is_carried_lies_where_its_tissue_went() -> None:
    wide = speckle((240, 400))
    before, now = small(wide[:, 40:360]), small(wide[:, 20:340])
    assert likeness_in_place(carried(before, (np.array([10.0, 0.0]), 0.0), 1.0), now) > 0.95
    assert likeness_in_place(carried(before, (np.array([-10.0, 0.0]), 0.0), 1.0), now) < 0.3


def test_a_stretch_explains_what_shift_and_turn_leave_and_sliding_parts_none() -> None:
    picture, wide = speckle(), speckle((240, 400))
    found = stretch_between(small(picture), small(stretched(picture, 1.03, 1.03, (0.5, 0.5))), 1.0, (1.0, 1.0))
    assert found is not None
    assert found.gained_px == pytest.approx(found.apart_px, rel=0.15)
    slid = wide[:, 40:360].copy()
    slid[80:] = wide[80:, 34:354]
    found = stretch_between(small(wide[:, 40:360]), small(slid), 1.0, (1.0, 1.0))
    assert found is not None
    assert found.gained_px < 0.1


def test_pictures_are_compared_where_both_show_something() -> None:
    """The edge of a window stands still, whatever is done to what it shows; nothing that touches it counts."""
    before, now = np.zeros((120, 160), np.float32), np.zeros((120, 160), np.float32)
    before[10:110, 30:120] = now[5:100, 40:130] = 1.0
    assert [one.shape for one in seen_in_both(before, now)] == [(88, 78), (88, 78)]
    assert all(one.all() for one in seen_in_both(before, now))
    now[:, 70:] = 0.0
    assert seen_in_both(before, now)[0].shape == before.shape, "28 columns hold no parts side by side"
