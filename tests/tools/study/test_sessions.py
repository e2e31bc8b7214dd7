"""Hands and sessions: as fast, as far and as shaky as they say, and the same for the same seed."""

import itertools

import cv2
import numpy as np
import pytest

from probewatch.appliance.core.path.steps import predicted_path
from probewatch.drivers.rigid import inverse, rigid
from probewatch.tools.study.hand import ALL, GESTURE_S, lifted, tremor
from probewatch.tools.study.hazard import Hazard
from probewatch.tools.study.place import erring_by_place
from probewatch.tools.study.samples import rendered
from probewatch.tools.study.session import SETTINGS, TISSUES, Session, picture_path

T_S = np.arange(0, 60, 1 / 30)


def session(name, tissue="still", seed=1):
    return Session(name, tissue, seed, 60.0)


def test_tremor_has_the_stated_size_on_every_axis():
    sizes = np.mean([tremor(np.arange(0, 200, 0.05), np.random.default_rng(seed)).std(axis=1) for seed in range(8)], 0)
    assert sizes == pytest.approx([0.5, 0.35, 0.25, 0.3, 0.3, 0.3], rel=0.05)


@pytest.mark.parametrize(("name", "speed_mm_s"), [("elevational-5", 5), ("elevational-10", 10), ("elevational-20", 20)])
def test_a_sweep_has_its_speed_and_stroke(name, speed_mm_s):
    way_mm = session(name).probe(T_S)[:, 2, 3]
    assert np.median(np.abs(way_mm[30:] - way_mm[:-30])) == pytest.approx(speed_mm_s, rel=0.15)
    assert 35 < np.ptp(way_mm) < 43


def test_a_fan_tilts_about_the_skin():
    poses = session("fan").probe(T_S)
    skin = np.array([0, -SETTINGS.height_px * SETTINGS.scale_mm_per_px[1] / 2, 0, 1])
    tilt_deg = np.rad2deg(np.arctan2(poses[:, 2, 1], poses[:, 1, 1]))
    assert np.ptp(tilt_deg) == pytest.approx(40, abs=3)
    assert np.all(np.std(poses @ skin, axis=0) < 1)


@pytest.mark.parametrize("name", ALL)
@pytest.mark.parametrize("tissue", TISSUES)
def test_motion_is_smooth_and_follows_from_the_seed(name, tissue):
    one = session(name, tissue).pictures(T_S)
    assert np.array_equal(one, session(name, tissue).pictures(T_S))
    assert not np.allclose(one, session(name, tissue, 2).pictures(T_S), atol=0.1)
    # A leap between two pictures would be a fault that nobody injected.
    assert np.linalg.norm(np.diff(one[:, :3, 3], axis=0), axis=1).max() < 2.5


def test_tissue_breathes_along_the_axis_and_no_breath_is_like_the_next():
    breath_mm = session("hold", "breathing").pictures(T_S)[:, :3, 3] - session("hold").pictures(T_S)[:, :3, 3]
    assert np.ptp(breath_mm[:, 0]) == np.ptp(breath_mm[:, 2]) == 0
    assert 3.5 < np.ptp(breath_mm[:, 1]) < 7
    slow = np.convolve(breath_mm[:, 1], np.ones(15) / 15, "same")
    ends = np.flatnonzero((slow[1:-1] < slow[:-2]) & (slow[1:-1] <= slow[2:]) & (slow[1:-1] < np.median(slow)))
    assert 8 <= ends.size <= 24


@pytest.mark.parametrize("name", ["still", "breathing", "rigid+breath-4-lateral"])
def test_rigid_tissue_is_seen_as_the_pose_says(name):
    assert set(session("hold", name).sights(T_S[:5])) == {None}
    assert np.array_equal(session("hold", "rigid").pictures(T_S), session("hold").pictures(T_S))


def test_breath_in_any_direction_is_the_breath_along_the_axis_turned():
    still, axial, aside = (session("hold", name) for name in ("rigid", "rigid+breath-4-axial", "breath-4-elevational"))
    along = axial.pictures(T_S)[:, 1, 3] - still.pictures(T_S)[:, 1, 3]
    assert aside.pictures(T_S)[:, 2, 3] - still.pictures(T_S)[:, 2, 3] == pytest.approx(along)
    assert np.array_equal(aside.pictures(T_S)[:, :2, 3], still.pictures(T_S)[:, :2, 3])


def test_soft_tissue_goes_along_with_the_press_of_the_hand():
    one = session("in-plane", "half-20")
    top = np.array([[0.0, 0.0], [-SETTINGS.height_px * SETTINGS.scale_mm_per_px[1] / 2, 9.5]])
    for k in (5, 30, 77):
        skin, deep = one.displaced(T_S[k], top)[1]
        press_mm = one.probe(T_S[k : k + 1])[0] @ (0, top[1, 0], 0, 1) - (0, top[1, 0], 0, 1)
        assert skin == pytest.approx(press_mm[1])
        assert deep == pytest.approx(press_mm[1] / 2, rel=0.02)


def test_skin_is_dragged_by_the_whole_way_since_the_start():
    one = session("in-plane", "drag-2")
    skin = np.array([[0.0], [-SETTINGS.height_px * SETTINGS.scale_mm_per_px[1] / 2]])
    held_mm = np.array([np.hypot(*one.displaced(t, skin)[[0, 2], 0]) for t in T_S[:240:3]])
    assert held_mm.max() == pytest.approx(2.0, abs=1e-3)
    assert held_mm[0] == 0
    assert one.displaced(5.0, skin) == pytest.approx(session("in-plane", "drag-2").displaced(5.0, skin))


