"""Faults that are injected into a recording."""

import numpy as np
import pytest

from probewatch.drivers.samples import Frame, Pose, PoseStatus
from probewatch.drivers.twins.faults import Episode
from tests.support.recordings import PERIOD_NS, REPLAYED_PX, START_NS, picture
from tests.tools.commands.test_replay import spoiled


def split(samples):
    frames = [sample for sample in samples if isinstance(sample, Frame)]
    return frames, [sample for sample in samples if isinstance(sample, Pose)]


@pytest.mark.parametrize(("fault", "expected"), [("flip-lateral", np.s_[:, ::-1]), ("flip-vertical", np.s_[::-1])])
def test_flips_act_from_their_time_on(session, fault, expected):
    frames, _ = split(spoiled(session, Episode(fault, 1.6)))
    np.testing.assert_array_equal(frames[19].image, picture(19, REPLAYED_PX))
    np.testing.assert_array_equal(frames[20].image, picture(20, REPLAYED_PX)[expected])


def test_freeze_repeats_pixels_under_fresh_stamps(session):
    frames, _ = split(spoiled(session, Episode("freeze-video", 0.8)))
    assert [frame.stamp.t_ns for frame in frames] == [START_NS + index * PERIOD_NS for index in range(40)]
    assert [frame.sequence for frame in frames] == [100 + 2 * index for index in range(40)]
    for index in (10, 25, 39):
        np.testing.assert_array_equal(frames[index].image, picture(9, REPLAYED_PX))


def test_freeze_from_the_start_repeats_the_first_picture(session):
    frames, _ = split(spoiled(session, Episode("freeze-video", 0.0)))
    np.testing.assert_array_equal(frames[39].image, picture(0, REPLAYED_PX))


def test_latency_stamps_each_pose_late_and_keeps_time_order(session):
    clean = {pose.sequence: pose for pose in split(spoiled(session))[1]}
    samples = spoiled(session, Episode("latency", 0.0))
    frames, poses = split(samples)
    assert (len(frames), len(poses)) == (40, 40)
    stamps = [sample.stamp.t_ns for sample in samples]
    assert stamps == sorted(stamps)
    for pose in poses:
        assert pose.stamp.t_ns == clean[pose.sequence].stamp.t_ns + 100_000_000
        np.testing.assert_array_equal(pose.matrix, clean[pose.sequence].matrix)


def test_latency_in_mid_recording_leaves_no_gap(session):
    _, poses = split(spoiled(session, Episode("latency", 1.6)))
    stamps = np.array([pose.stamp.t_ns for pose in poses])
    assert np.diff(stamps).max() <= 100_000_000
    assert np.diff(stamps).min() > 0
    assert stamps[-1] == START_NS + 39 * PERIOD_NS + 100_000_000


def test_marker_faults_change_the_pose_on_the_sensor_side(session):
    clean, bent, slid = (
        split(spoiled(session, *episodes))[1]
        for episodes in ([], [Episode("bend-marker", 0)], [Episode("slide-marker", 0)])
    )
    for before, after in zip(clean, bent, strict=True):
        change = np.linalg.inv(before.matrix) @ after.matrix
        assert np.degrees(np.arccos((np.trace(change[:3, :3]) - 1) / 2)) == pytest.approx(5.0)
        np.testing.assert_allclose(change[:3, 3], 0, atol=1e-9)
    for before, after in zip(clean, slid, strict=True):
        change = np.linalg.inv(before.matrix) @ after.matrix
        np.testing.assert_allclose(change[:3, :3], np.eye(3), atol=1e-9)
        assert np.linalg.norm(change[:3, 3]) == pytest.approx(10.0, abs=0.1)


def test_lost_and_stale_devices(session):
    frames, poses = split(spoiled(session, Episode("lose-video", 0.8)))
    assert (len(frames), len(poses)) == (10, 40)
    frames, poses = split(spoiled(session, Episode("lose-tracker", 0.8)))
    assert (len(frames), len(poses)) == (40, 10)
    _, poses = split(spoiled(session, Episode("stale-tracker", 0.8)))
    assert {pose.status for pose in poses[10:]} == {PoseStatus.STALE}
    assert {pose.sequence for pose in poses[9:]} == {118}
