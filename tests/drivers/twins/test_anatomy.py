"""What stands in the way of the beam, and a fan of beams: shadows that follow the beam, and speckle that follows it."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from probewatch.drivers.twins.scene.anatomy import RIBS_MM, rib_place
from probewatch.drivers.twins.scene.geometry import Geometry
from probewatch.drivers.twins.scene.patient import Patient
from probewatch.drivers.twins.scene.surroundings import surroundings
from probewatch.drivers.twins.scene.world import World, WorldSettings

SETTINGS = WorldSettings(width_px=320, height_px=240, overlay=False)
NO_DRAG = np.zeros(2)


def pose(turn_deg=0.0, place_mm=(0.0, 0.0, 0.0)):
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(np.radians([0, 0, turn_deg])).as_matrix()
    matrix[:3, 3] = place_mm
    return matrix


@cache
def world(name):
    return World(4, scene="speckle", settings=SETTINGS, surroundings=surroundings(name))


def sight(name, where, t_s=0.0):
    return Patient(surroundings(name), 4, world(name).geometry, 20.0).sight(where, t_s, NO_DRAG)


@pytest.mark.parametrize("turn_deg", [0, 6, -6])
def test_a_shadow_goes_straight_down_from_its_rib_while_the_probe_rocks(turn_deg):
    gain = sight("ribs-1", pose(turn_deg)).gain
    rows = [np.flatnonzero(gain[row] < 0.1) for row in (180, 210, 235)]
    assert all(np.array_equal(rows[0], row) for row in rows), "it keeps its columns"
    across_mm = (rows[0].mean() - 159.5) * 0.08
    expected = pose(turn_deg)[:3, :3].T @ rib_place(RIBS_MM[1][0], -8.4, pose(turn_deg))
    assert across_mm == pytest.approx(expected[0], abs=0.05)
    assert np.ptp(rows[0]) * 0.08 == pytest.approx(5.0, abs=0.6)
    assert gain[40].min() == 1, "nothing above the rib"


def test_a_rib_stays_in_the_tissue_and_its_shadow_moves_along_with_it():
    columns = [np.flatnonzero(sight("ribs-1", pose(0, (x, 0, 0))).gain[200] < 0.1).mean() for x in (0, 2.0)]
    assert (columns[1] - columns[0]) * 0.08 == pytest.approx(-2.0, abs=0.05)


def test_below_a_rib_the_picture_is_dark_and_its_surface_is_bright():
    seen = world("ribs-1").plain_at(pose(), 0, sight("ribs-1", pose()))
    free = world("ribs-1").plain_at(pose(), 0)
    shadow = sight("ribs-1", pose()).gain < 0.05
    assert np.array_equal(seen[:60, :60], free[:60, :60])
    assert seen[shadow & (np.arange(240)[:, None] > 150)].mean() < free[shadow].mean() / 3
    assert seen.max() > free.max()


def test_the_shadow_of_gas_is_grey_and_rings():
    rib, gas = (world("rigid").plain_at(pose(), 0, sight(name, pose())).astype(float) for name in ("ribs-1", "gas-1"))
    shadow = sight("ribs-1", pose()).gain < 0.05
    assert 20 + rib[shadow].mean() < gas[shadow].mean() < world("rigid").plain_at(pose(), 0)[shadow].mean()
    assert np.array_equal(gas[:60, :60], rib[:60, :60])


@pytest.mark.parametrize("share", [0.6, 0.9])
def test_a_face_shows_what_it_touches(share):
    gain = sight(f"contact-{share}", pose()).gain
    half_px = 0.68 * 160
    assert (gain[100] > 0.5).sum() == pytest.approx(160 - half_px + 2 * half_px * share, abs=2)
    assert np.array_equal(gain[0], gain[-1])


def test_a_face_that_peels_off_comes_back():
    seen = [(sight("peel-0.6", pose(), t).gain[100] > 0.5).sum() for t in (0.0, 1.5, 3.0, 6.0)]
    assert seen[0] == seen[3] > seen[1] > seen[2]
    assert seen[2] == (sight("contact-0.6", pose()).gain[100] > 0.5).sum()


def test_a_needle_goes_in_and_out():
    lengths = [(sight("needle", pose(), t).added > 1).sum() for t in (0.0, 1.5, 4.5)]
    assert lengths[2] < lengths[0] < lengths[1]


def test_strong_layers_are_brighter_than_other_tissue():
    bright = [np.quantile(np.hypot(*world(name).echoes_at(pose())), 0.99) for name in ("rigid", "layers")]
    assert bright[1] > 1.5 * bright[0]


def test_a_shadow_of_a_convex_probe_goes_along_the_beam():
    convex = world("convex")
    gain = sight("convex+ribs-1", pose()).gain
    edges = np.array([np.flatnonzero(gain[row] < 0.5)[0] for row in (170, 200, 230)])
    x_mm, y_mm = convex.geometry.x_mm[edges], convex.geometry.y_mm[[170, 200, 230], 0]
    angles = np.arctan2(x_mm, y_mm - convex.geometry.apex_mm)
    assert angles == pytest.approx(angles[0], abs=0.002)
    assert np.ptp(edges) > 1


def width(image, along):
    """Columns or rows over which the envelope loses half of its likeness to itself."""
    changes = image - image.mean()
    spread = np.apply_along_axis(lambda line: np.correlate(line, line, "full")[line.size - 1 :], along, changes)
    likeness = spread.mean(axis=1 - along)
    return float(np.interp(-0.5, -likeness / likeness[0], np.arange(likeness.size)))


def test_the_speckle_of_a_convex_probe_widens_with_depth_and_turns_with_the_beam():
    cells = {}
    for elevation_mm in range(0, 12, 2):
        image = np.hypot(*world("convex").echoes_at(pose(0, (0, 0, elevation_mm))))
        for name, window in {"near": np.s_[20:60, 120:200], "far": np.s_[180:235, 120:200]}.items():
            cells.setdefault(name, []).append(width(image[window], 1))
        for name, window in {"left": np.s_[150:220, 40:90], "right": np.s_[150:220, 230:280]}.items():
            part = image[window] - image[window].mean()
            cells.setdefault(name, []).append((part[1:, 1:] * part[:-1, :-1] - part[1:, :-1] * part[:-1, 1:]).mean())
    near, far, left, right = (np.mean(cells[name]) for name in ("near", "far", "left", "right"))
    geometry = world("convex").geometry
    radius_mm = geometry.y_mm[[40, 207], 0] - geometry.apex_mm
    assert far / near == pytest.approx(radius_mm[1] / radius_mm[0], rel=0.12)
    assert right < 0 < left, "cells lie along arcs about the apex"


def test_a_picture_of_a_convex_probe_moves_as_tissue_does():
    """Echoes are the tissue's, not the beam's: moved by whole pixels, the picture is the same."""
    before, after = (np.hypot(*world("convex").echoes_at(pose(0, (0, y, 0)))) for y in (0.0, 0.07 * 4))
    here, there = before[104:184, 150:170].ravel(), after[100:180, 150:170].ravel()
    assert np.corrcoef(here, there)[0, 1] > 0.98


def test_geometry_of_a_straight_face_is_plain():
    across, depth, spread = Geometry((320, 240), (0.08, 0.07)).beam(np.array(3.0), np.array(-8.4))
    assert (across, depth, spread) == (3.0, 0.0, 1.0)
