"""Recordings as streams of samples and as devices."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError, DeviceLost, RecordingError
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.drivers.recordings.nrrd import write_nrrd
from probewatch.drivers.recordings.pose_table import write_poses
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.registry import open_output, open_tracker, open_video
from probewatch.drivers.samples import Frame, Pose, PoseStatus
from tests.support.recordings import PERIOD_NS, SIZE_PX, START_NS, items, picture, plus_file, turn


@pytest.fixture
def session(tmp_path):
    path = tmp_path / "session.igs.mha"
    write_metaimage(path, items(), SIZE_PX)
    return path


def written(path, changed):
    write_metaimage(path, changed, SIZE_PX)
    return path


def poses_of(path, **options):
    return [sample for sample in open_recording(path, **options).samples() if isinstance(sample, Pose)]


def test_pose_and_frame_of_one_entry_share_its_stamp_pose_first(session):
    samples = list(open_recording(session).samples())
    assert [type(sample) for sample in samples] == [Pose, Frame] * 4
    assert [sample.stamp.t_ns for sample in samples] == [START_NS + index // 2 * PERIOD_NS for index in range(8)]
    assert [sample.sequence for sample in samples[::2]] == [100, 102, 104, 106]
    np.testing.assert_array_equal(samples[3].image, picture(1))


def test_pose_is_composed_over_the_reference(session):
    for index, pose in enumerate(poses_of(session)):
        expected = np.linalg.inv(turn(0.5, 0, 3)) @ turn(0.1 * index, 10.0 * index, 2)
        np.testing.assert_allclose(pose.matrix, expected, atol=1e-12)
        assert pose.status is PoseStatus.OK


def test_reference_tracker_leaves_the_reference_out(session):
    np.testing.assert_allclose(poses_of(session, reference="Tracker")[2].matrix, turn(0.2, 20, 2), atol=1e-12)


def test_recorded_pose_to_reference_is_preferred(tmp_path):
    direct = [replace(item, transforms={**item.transforms, "ProbeToReference": turn(1.0)}) for item in items()]
    np.testing.assert_allclose(poses_of(written(tmp_path / "a.mha", direct))[0].matrix, turn(1.0), atol=1e-12)


def test_without_reference_tool_the_tracker_frame_is_used(tmp_path):
    alone = [replace(item, transforms={"NeedleToTracker": turn(0.3)}) for item in items()]
    path = written(tmp_path / "a.mha", alone)
    np.testing.assert_allclose(poses_of(path, probe="Needle")[0].matrix, turn(0.3), atol=1e-12)


@pytest.mark.parametrize("name", ["ProbeToTracker", "ReferenceToTracker"])
def test_an_invalid_transform_is_a_missing_pose_with_its_reason(tmp_path, name):
    broken = items()
    broken[1] = replace(broken[1], transforms={**broken[1].transforms, name: None})
    poses = poses_of(written(tmp_path / "a.mha", broken))
    assert [pose.status for pose in poses] == [PoseStatus.OK, PoseStatus.MISSING, PoseStatus.OK, PoseStatus.OK]
    assert poses[1].matrix is None
    assert poses[1].reason == f"{name} is INVALID"


NO_POSE = {"identity": np.eye(4), "zeros": np.zeros((4, 4)), "zeros and 0 0 0 1": np.diag([0, 0, 0, 1.0])}


def table(path, items):
    """The poses as a CSV, with a film's times."""
    rows = (
        {"t_s": item.t_ns / 1e9, "status": "ok"}
        | {f"m{row}{column}": item.transforms["ProbeToTracker"][row, column] for row in range(3) for column in range(4)}
        for item in items
    )
    write_poses(path, rows)


SEQUENCES = (".igs.mha", ".igs.nrrd")
"""A table, which has poses of the probe alone, is the third."""


@pytest.mark.parametrize("what", NO_POSE)
@pytest.mark.parametrize(
    ("name", "suffix"),
    [
        *(("ProbeToTracker", suffix) for suffix in (*SEQUENCES, ".csv")),
        *(("ReferenceToTracker", suffix) for suffix in SEQUENCES),
    ],
)
def test_identity_and_zeros_are_no_pose_as_live(tmp_path, name, suffix, what):
    """Without a status 12 of 335 poses that were the identity had a healthy probe named for a bent marker body."""
    broken = items()
    broken[1] = replace(broken[1], transforms={**broken[1].transforms, name: NO_POSE[what]})
    path = tmp_path / f"a{suffix}"
    if suffix == ".csv":
        table(path, broken)
    else:
        (write_nrrd if suffix == ".igs.nrrd" else write_metaimage)(path, broken, SIZE_PX)
    poses = poses_of(path)
    assert [pose.status for pose in poses] == [PoseStatus.OK, PoseStatus.MISSING, PoseStatus.OK, PoseStatus.OK]
    assert poses[1].reason == f"{name} is not a measurement (identity or zeros)"


