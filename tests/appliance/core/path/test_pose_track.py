"""Poses between readings: interpolated, bracketed, forgotten."""

import numpy as np
import pytest

from probewatch.appliance.core.path.pose_track import PoseTrack
from probewatch.drivers.rigid import rigid, rotation_from_vector
from probewatch.drivers.samples import Matrix4
from tests.support.motions import planar_path
from tests.support.windows import ORIGIN_NS


def track(times_s, poses) -> PoseTrack:
    found = PoseTrack(10_000_000_000)
    for t, pose in zip(times_s, poses, strict=True):
        found.add(ORIGIN_NS + round(t * 1e9), pose)
    return found


def hand(t_s) -> Matrix4:
    """(n, 4, 4) of the press and the rock of the gesture: 3 mm in .65 s, 8° in 1.4 s."""
    press_mm, rock_rad = 3 * np.sin(2 * np.pi * t_s / 0.65), np.deg2rad(8) * np.sin(2 * np.pi * t_s / 1.4)
    return rigid(rotation_from_vector(rock_rad[:, None] * [0.6, 0, 0.8]), press_mm[:, None] * [0, 1.0, 0])


@pytest.mark.parametrize(("rate_hz", "off_mm"), [(60, 0.0003), (40, 0.001), (20, 0.007)])
def test_poses_between_two_readings_lie_on_the_way_of_a_quick_hand(rate_hz: int, off_mm: float) -> None:
    """A straight line from one to the next would lie .0102, .023 and .09 mm inside it: .3, .8 and 3 % of the press."""
    times, asked = np.arange(0, 2, 1 / rate_hz), np.arange(0.2, 1.7, 0.0031)
    found, known = track(times, hand(times)).at(asked, ORIGIN_NS)
    assert known.all()
    wanted = hand(asked)
    np.testing.assert_allclose(found[:, :3, 3], wanted[:, :3, 3], atol=off_mm)
    np.testing.assert_allclose(found[:, :3, :3], wanted[:, :3, :3], atol=2e-4)


def test_poses_between_readings_without_near_neighbours_lie_on_the_straight_line() -> None:
    """At the ends, and beside a gap in which four readings were lost, nobody knows how the way bends."""
    times = np.array([0.0, 0.1, 0.2, 0.65, 0.75, 0.85])
    places = np.array([0.0, 1.0, 0.0, 5.0, 6.0, 5.0])
    poses = rigid(np.broadcast_to(np.eye(3), (6, 3, 3)), places[:, None] * [1.0, 0, 0])
    asked = np.array([0.05, 0.15, 0.7, 0.8])
    found, _ = track(times, poses).at(asked, ORIGIN_NS)
    straight = np.interp(asked, times, places)
    bent = found[:, 0, 3] - straight
    assert bent[[0, 3]] == pytest.approx([1 / 8, 1 / 8]), (
        "one slope is that of the straight line, one of the neighbours"
    )
    assert bent[[1, 2]] == pytest.approx([1 / 8, 1 / 8])


def test_an_outlier_or_a_slip_bends_no_way_beside_it() -> None:
    """3 mm at 60 Hz are 10 times the acceleration of a hand."""
    times, steps = np.arange(10) / 60, np.arange(10)
    for places in (np.where(steps == 4, 3.0, 0.0), np.where(steps < 4, 0.0, 3.0)):
        poses = rigid(np.broadcast_to(np.eye(3), (10, 3, 3)), places[:, None] * [0, 1.0, 0])
        asked = np.arange(0.02, 0.14, 0.0011)
        found, _ = track(times, poses).at(asked, ORIGIN_NS)
        np.testing.assert_allclose(found[:, 1, 3], np.interp(asked, times, places), atol=1e-6)


def test_times_that_no_two_readings_bracket_are_said_so() -> None:
    times = np.array([0.0, 0.1, 0.2, 0.9, 1.0])
    found = track(times, planar_path(times))
    _, known = found.at(np.array([-0.01, 0.15, 0.5, 0.95, 1.01]), ORIGIN_NS)
    assert known.tolist() == [False, True, False, True, False], "0.5 s lies in a gap of 0.7 s"
    _, known = track([0.0], planar_path(np.zeros(1))).at(np.array([0.0]), ORIGIN_NS)
    assert known.tolist() == [False]


def test_old_readings_are_forgotten_and_those_of_the_future_can_be() -> None:
    poses = PoseTrack(1_000_000_000)
    for t_ns in (90, 100, 2_000_000_000):
        poses.add(t_ns, np.eye(4))
    assert len(poses.arrays(0)[0]) == 1
    poses.add(2_000_000_100, np.eye(4))
    poses.forget(2_000_000_050)
    np.testing.assert_allclose(poses.arrays(0)[0], [2.0])
    poses.clear()
    assert len(poses.arrays(0)[0]) == 0


def test_quaternions_keep_their_sign_through_half_a_turn() -> None:
    angles = np.linspace(2.9, 3.4, 20)
    poses = rigid(rotation_from_vector(angles[:, None] * [0, 0, 1.0]), np.zeros((20, 3)))
    turns = track(np.arange(20) / 30, poses).arrays(ORIGIN_NS)[2]
    assert np.all(np.einsum("ni,ni->n", turns[1:], turns[:-1]) > 0.99)
