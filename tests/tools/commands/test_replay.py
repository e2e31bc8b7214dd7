"""`probewatch replay`: injection, timeline, JSON contract, and one clear line for every bad input."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from appliance.core.quality.report import Change, LineReport, report_json
from appliance.limits import Limits
from appliance.service.devices.source_thread import TrackerThread
from appliance.storage.calibration_file import write_calibration
from appliance.supervision.timeline import Judging, Timeline
from appliance.supervision.watchers.device_health import DeviceHealth, Timeouts
from appliance.supervision.watchers.devices import watch_devices
from appliance.types import Calibration, Check, Fault, State, Verdict, VerdictKind
from drivers.clock.host_clock import HostClock
from drivers.recordings.metaimage_writing import write_metaimage
from drivers.recordings.replay import open_recording
from drivers.rigid import rotation_from_vector
from drivers.samples import Frame, Pose, PoseStatus, Stamp
from drivers.twins.faults import Episode, Schedule
from tests.support.answers import answered
from tests.support.recordings import PERIOD_NS, START_NS, items, picture, plus_file, turn
from tools.shared.inject import inject

FRAME_PX = (48, 32)


@pytest.fixture
def session(tmp_path):
    path = tmp_path / "session.igs.mha"
    write_metaimage(path, items(40, FRAME_PX), FRAME_PX)
    return path


@pytest.fixture
def calibration(tmp_path):
    path = tmp_path / "probe.toml"
    reference = Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), np.zeros(3), FRAME_PX)
    write_calibration(path, reference, {})
    return path


def spoiled(path, *episodes):
    samples = open_recording(path).samples()
    return list(inject(samples, Schedule(episodes), START_NS))


def split(samples):
    frames = [sample for sample in samples if isinstance(sample, Frame)]
    return frames, [sample for sample in samples if isinstance(sample, Pose)]


@pytest.mark.parametrize(("fault", "expected"), [("flip-lateral", np.s_[:, ::-1]), ("flip-vertical", np.s_[::-1])])
def test_flips_act_from_their_time_on(session, fault, expected):
    frames, _ = split(spoiled(session, Episode(fault, 1.6)))
    np.testing.assert_array_equal(frames[19].image, picture(19, FRAME_PX))
    np.testing.assert_array_equal(frames[20].image, picture(20, FRAME_PX)[expected])


def test_freeze_repeats_pixels_under_fresh_stamps(session):
    frames, _ = split(spoiled(session, Episode("freeze-video", 0.8)))
    assert [frame.stamp.t_ns for frame in frames] == [START_NS + index * PERIOD_NS for index in range(40)]
    assert [frame.sequence for frame in frames] == [100 + 2 * index for index in range(40)]
    for index in (10, 25, 39):
        np.testing.assert_array_equal(frames[index].image, picture(9, FRAME_PX))


def test_freeze_from_the_start_repeats_the_first_picture(session):
    frames, _ = split(spoiled(session, Episode("freeze-video", 0.0)))
    np.testing.assert_array_equal(frames[39].image, picture(0, FRAME_PX))


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


def timeline_of(samples, verdict):
    timeline = Timeline(START_NS, START_NS, START_NS + 39 * PERIOD_NS)
    for sample in samples:
        timeline.step(sample, (verdict(sample),) if isinstance(sample, Frame) else ())
    timeline.finish()
    return timeline


def healthy(sample):
    return Verdict(sample.stamp.t_ns, VerdictKind.OK, (), verified_ns=sample.stamp.t_ns)


def polarity(sample):
    return Verdict(sample.stamp.t_ns, VerdictKind.FAULT, (), Fault.POLARITY, "picture is mirrored")


def live_checks(statuses: list[PoseStatus]) -> dict[str, VerdictKind]:
    """What the service's own thread and watchers say after these replies, 40 ms apart."""
    thread = TrackerThread("tracker", "ndi:/x", lambda *_: None, lambda _: None, HostClock())
    for index, status in enumerate(statuses):
        thread.note(reply(index, status), START_NS + index * PERIOD_NS)
    end_ns = START_NS + (len(statuses) - 1) * PERIOD_NS
    heard = {"heartbeat_ns": end_ns, "output_ns": end_ns, "frame_ns": end_ns}
    health = DeviceHealth(started_ns=START_NS, replies=thread.replies, **heard)
    return verdict_of(watch_devices(end_ns, health, Timeouts(), Limits()))