def test_a_title_tells_one_softness_from_another():
    names = ("still", "rigid", "half-20", "half-30", "half-30+drag-2")
    assert len({Session("hold", name, 1, 2.0).title for name in names}) == len(names)


def test_only_a_mixed_session_leaves_the_skin():
    assert [name for name in ALL if lifted(name, T_S).any()] == ["mixed", "gesture-mixed"]
    assert not lifted("gesture-mixed", T_S[T_S < GESTURE_S + 38]).any()
    assert lifted("mixed", T_S).mean() == pytest.approx(4 / 60, abs=0.02)


def test_the_path_of_perfect_pictures_is_what_the_line_predicts_from_the_sensor():
    one = session("in-plane")
    t_s = T_S[:300]
    path, _ = picture_path(one.pictures(t_s))
    predicted = predicted_path(one.sensor(t_s, Hazard().body(one.reference, t_s)), one.reference)
    assert np.abs(np.diff(path) - np.diff(predicted[0] + 1j * predicted[1])).max() < 2e-3


def test_the_sensor_sees_the_probe_and_not_the_tissue():
    still, breathing = (session("hold", tissue) for tissue in TISSUES)
    body = np.broadcast_to(rigid(still.reference.rotation, still.reference.offset_mm), (T_S.size, 4, 4))
    poses = still.sensor(T_S, body)
    assert np.allclose(poses, breathing.sensor(T_S, body))
    assert np.allclose(inverse(still.world.tissue_to_tracker) @ poses @ inverse(body), still.probe(T_S))


def seen_later(one, from_s, to_s, place_mm):
    """Where in the picture at to_s the tissue is that was at this place at from_s, mm, by fixed-point iteration."""

    def at_rest(t_s, xy):
        pose = one.pictures(np.array([t_s]))[0]
        return pose[:3, :2] @ xy + pose[:3, 3, None] - one.displaced(t_s, xy), pose

    wanted, _ = at_rest(from_s, place_mm)
    found = place_mm
    for _ in range(20):
        here, pose = at_rest(to_s, found)
        found = found + (pose[:3, :3].T @ (wanted - here))[:2]
    return found


@pytest.mark.parametrize("name", ["half-20+drag-2", "layer-80+breath-12-lateral"])
def test_soft_tissue_in_a_picture_is_where_the_truth_says(name):
    """Independent of the line: matched in blocks between two pictures a tenth of a second apart."""
    one, t_s = session("in-plane", name), np.array([65, 68]) / 30
    frames = zip(one.pictures(t_s), one.sights(t_s), strict=True)
    before, after = (one.world.plain_at(pose, 0, sight).astype(np.float32) for pose, sight in frames)
    middle, scale = np.array([199.5, 149.5]), np.array([0.08, 0.07])
    for place_px in itertools.product((130, 270), (90, 160, 230)):
        place_mm = ((place_px - middle) * scale)[:, None]
        later_px = seen_later(one, *t_s, place_mm)[:, 0] / scale + middle
        columns, rows = (slice(place - 20, place + 21) for place in place_px)
        near = np.round(later_px).astype(int)
        around = after[near[1] - 26 : near[1] + 27, near[0] - 26 : near[0] + 27]
        likeness = cv2.matchTemplate(around, before[rows, columns], cv2.TM_CCOEFF_NORMED)
        found = cv2.minMaxLoc(likeness)[3]
        assert cv2.minMaxLoc(likeness)[1] > 0.6
        assert near + found - 6 == pytest.approx(later_px, abs=1.2)


def test_a_slow_scanner_is_seen_twice_and_a_processing_one_every_time():
    twice, each = (rendered(Session("hold", name, 1, 0.2), None) for name in ("slow", "persistence-0.5"))
    assert [np.array_equal(a, b) for a, b in itertools.pairwise(twice)] == [True, False, True, False, True]
    assert not any(np.array_equal(a, b) for a, b in itertools.pairwise(each))


def test_what_a_motion_can_show_is_that_of_its_picture_at_rest():
    assert session("fan", "half-20+drag-2").at_rest == session("fan")
    assert session("fan", "half-20+deep").at_rest == session("fan", "deep")


def test_a_deep_picture_begins_at_the_skin_too():
    one = session("fan", "deep")
    assert one.world.geometry.skin_mm == pytest.approx(-22.5)
    skin = np.array([0, -22.5, 0, 1])
    assert np.all(np.std(one.probe(T_S) @ skin, axis=0) < 1)


def test_a_tracker_errs_by_place_slowly_and_as_far_as_it_is_said():
    places = np.random.default_rng(3).uniform(-300, 300, (4000, 3))
    poses = rigid(np.broadcast_to(np.eye(3), (4000, 3, 3)), places)
    errors = np.array([erring_by_place(poses, 0.8, seed)[:, :3, 3] - places for seed in range(6)])
    assert errors.std() == pytest.approx(0.8, rel=0.1)
    near = rigid(poses[:, :3, :3], places + np.array([0, 0, 5.0]))
    moved = erring_by_place(near, 0.8, 1) - erring_by_place(poses, 0.8, 1)
    assert (moved[:, :3, 3] - (0, 0, 5.0)).std() < 0.6
    turned = inverse(poses) @ erring_by_place(poses, 0.8, 1)
    assert np.rad2deg(turned[:, 1, 0].std()) == pytest.approx(0.32, rel=0.2)
    assert erring_by_place(poses, 0.0, 1) is poses
