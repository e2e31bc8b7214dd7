"""Soft tissue against closed forms: the share that follows by depth, volume, the play of the skin, and what is seen."""

from functools import cache

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.twins.scene.breathing import DIRECTIONS, Rhythm
from probewatch.drivers.twins.scene.geometry import Geometry
from probewatch.drivers.twins.scene.patient import Patient, face_at
from probewatch.drivers.twins.scene.softness import DRAG_DEPTH_MM, Face, Follow, displacement, dragged_along
from probewatch.drivers.twins.scene.surroundings import PARTS, surroundings
from probewatch.drivers.twins.scene.tissue import Beam, Renderer, grown

NO_DRAG = np.zeros(2)
SCALE_MM = np.array([0.08, 0.07])
GEOMETRY = Geometry((240, 200), (0.08, 0.07))
SKIN_MM = -7.0


def pose(place_mm=(0.0, 0.0, 0.0), turn_deg=(0.0, 0.0, 0.0)):
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(np.radians(turn_deg)).as_matrix()
    matrix[:3, 3] = place_mm
    return matrix


@cache
def renderer():
    return Renderer((240, 200), (0.08, 0.07), Beam())


def seen(where, moved=None):
    return np.hypot(*renderer().field(grown(5, False), where, moved))


def even(way_mm):
    return lambda x_mm, y_mm: np.reshape(way_mm, (3, 1, 1)) + 0 * (x_mm + y_mm)


@pytest.mark.parametrize(
    ("follow", "depth_mm", "expected"),
    [
        (Follow(1.0, back_mm=80), 0, 1.0),
        (Follow(1.0, back_mm=80), 20, 0.75),
        (Follow(1.0, back_mm=80), 90, 0.0),
        (Follow(1.0, half_width_mm=20), 20, 0.5),
        (Follow(1.0, half_width_mm=20), -3, 1.0),
        (Follow(1.0, back_mm=80, half_width_mm=20), 20, 0.375),
        (Follow(0.4), 50, 0.4),
        (Follow(), 0, 0.0),
    ],
)
def test_tissue_follows_a_press_by_its_share_at_depth(follow, depth_mm, expected):
    face = Face(np.array([2.0, SKIN_MM + 3.0, 1.0]), 3.0, 0.0, NO_DRAG)
    point = np.array([2.0, SKIN_MM + 3.0 + depth_mm, 1.0])
    assert displacement(point, face, follow) == pytest.approx([0, 3.0 * expected, 0])


@pytest.mark.parametrize("follow", [Follow(1.0, back_mm=40), Follow(1.0, half_width_mm=20), Follow(1.0, 60.0, 30.0)])
def test_slope_is_the_derivative_of_the_share(follow):
    depth = np.linspace(1, 30, 20)
    assert follow.slope(depth) == pytest.approx((follow.share(depth + 1e-4) - follow.share(depth - 1e-4)) / 2e-4)


def test_what_is_pressed_gives_way_and_keeps_its_volume():
    face = face_at(pose((1, 0.5, 2), (3, 0, 2)), SKIN_MM, np.array([0.4, -0.3]))
    points = np.random.default_rng(1).uniform((-8, -3, -4), (8, 12, 4), (50, 3)).T
    strains = []
    for axis in range(3):
        step = 1e-4 * np.eye(3)[axis][:, None]
        ahead, behind = (
            displacement(points + way, face, Follow(1.0, half_width_mm=30), (3, -2)) for way in (step, -step)
        )
        strains.append(((ahead - behind) / 2e-4)[axis])
    assert np.abs(strains[1]).max() > 0.01
    # The slope of the face adds a second order to the first.
    assert np.abs(np.sum(strains, axis=0)).max() < 0.06 * np.abs(strains[1]).max()


def test_a_rocked_face_presses_one_side_more():
    face = face_at(pose(turn_deg=(0, 0, 6)), SKIN_MM, NO_DRAG)
    sides = np.array([[-5.0, 5.0], [5.0, 5.0], [0.0, 0.0]])
    left, right = displacement(sides, face, Follow(1.0, half_width_mm=20))[1]
    assert left < 0 < right


def test_skin_sticks_slips_and_loses_its_play_at_each_turn():
    there = np.linspace(0, 5, 501)
    way = np.concatenate([there, there[::-1]])
    held = dragged_along(np.stack([way, 0 * way], axis=1), 2.0, np.ones(way.size, bool))
    assert np.all(held[:, 1] == 0)
    assert held[:201, 0] == pytest.approx(way[:201]), "it sticks"
    assert held[200:501, 0] == pytest.approx(2.0), "it slips"
    slid = way - held[:, 0]
    assert slid[501:901] == pytest.approx(3.0, abs=0.011), "after the turn the face goes 4 mm and slips over nothing"
    assert held[-1, 0] == pytest.approx(-2.0)


def test_skin_sticks_alike_in_every_direction_and_goes_back_off_the_skin():
    way = np.stack([np.linspace(0, 3, 301), np.linspace(0, 4, 301)], axis=1)
    touches = np.arange(301) < 250
    held = dragged_along(way, 1.5, touches)
    assert held[249] == pytest.approx([0.9, 1.2])
    assert np.all(held[250:] == 0)