def reply(index: int, status: PoseStatus) -> Pose:
    matrix = np.eye(4) if status is PoseStatus.OK else None
    return Pose(Stamp(START_NS + index * PERIOD_NS, 0), index, matrix, 0.1, status)


def verdict_of(checks) -> dict[str, VerdictKind]:
    return {check.name: check.verdict for check in checks}


@pytest.mark.parametrize("status", PoseStatus)
@pytest.mark.parametrize("before", [PoseStatus.OK, PoseStatus.MISSING])
def test_replay_and_live_judge_every_kind_of_reply_alike(status, before):
    statuses = [before] * 5 + [status] * 90
    timeline = Timeline(START_NS, START_NS, START_NS + 94 * PERIOD_NS)
    for index, kind in enumerate(statuses):
        frame = Frame(Stamp(START_NS + index * PERIOD_NS, 0), index, picture(index, FRAME_PX))
        timeline.step(frame, ())
        timeline.step(reply(index, kind), ())
    timeline.finish()
    assert verdict_of(timeline.devices) == live_checks(statuses)
    failing = {
        PoseStatus.DISABLED: "tracker-lost",
        PoseStatus.STALE: "tracker-stale",
        PoseStatus.FAULT: "tracker-alert",
        PoseStatus.NOT_UNDERSTOOD: "pose-unusable",
    }
    hidden = status not in failing and status is not PoseStatus.OK
    expected = failing.get(status, "line-of-sight" if hidden else None)
    assert [check.fault for check in timeline.devices if check.value > check.limit] == ([expected] if expected else [])


def test_a_recording_is_judged_as_the_configuration_of_its_cart_says(session, tmp_path):
    """A tracker that is lost for half a second is a fault unless the cart is told to wait longer."""
    patient = Judging(timeouts=Timeouts(tracker_ns=5_000_000_000))
    samples = spoiled(session, Episode("lose-tracker", 0.8))
    for judging, lost in ((None, True), (patient, False)):
        timeline = Timeline(START_NS, START_NS, START_NS + 39 * PERIOD_NS, judging)
        for sample in samples:
            timeline.step(sample, (healthy(sample),) if isinstance(sample, Frame) else ())
        timeline.finish()
        assert (timeline.lasting_fault() is not None) is lost


def test_timeline_of_a_healthy_recording(session):
    timeline = timeline_of(spoiled(session), healthy)
    assert [change.state for change in timeline.changes][-1] is State.MONITORING
    assert State.WARNING not in {change.state for change in timeline.changes}
    assert timeline.changes[-1].t_s < 0.3
    assert timeline.lasting_fault() is None


def test_timeline_of_a_calibration_fault_goes_up_in_order(session):
    timeline = timeline_of(spoiled(session), polarity)
    states = [change.state for change in timeline.changes]
    assert states[-2:] == [State.WARNING, State.HALT]
    warned, halted = (change.t_s for change in timeline.changes[-2:])
    assert halted - warned == pytest.approx(0.3, abs=0.051)
    assert "mirrored" in timeline.changes[-1].reason


def test_the_name_of_a_report_behind_json_is_refused_with_what_to_type(session, calibration, tmp_path):
    """`--json FILE` wrote a file in earlier versions: the error says so, and the recording is not judged."""
    report = tmp_path / "report.json"
    report.write_text("old")
    code, out, err = run(session, "--calibration", calibration, "--json", report)
    assert (code, out, report.read_text()) == (2, "", "old")
    assert f"--json > {report}" in err.replace("\n", "")