def test_quaternions_of_zeros_are_no_pose(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,1,2,3,1,0,0,0\n.1,0,0,0,1,0,0,0\n.2,0,0,0,0,0,0,0\n")
    assert [pose.status.value for pose in poses_of(path)] == ["ok", "missing", "missing"]


def test_a_reference_that_is_the_identity_throughout_is_the_tracker(tmp_path):
    here = [replace(item, transforms={**item.transforms, "ReferenceToTracker": np.eye(4)}) for item in items()]
    poses = poses_of(written(tmp_path / "a.mha", here))
    assert all(pose.status is PoseStatus.OK for pose in poses)
    np.testing.assert_allclose(poses[2].matrix, turn(0.2, 20, 2), atol=1e-12)


def test_a_probe_that_is_the_identity_throughout_has_no_pose(tmp_path):
    here = [replace(item, transforms={"ProbeToTracker": np.eye(4)}) for item in items()]
    assert {pose.status for pose in poses_of(written(tmp_path / "a.mha", here))} == {PoseStatus.MISSING}


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"probe": "Stylus"}, "neither StylusToReference nor StylusToTracker; its transforms: ProbeToTracker, Ref"),
        ({"probe": "Stylus", "reference": "Tracker"}, "session.igs.mha: has no StylusToTracker; its tr"),
        ({"probe": "Probe", "reference": "Probe"}, "takes ProbeToTracker as probe and as reference"),
        ({"probe": "Reference"}, "takes ReferenceToTracker as probe and as reference"),
        ({"witness": "Probe"}, "has ProbeToTracker as the probe or the reference already"),
        ({"witness": "Reference"}, "has ReferenceToTracker as the probe or the reference already"),
        ({"reference": "Table"}, "neither ProbeToTable nor ProbeToTracker with TableToTracker; its transforms: Pr"),
    ],
)
def test_absent_transforms_are_named_with_those_that_are_there(session, options, complaint):
    with pytest.raises(RecordingError, match=complaint):
        open_recording(session, **options)


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("TrackerToProbe", "TrackerToProbe is the other way round: write its inverse, from the tool to Tracker"),
        ("ReferenceToStylus", "ReferenceToStylus is the other way round: write its inverse"),
        ("ImageToReference", "has the calibration in it: record the pose of the tool, such as ProbeToTracker"),
        ("StylusToTracker", "Say which of them is on the ultrasound probe: --probe Stylus"),
    ],
)
def test_what_to_do_about_a_pose_of_another_name(tmp_path, name, remedy):
    """--probe Image was told of a pose that has the calibration in it, and --probe of one that no --probe names."""
    found = [replace(item, transforms={name: np.eye(4)}) for item in items()]
    with pytest.raises(RecordingError) as told:
        open_recording(written(tmp_path / "a.mha", found))
    assert remedy in told.value.remedy


def test_poses_from_a_second_recording(tmp_path, session):
    fast = [replace(item, t_ns=START_NS + index * 20_000_000, image=None) for index, item in enumerate(items(9))]
    write_metaimage(tmp_path / "poses.mha", fast, None)
    recording = open_recording(session, poses=tmp_path / "poses.mha")
    samples = list(recording.samples())
    stamps = [sample.stamp.t_ns for sample in samples]
    assert stamps == sorted(stamps)
    assert sum(isinstance(sample, Pose) for sample in samples) == 9
    assert recording.overlap_ns == (START_NS, START_NS + 8 * 20_000_000)


def test_invalid_pictures_are_left_out_and_counted(tmp_path):
    holed = items()
    holed[2] = replace(holed[2], image=None)
    recording = open_recording(written(tmp_path / "a.mha", holed))
    frames = [sample for sample in recording.samples() if isinstance(sample, Frame)]
    assert [frame.sequence for frame in frames] == [100, 102, 106]
    assert recording.left_out == {"picture marked invalid": 1}


def test_a_time_that_steps_back_is_left_out_and_counted(tmp_path):
    stepped = items(20)
    stepped[5] = replace(stepped[5], t_ns=START_NS)
    recording = open_recording(written(tmp_path / "a.mha", stepped))
    stamps = [sample.stamp.t_ns for sample in recording.frame_samples()]
    assert len(stamps) == 19
    assert all(np.diff(stamps) > 0)
    assert recording.left_out == {"picture time does not increase": 1}


