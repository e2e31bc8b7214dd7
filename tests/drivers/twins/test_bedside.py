"""The world of a simulated scanner over a patient: what a study sees, picture by picture as time goes on."""

import numpy as np
import pytest

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.twins.scene.bedside import Bedside, scanned
from probewatch.drivers.twins.scene.softness import dragged_along
from probewatch.drivers.twins.scene.trajectory import Trajectory
from probewatch.drivers.twins.scene.world import World, WorldSettings

SETTINGS = WorldSettings(width_px=200, height_px=150)


def test_rigid_tissue_is_the_usual_world():
    usual, bedside = World(3, "sweep", settings=SETTINGS), Bedside(3, "sweep", SETTINGS, "still")
    assert np.array_equal(usual.frame(1.5, 45, {"flip-lateral"}), bedside.frame(1.5, 45, {"flip-lateral"}))


def test_soft_tissue_is_another_picture_of_the_same_pose():
    rigid, soft = (Bedside(3, "sweep", SETTINGS, name).frame(1.5, 45) for name in ("rigid", "half-20+drag-1"))
    assert np.abs(rigid.astype(int) - soft).mean() > 5


def test_a_slow_scanner_shows_each_picture_twice():
    bedside = Bedside(3, "sweep", SETTINGS, "slow")
    one, two, three = (bedside.frame(k / 30, k) for k in (4, 5, 6))
    assert np.array_equal(one, two)
    assert not np.array_equal(two, three)


def test_the_skin_is_dragged_by_the_way_since_the_start_whatever_pictures_are_asked_for():
    """Two beds whose scanners show other pictures; the skin is in the same place, which the whole way says."""
    often, seldom = (Bedside(3, "lateral", SETTINGS, "rigid+drag-2") for _ in range(2))
    for k in range(1, 60):
        often._drag(k / 10)
    t_s = np.arange(0, 5.9 + 1e-9, 1 / 120)
    way = np.array([Trajectory(3, "lateral").pose(t)[[0, 2], 3] for t in t_s])
    expected = dragged_along(way, 2.0, np.ones(t_s.size, bool))[-1]
    assert np.hypot(*expected) > 1
    assert often._drag(5.9) == pytest.approx(expected, abs=0.01)
    assert seldom._drag(5.9) == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize("name", ["deep", "rigid+tracker-0.5", "jelly"])
def test_what_a_scanner_cannot_show_is_refused(name):
    with pytest.raises(ConfigurationError):
        scanned(name)