@pytest.mark.parametrize(("option", "named"), [("--html", "session"), ("--html", "calibration"), ("--pdf", "page")])
def test_a_report_writes_over_nothing_that_it_is_made_of(session, calibration, tmp_path, option, named):
    place = {"session": session, "calibration": calibration, "page": tmp_path / "page.html"}[named]
    before = session.read_bytes(), calibration.read_bytes()
    html = () if option == "--html" else ("--html", tmp_path / "page.html")
    code, _, err = run(session, "--calibration", calibration, *html, option, place)
    assert code == 78
    assert "would be written over" in err
    assert (session.read_bytes(), calibration.read_bytes()) == before


@pytest.mark.parametrize("number", [1, 2])
def test_json_is_all_of_standard_output(session, calibration, number):
    """The text is on standard error."""
    recordings = [session, *(shutil.copy(session, session.with_name(f"{n}.igs.mha")) for n in range(1, number))]
    code, out, err = run(*recordings, "--calibration", calibration, "--json")
    assert (code, json.loads(out)["version"]) == (0, 1)
    assert "NOT_VERIFIED" in err


@pytest.mark.parametrize(
    ("fault", "named"),
    [("lose-video", "video-lost"), ("lose-tracker", "tracker-lost"), ("stale-tracker", "tracker-stale")],
)
def test_timeline_of_a_lost_device(session, fault, named):
    timeline = timeline_of(spoiled(session, Episode(fault, 0.8)), healthy)
    warned = next(change for change in timeline.changes if change.state is State.WARNING)
    assert warned.fault == named
    assert warned.t_s == pytest.approx(0.72 + 0.5, abs=0.11)
    assert timeline.changes[-1].state is State.DEVICE_LOST
    assert timeline.lasting_fault().fault == named


def line_report(**changes):
    covariance = np.diag([0.01, 0.02, 0.03, 0.1, 0.2, 1.0, 2.0, 3.0]) ** 2
    estimate = Calibration(
        rotation_from_vector(np.array([0.1, 0.2, 1.5])),
        (-1, 1),
        np.array([0.08, 0.07]),
        np.array([1.0, 2.0, 3.0]),
        FRAME_PX,
        covariance,
        (True,) * 7 + (False,),
    )
    check = Check("scale lateral", Fault.SCALE, 2.0, 0.4, "%", 5.0, VerdictKind.OK)
    report = LineReport(
        frames=10,
        poses=11,
        paired=8,
        unpaired={"no pose after the frame": 2},
        latency=Check("latency", Fault.LATENCY, -20.0, 30.0, "ms", 60.0, VerdictKind.OK),
        estimate=estimate,
        motions=7,
        checks=(check, replace(check, name="scale axial", value=np.nan, verdict=VerdictKind.NOT_VERIFIED)),
        verdict=Verdict(0, VerdictKind.FAULT, (), Fault.POLARITY, "mirrored"),
    )
    return replace(report, **changes)