def test_drag_dies_out_with_depth():
    face = Face(np.array([0.0, SKIN_MM, 0.0]), 0.0, 0.0, np.array([2.0, -1.0]))
    point = np.array([0.0, SKIN_MM + DRAG_DEPTH_MM, 0.0])
    assert displacement(point, face, Follow()) == pytest.approx(np.array([2.0, 0, -1.0]) / np.e)


def test_tissue_that_moves_as_a_whole_looks_as_it_does_from_a_pose_shifted_back():
    way_mm, here = np.array([0.7, 1.3, -2.1]), pose((1, 2, 3), (8, -5, 6))
    shifted = here.copy()
    shifted[:3, 3] -= way_mm
    assert seen(here, even(way_mm)) == pytest.approx(seen(shifted), abs=0.005)
    assert np.array_equal(seen(here), seen(here, None))


def test_tissue_that_has_turned_looks_as_it_does_from_a_pose_turned_back():
    """The carrier turns with the probe alone: its phase goes by the way of the tissue along the beam."""
    there = pose((2, 1, 3))
    back = pose(turn_deg=(0, 0, 4))
    back[:3, 3] = (0.3, -0.4, 0)

    def turned(x_mm, y_mm):
        places = np.stack(np.broadcast_arrays(x_mm + 2, y_mm + 1, 3.0, 1.0))
        return (places - np.tensordot(back, places, 1))[:3]

    assert seen(there, turned) == pytest.approx(seen(back @ there), abs=0.01)


def test_tissue_pressed_together_moves_in_the_picture_as_asked():
    """Independent of the line: matched in blocks, between two presses of a layer on a back 14 mm down."""

    def pressed(press_mm):
        return lambda x_mm, y_mm: np.stack([0, press_mm, 0])[:, None, None] * (0 * x_mm + 0.5 - y_mm / 14)

    before, after = (np.log(seen(pose(), pressed(press)) + 0.05).astype(np.float32) for press in (0.8, 1.1))
    for row in (40, 100, 150):
        block = before[row - 12 : row + 13, 30:210]
        match = cv2.matchTemplate(after[row - 22 : row + 23, 30:210], block, cv2.TM_CCOEFF_NORMED)[:, 0]
        best = int(match.argmax())
        low, top, high = match[best - 1 : best + 2]
        found_mm = (best - 10 + (low - high) / (2 * (low - 2 * top + high))) * SCALE_MM[1]
        before_mm = (row - 99.5) * SCALE_MM[1] + 7
        at_rest_mm = before_mm - 0.8 * (1 - before_mm / 14)
        after_mm = (at_rest_mm + 1.1) / (1 + 1.1 / 14)
        assert found_mm == pytest.approx(after_mm - before_mm, abs=0.01)


def test_breath_goes_where_it_is_told_and_an_organ_more_than_its_wall():
    t_s = np.arange(0, 20, 0.05)
    usual = Rhythm(3, 20.0).breath_mm(t_s, 12.0)
    whole = Patient(surroundings("rigid+breath-12-oblique"), 3, GEOMETRY, 20.0).breathed(t_s)
    assert whole == pytest.approx(usual[:, None] * DIRECTIONS["oblique"])
    assert 9 < np.ptp(usual) < 17
    organ = Patient(surroundings("organ-12-elevational"), 3, GEOMETRY, 20.0)
    assert organ.breathed(t_s) == pytest.approx(usual[:, None] * (0, 0.25, 0))
    k = int(usual.argmax())
    wall, liver = organ.displaced(pose(), np.array([[0, 0], [-6, 6], [0, 0]]), t_s[k], NO_DRAG).T
    assert wall == pytest.approx([0, 0, 0])
    assert organ.breathed(t_s[k : k + 1])[0] + liver == pytest.approx(usual[k] * np.array([0, 0, 1]))


@pytest.mark.parametrize("to", DIRECTIONS)
def test_directions_are_unit_vectors(to):
    assert np.linalg.norm(DIRECTIONS[to]) == pytest.approx(1)


def test_a_name_says_what_it_says():
    world = surroundings("half-30+drag-2+breath-4-elevational")
    assert (world.follow, world.play_mm, world.breath_mm) == (Follow(1.0, half_width_mm=30), 2, 4)
    assert world.breath_to == (0, 0, 1)
    assert surroundings("still") == surroundings("rigid")
    assert surroundings("breathing") == surroundings("rigid+breath-4-axial+pulse")
    assert surroundings("layer-80+half-20").follow == Follow(1.0, 80, 20)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("jelly", "no part 'jelly'"),
        ("", "no part ''"),
        ("half", "half-MM"),
        ("half-30-axial", "half-MM"),
        ("half-3000", "out of range in 'half-3000' (mm 5 … 100)"),
        ("half-nan", "out of range"),
        ("ribs-1.5", "out of range in 'ribs-1.5' (number 1 … 2)"),
        ("breath-4", "breath-MM-TO"),
        ("breath-4-upwards", "breath-MM-TO"),
        ("half-30+half-20", "'half' twice"),
    ],
)
def test_a_world_that_is_none_is_refused_with_what_there_is(name, told):
    with pytest.raises(ConfigurationError) as refused:
        surroundings(name)
    assert told in str(refused.value)
    assert all(part in str(refused.value) for part in PARTS)