def test_poses_of_their_own_that_step_back_are_left_out_and_counted(tmp_path, session):
    """Not those of the pictures' own entries, which count once."""
    poses = [replace(item, image=None) for item in items(40)]
    poses[3] = replace(poses[3], t_ns=poses[1].t_ns)
    write_metaimage(tmp_path / "poses.mha", poses, None)
    recording = open_recording(session, poses=tmp_path / "poses.mha")
    assert recording.poses_left_out == {"pose time does not increase": 1}
    assert recording.remarks == ["1 poses left out: pose time does not increase"]
    assert open_recording(tmp_path / "poses.mha").poses_left_out == {"pose time does not increase": 1}
    both = [replace(one, image=picture(n)) for n, one in enumerate(poses)]
    mixed = open_recording(written(tmp_path / "both.mha", both))
    assert (mixed.left_out, mixed.poses_left_out) == ({"picture time does not increase": 1}, {})


@pytest.mark.parametrize(
    ("key", "named"),
    [
        ("ProbeToTracker", "ProbeToTracker"),
        ("probetotrackertransform", "ProbeToTracker"),
        ("ProbeToReference", "ProbeToReference"),
        ("ProbeToTrackerMatrix", "ProbeToTracker"),
    ],
)
def test_a_matrix_whose_key_lacks_the_ending_is_told_with_what_to_write(tmp_path, key, named):
    path = written(tmp_path / "a.mha", [replace(item, transforms={"XToY": turn(0.3)}) for item in items()])
    header = re.sub(rb"Seq_Frame\d+_XToYTransformStatus = OK\n", b"", path.read_bytes())
    path.write_bytes(header.replace(b"_XToYTransform = ", f"_{key} = ".encode()))
    with pytest.raises(RecordingError) as told:
        open_recording(path)
    assert f"its transforms: none; sixteen numbers without the ending Transform: {key}" in told.value.what
    assert told.value.remedy == f"Call {key} {named}Transform in each frame, as PLUS does"


def test_a_clock_that_keeps_stepping_back_is_refused(tmp_path):
    path = written(tmp_path / "a.mha", items()[::-1])
    with pytest.raises(RecordingError, match="3 of 4 entries is not later"):
        open_recording(path)


def test_devices_from_one_recording_stay_in_step_on_the_host_clock(session):
    clock = HostClock(rate=20.0)
    url = f"replay:{session}?start_s=2"
    with open_video(url, clock) as video, open_tracker(url, clock) as tracker:
        for index in range(4):
            pose, frame = tracker.read(10.0), video.read(10.0)
            assert pose.stamp.t_ns == frame.stamp.t_ns == clock.origin_ns + 2_000_000_000 + index * PERIOD_NS
            assert clock.now_ns() >= frame.stamp.t_ns
        for device in (video, tracker):
            with pytest.raises(DeviceLost, match="the recording has ended"):
                device.read(1.0)


def test_nothing_within_the_timeout_is_none_and_loses_nothing(session):
    clock = HostClock(rate=20.0)
    with open_video(f"replay:{session}?start_s=3", clock) as video:
        assert video.read(0.5) is None
        assert video.read(10.0).sequence == 100