def test_json_is_the_documented_contract():
    data = report_json(line_report(), [Change(0.5, State.DEVICE_LOST, Fault.VIDEO_LOST, "no picture")])
    assert data == {
        "version": 1,
        "frames": 10,
        "poses": 11,
        "paired": 8,
        "unpaired": {"no pose after the frame": 2},
        "unusable_poses": {},
        "latency": {"value_ms": -20.0, "sigma_ms": 30.0, "verdict": "OK"},
        "tissue": None,
        "calibration": {
            "rotation_vector_rad": pytest.approx([0.1, 0.2, 1.5]),
            "polarity": [-1, 1],
            "scale_mm_per_px": [0.08, 0.07],
            "offset_mm": [1.0, 2.0, 3.0],
            "sigma": {
                "rotation_vector_rad": pytest.approx([0.01, 0.02, 0.03]),
                "scale_mm_per_px": pytest.approx([0.008, 0.014]),
                "offset_mm": [pytest.approx(1.0), pytest.approx(2.0), None],
            },
            "observed": {
                "rotation_vector_rad": [True, True, True],
                "scale_mm_per_px": [True, True],
                "offset_mm": [True, True, False],
            },
            "singular_values": pytest.approx(
                sorted([*(np.deg2rad(1) / s for s in (0.01, 0.02, 0.03)), 0.1, 0.05, 1, 0.5, 1 / 3])[::-1]
            ),
            "motions": 7,
        },
        "second_opinion": None,
        "point": None,
        "checks": [
            {
                "name": "scale lateral",
                "fault": "scale",
                "value": 2.0,
                "sigma": 0.4,
                "unit": "%",
                "limit": 5.0,
                "ratio": 0.4,
                "verdict": "OK",
                "shown_age_s": None,
            },
            {
                "name": "scale axial",
                "fault": "scale",
                "value": None,
                "sigma": 0.4,
                "unit": "%",
                "limit": 5.0,
                "ratio": None,
                "verdict": "NOT_VERIFIED",
                "shown_age_s": None,
            },
        ],
        "verdict": "FAULT",
        "fault": "polarity",
        "proposal": None,
        "limits": {"profile": "coarse", "beside": {}},
        "rivals": [],
        "timeline": [{"t_s": 0.5, "state": "device lost", "reason": "no picture"}],
    }
    json.dumps(data, allow_nan=False)


def test_json_of_an_empty_report_has_every_key():
    empty = line_report(latency=None, estimate=None, checks=(), unpaired={})
    data = report_json(empty, [])
    assert data["latency"] == {"value_ms": None, "sigma_ms": None, "verdict": "NOT_VERIFIED"}
    assert data["calibration"]["rotation_vector_rad"] is None
    assert data["calibration"]["sigma"]["offset_mm"] == [None, None, None]
    assert data["calibration"]["observed"]["scale_mm_per_px"] == [False, False]
    assert set(data) == set(report_json(line_report(), []))


def test_the_document_names_every_key():
    text = (Path(__file__).parents[3] / "docs" / "replay-report.md").read_text()
    data = report_json(line_report(), [Change(0.0, State.MONITORING, None, "")])
    for key in (*data, *data["calibration"]):
        assert f"`{key}" in text or f"`calibration.{key}`" in text, key


def run(*arguments):
    answer = answered("replay", *arguments)
    return answer.returncode, answer.stdout, answer.stderr


def cut(path):
    path.write_bytes(path.read_bytes()[:-100])


def shorten_header(path):
    path.write_bytes(path.read_bytes()[:600])


def corrupt(path):
    data = bytearray(path.read_bytes())
    data[-20_000] ^= 0xFF
    path.write_bytes(data)


def colour(path):
    path.write_bytes(path.read_bytes().replace(b"MET_UCHAR", b"MET_FLOAT"))


def rename_transforms(path):
    path.write_bytes(path.read_bytes().replace(b"_ProbeToTracker", b"_NeedleToTracker"))


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (cut, "CompressedDataSize promises"),
        (shorten_header, "the header ends before ElementDataFile"),
        (corrupt, "the compressed pictures are damaged"),
        (colour, "ElementType is 'MET_FLOAT', not MET_UCHAR"),
        (rename_transforms, "its transforms: NeedleToTracker, ReferenceToTracker"),
        (Path.unlink, "cannot be read: No such file"),
    ],
)
def test_a_bad_recording_is_one_line_and_65(session, calibration, damage, complaint):
    damage(session)
    code, out, err = run(session, "--calibration", calibration)
    assert (code, out) == (65, "")
    assert err.count("\n") == 1
    assert err.startswith(f"probewatch: {session}: ")
    assert complaint in err


def no_rotation(path):
    path.write_text(path.read_text().replace("[1.0, 0.0, 0.0]", "[1.1, 0.0, 0.0]"))


def misspelt(path):
    path.write_text(path.read_text().replace("offset_mm", "ofset_mm"))