def test_what_fell_due_before_the_device_was_opened_is_skipped(session):
    clock = HostClock()
    past = HostClock(origin_ns=clock.origin_ns - 2 * PERIOD_NS - PERIOD_NS // 2)
    with open_video(f"replay:{session}?start_s=0", past) as video:
        assert video.read(1.0).sequence == 106


def test_urls_that_can_never_work_are_refused(session):
    clock = HostClock()
    for query in ("?speed=2", "?start_s=-1", "?start_s=soon", "?start_s=nan"):
        with pytest.raises(ConfigurationError):
            open_video(f"replay:{session}{query}", clock)
    with pytest.raises(ConfigurationError, match="not an alarm output"):
        open_output(f"replay:{session}", clock)
    with pytest.raises(RecordingError, match="cannot be read"):
        open_tracker("replay:/nowhere.igs.mha", clock)


def test_damage_on_the_way_loses_the_device(tmp_path):
    path = tmp_path / "a.mha"
    write_metaimage(path, items(20, (40, 30)), (40, 30))
    data = bytearray(path.read_bytes())
    data[-3000] ^= 0xFF
    path.write_bytes(data)
    clock = HostClock(rate=100.0)
    with open_video(f"replay:{path}", clock) as video, pytest.raises(DeviceLost, match="damaged"):
        list(iter(lambda: video.read(10.0), None))


def test_a_video_device_needs_pictures(tmp_path):
    write_metaimage(tmp_path / "poses.mha", [replace(item, image=None) for item in items()], None)
    with pytest.raises(RecordingError, match="holds no pictures"):
        open_video(f"replay:{tmp_path / 'poses.mha'}", HostClock())


def test_real_recording_with_its_own_poses():
    recording = open_recording(plus_file("fCal_Test_Validation_3NWires_fCal2.0.igs.mha"))
    samples = list(recording.samples())
    poses = [sample for sample in samples if isinstance(sample, Pose)]
    assert (recording.tool, recording.reference) == ("ProbeToTracker", "ReferenceToTracker")
    assert (len(poses), len(samples)) == (103, 206)
    assert {pose.status for pose in poses} == {PoseStatus.OK}
    travel_mm = np.ptp([pose.matrix[:3, 3] for pose in poses], axis=0)
    assert 5 < travel_mm.max() < 100


def test_real_recordings_of_video_and_tracker():
    video = plus_file("WaterTankBottomTranslationVideoBuffer.igs.mha")
    tracker: Path = plus_file("WaterTankBottomTranslationTrackerBuffer-trimmed.igs.mha")
    samples = list(open_recording(video, poses=tracker).samples())
    stamps = [sample.stamp.t_ns for sample in samples]
    assert len(samples) == 201 + 801
    assert stamps == sorted(stamps)
    with pytest.raises(RecordingError, match="its transforms: none"):
        open_recording(video)


def test_real_tracker_only_recording_names_its_tool():
    path = plus_file("TimestampFilteringTest.igs.mha")
    with pytest.raises(RecordingError, match="its transforms: IdentityToIdentity"):
        open_recording(path)
    poses = poses_of(path, probe="Identity", reference="Identity")
    assert len(poses) == 500
    assert (poses[0].sequence, poses[-1].sequence) == (5539, 7381)


@pytest.mark.parametrize(
    ("names", "options", "remedy"),
    [
        (("TransducerToTracker",), {}, "--probe Transducer;"),
        (("StylusToReference", "ReferenceToTracker"), {}, "--probe Stylus;"),
        (("NeedleToTracker", "CoilToTracker"), {}, "--probe Coil or --probe Needle;"),
        (("ProbeToTracker",), {"reference": "Table"}, "with --reference, or Tracker"),
        ((), {}, "replay and latency take poses of another file with --poses"),
    ],
)
def test_the_remedy_for_a_name_is_that_of_the_recording(tmp_path, names, options, remedy):
    named = [replace(item, transforms={name: turn(0.3) for name in names}) for item in items()]
    with pytest.raises(RecordingError) as told:
        open_recording(written(tmp_path / "a.mha", named), **options)
    assert remedy in told.value.remedy


@pytest.mark.parametrize(("per_s", "said"), [(1000, "80 s apart"), (1_000_000, "8e+04 s apart")])
def test_times_in_ms_or_microseconds_are_told(tmp_path, per_s, said):
    slow = [replace(item, t_ns=START_NS + index * 80_000_000 * per_s) for index, item in enumerate(items())]
    with pytest.raises(RecordingError, match="divide ms by 1000") as told:
        open_recording(written(tmp_path / "a.mha", slow))
    assert said in told.value.what


def test_a_recording_with_one_long_pause_is_read(tmp_path):
    paused = [replace(item, t_ns=item.t_ns + (index > 1) * 30_000_000_000) for index, item in enumerate(items())]
    assert len(open_recording(written(tmp_path / "a.mha", paused)).frame_order) == 4


def test_poses_by_another_clock_are_told_with_both_spans(tmp_path, session):
    later = [replace(item, t_ns=item.t_ns + 10**18, image=None) for item in items()]
    write_metaimage(tmp_path / "poses.mha", later, None)
    with pytest.raises(
        RecordingError, match=r"poses of 1000002588\.142 to .* s, the pictures are of 2588\.142 to "
    ) as told:
        open_recording(session, poses=tmp_path / "poses.mha")
    assert "one clock" in told.value.remedy


def test_a_time_since_1970_in_ms_is_told_as_ms(tmp_path):
    path = written(tmp_path / "a.mha", items())
    path.write_bytes(path.read_bytes().replace(b"Timestamp = 2588.141729000", b"Timestamp = 1700000000000"))
    with pytest.raises(RecordingError, match="Is it in ms"):
        open_recording(path)