def other_size(path):
    path.write_text(path.read_text().replace("[48, 32]", "[64, 32]"))


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (no_rotation, "rotation is not a rotation matrix"),
        (misspelt, "ofset_mm"),
        (other_size, "image_size_px is (64, 32), the pictures are (48, 32)"),
        (Path.unlink, "cannot be read: No such file"),
    ],
)
def test_a_bad_calibration_is_one_line_and_78(session, calibration, damage, complaint):
    damage(calibration)
    code, out, err = run(session, "--calibration", calibration)
    assert (code, out) == (78, "")
    assert err.count("\n") == 1
    assert err.startswith(f"probewatch: {calibration}: ")
    assert complaint in err


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("TransformStatus = OK", "TransformStatus = VALID", "ProbeToTracker is VALID, a word that is not known here"),
        (
            "Transform = ",
            "Transform = 0.2 0 0 0 0 0.2 0 0 0 0 0.2 0 0 0 0 1\nX = ",
            "is not a rotation and a translation",
        ),
    ],
)
def test_what_is_no_pose_is_no_fault_of_the_tracker_and_its_reason_is_told(
    session, calibration, tmp_path, old, new, said
):
    session.write_bytes(session.read_bytes().replace(f"ProbeToTracker{old}".encode(), f"ProbeToTracker{new}".encode()))
    code, out, err = run(session, "--calibration", calibration, "--json")
    data = json.loads(out)
    assert (code, data["verdict"], data["fault"], list(data["unusable_poses"].values())) == (
        0,
        "NOT_VERIFIED",
        None,
        [40],
    )
    assert said in next(iter(data["unusable_poses"]))
    assert said in err.splitlines()[-1]
    assert "40 poses cannot be used: " in err
    assert "fault" not in err.lower()


@pytest.mark.parametrize("fault", ["melt", "depth@soon", "depth@-1", "depth@nan", "depth@"])
def test_an_unknown_fault_is_a_usage_error(session, calibration, fault):
    code, _, err = run(session, "--calibration", calibration, "--inject", fault)
    assert code == 2
    assert "Traceback" not in err


def test_a_sentence_ends_once_where_a_name_is_guessed() -> None:
    told = answered("replay", "a.igs.mha", "--inject", "flip").stderr
    assert "Did you mean 'flip-lateral' or 'flip-vertical'? Use bend-marker" in told


def test_a_recording_that_is_not_there_is_told_before_a_missing_option(tmp_path) -> None:
    for name in ("box.mcap", "box.mc.html"):
        (tmp_path / name).write_bytes(b"")
    answer = answered("replay", tmp_path / "box.mcp")
    assert (answer.returncode, f"Did you mean '{tmp_path}/box.mcap'?" in answer.stderr) == (65, True), answer.stderr
    assert "--calibration" not in answer.stderr


def test_a_fault_that_begins_after_the_recording_is_a_usage_error(session, calibration):
    """Nothing would be spoiled, and the report would say so all the same."""
    code, out, err = run(session, "--calibration", calibration, "--inject", "depth@1", "--inject", "flip-lateral@30")
    assert (code, out) == (2, "")
    assert "flip-lateral@30 begins after the recording, which ends at 3.1 s" in err


@pytest.mark.parametrize(
    ("statuses", "said"),
    [
        (["INVALID"] * 40, "no picture has a pose: ProbeToTracker is INVALID"),
        (["INVALID"] * 30 + ["OK"] * 10, "only 10 of 40 pictures have a pose: ProbeToTracker is INVALID"),
    ],
)
def test_where_most_pictures_have_no_pose_the_verdict_says_why(tmp_path, calibration, statuses, said):
    poses = [turn(0.1, 10.0 * index) if status == "OK" else None for index, status in enumerate(statuses)]
    kept = [
        replace(item, transforms={"ProbeToTracker": pose})
        for item, pose in zip(items(40, FRAME_PX), poses, strict=True)
    ]
    write_metaimage(tmp_path / "lost.igs.mha", kept, FRAME_PX)
    code, out, _ = run(tmp_path / "lost.igs.mha", "--calibration", calibration)
    assert code == 0
    assert f"verdict: NOT_VERIFIED  {said}" in out


def test_poses_without_pictures_are_told_as_that(tmp_path, calibration):
    """And not as a calibration without a size."""
    write_metaimage(tmp_path / "poses.mha", [replace(item, image=None) for item in items(9)], None)
    calibration.write_text("<PlusConfiguration/>")
    code, _, err = run(tmp_path / "poses.mha", "--calibration", calibration)
    assert code == 65
    assert "holds no pictures. Give those, and this with --poses" in err


def test_the_console_script_ends_bad_input_without_traceback(session, calibration):
    cut(session)
    script = Path(sys.executable).with_name("probewatch")
    arguments = [script, "replay", session, "--calibration", calibration]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 65
    assert done.stderr.count("\n") == 1
    assert "copy it again" in done.stderr


def test_a_report_is_made_and_written(session, calibration, tmp_path):
    code, out, err = run(session, "--calibration", calibration, "--json")
    data = json.loads(out)
    assert code == 0
    assert (data["version"], data["frames"], data["poses"]) == (1, 40, 40)
    assert data["paired"] + sum(data["unpaired"].values()) == 40
    assert f"verdict: {data['verdict']}" in err
    assert data["timeline"][0]["t_s"] == 0.0


@pytest.mark.parametrize(
    ("fault", "named"),
    [("lose-video", "video-lost"), ("lose-tracker", "tracker-lost"), ("stale-tracker", "tracker-stale")],
)
def test_an_injected_device_fault_names_the_verdict(session, calibration, tmp_path, fault, named):
    code, out, _ = run(session, "--calibration", calibration, "--inject", fault, "--json")
    data = json.loads(out)
    assert (code, data["verdict"], data["fault"]) == (0, "FAULT", named)


def test_pictures_left_out_count_as_unpaired(calibration, tmp_path):
    holed = items(40, FRAME_PX)
    holed[7] = replace(holed[7], image=None)
    path = tmp_path / "holed.mha"
    write_metaimage(path, holed, FRAME_PX)
    _, out, _ = run(path, "--calibration", calibration, "--json")
    data = json.loads(out)
    assert data["frames"] == 40
    assert data["unpaired"]["picture marked invalid"] == 1


def test_a_tracker_only_recording_is_not_verified(calibration, tmp_path):
    path = tmp_path / "poses.mha"
    write_metaimage(path, [replace(item, image=None) for item in items(20)], None)
    code, out, _ = run(path, "--calibration", calibration, "--json")
    data = json.loads(out)
    assert (code, data["frames"], data["poses"], data["verdict"]) == (0, 0, 20, "NOT_VERIFIED")
    said = run(path, "--calibration", calibration)[1].splitlines()[-1]
    assert said.endswith("there are no pictures, without which motion shows nothing"), "it asked for more motion"


@pytest.mark.parametrize(
    ("fault", "verdicts", "named"),
    [
        (None, {"OK", "NOT_VERIFIED"}, None),
        ("flip-lateral", {"FAULT"}, "polarity"),
        ("flip-vertical", {"FAULT"}, "polarity"),
        ("freeze-video", {"FAULT"}, "frozen-video"),
    ],
)
@pytest.mark.thorough
def test_the_real_nwire_recording(tmp_path, fault, verdicts, named):
    recording = plus_file("fCal_Test_Validation_3NWires_fCal2.0.igs.mha")
    device_set = plus_file("PlusDeviceSet_fCal_Sim_VolumeReconstruction.xml")
    injection = [] if fault is None else ["--inject", fault]
    _, out, _ = run(recording, "--calibration", device_set, "--json", *injection)
    data = json.loads(out)
    assert data["frames"] == data["poses"] == 103
    assert data["verdict"] in verdicts
    assert data["fault"] == named
    if fault is None:
        assert data["latency"]["value_ms"] == pytest.approx(20, abs=30)
