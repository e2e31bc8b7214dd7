"""`probewatch replay`: injection, timeline, JSON contract, and one clear line for every bad input."""

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.limits import Limits
from probewatch.appliance.service.devices.source_thread import TrackerThread
from probewatch.appliance.supervision.device_health import DeviceHealth, Timeouts
from probewatch.appliance.supervision.device_watchers import watch_devices
from probewatch.appliance.supervision.timeline import Judging, Timeline
from probewatch.appliance.types import Calibration, Fault, State, Verdict, VerdictKind
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.recordings.metaimage_writing import write_metaimage
from probewatch.drivers.recordings.nrrd import write_nrrd
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp
from probewatch.drivers.twins.faults import Episode, Schedule
from probewatch.tools.shared.inject import inject
from tests.drivers.recordings.test_film import film
from tests.support.answers import answered
from tests.support.black_boxes import record
from tests.support.recordings import PERIOD_NS, REPLAYED_PX, START_NS, items, picture, plus_file


def spoiled(path, *episodes):
    samples = open_recording(path).samples()
    return list(inject(samples, Schedule(episodes), START_NS))


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
        frame = Frame(Stamp(START_NS + index * PERIOD_NS, 0), index, picture(index, REPLAYED_PX))
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


def run(*arguments):
    answer = answered("replay", *arguments)
    return answer.returncode, answer.stdout, answer.stderr


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("TransformStatus = OK", "TransformStatus = VALID", "ProbeToTracker is VALID, a word that is not known here"),
        (
            "Transform = .*",
            "Transform = 0.2 0 0 0 0 0.2 0 0 0 0 0.2 0 0 0 0 1",
            "is not a rotation and a translation",
        ),
    ],
)
def test_what_is_no_pose_is_no_fault_of_the_tracker_and_its_reason_is_told(
    session, calibration, tmp_path, old, new, said
):
    data = re.sub(f"ProbeToTracker{old}".encode(), f"ProbeToTracker{new}".encode(), session.read_bytes())
    session.write_bytes(data)
    code, out, err = run(session, "--calibration", calibration, "--json")
    data = json.loads(out)
    assert (code, data["verdict"], data["fault"], list(data["unusable_poses"].values())) == (
        65,
        "NOT_VERIFIED",
        None,
        [40],
    )
    assert said in next(iter(data["unusable_poses"]))
    assert said in err.splitlines()[-1]
    assert "40 poses cannot be used: " in err
    assert "fault" not in err.lower()


@pytest.mark.parametrize("suffix", [".igs.mha", ".igs.nrrd"])
def test_pictures_that_are_turned_and_fields_that_are_not_read_have_a_line_each(calibration, tmp_path, suffix):
    path, write = tmp_path / f"scan{suffix}", write_metaimage if suffix == ".igs.mha" else write_nrrd
    write(path, items(40, REPLAYED_PX), REPLAYED_PX, orientation="UNA")
    assert "not read" not in run(path, "--calibration", calibration)[1]
    frame = b"Seq_Frame0003_ProbeToTracker"
    more = b"\nAcquisitionDate=2026-01-02\n%sTransformError=0.5\n%sDate=010214\nSeq_Frame0003_StylusToTrackerTransform"
    lines = more % (frame, frame) + b"=1\nSeq_Frame0003_StylusToTrackerTransformStatus=OK\n" + frame
    if suffix == ".igs.nrrd":
        lines = lines.replace(b"=", b":=")
    path.write_bytes(path.read_bytes().replace(b"\n" + frame, lines, 1))
    out = run(path, "--calibration", calibration)[1].splitlines()
    assert out.count("  pictures turned from UN to MF, by UltrasoundImageOrientation") == 1
    (unread,) = (line for line in out if "not read of what the file says: " in line)
    named = ["AcquisitionDate", "ProbeToTrackerTransformError", "ProbeToTrackerDate", "StylusToTrackerTransform"]
    assert unread.partition(": ")[2].split(", ") == named


def test_a_film_that_is_taken_as_mf_says_so_unless_its_orientation_is_named(tmp_path, calibration):
    table = tmp_path / "poses.csv"
    rows = [f"{t / 10},{t},0,0,1,0,0,0" for t in range(10)]
    table.write_text("\n".join(["t_s,x_mm,y_mm,z_mm,qw,qx,qy,qz", *rows]))
    calibration.write_text(calibration.read_text().replace("[48, 32]", "[64, 48]"))
    recording = film(tmp_path / "scan.mkv"), "--poses", table, "--calibration", calibration
    said = "a film does not say how its pictures lie: taken as MF; if they lie otherwise, give --orientation"
    assert run(*recording)[1].splitlines().count(f"  {said}") == 1
    assert said not in run(*recording, "--orientation", "MF")[1]


def test_a_report_is_made_and_written(session, calibration, tmp_path):
    code, out, err = run(session, "--calibration", calibration, "--json")
    data = json.loads(out)
    assert code == 0
    assert (data["version"], data["frames"], data["poses"]) == (1, 40, 40)
    assert data["paired"] + sum(data["unpaired"].values()) == 40
    assert f"verdict: {data['verdict']}" in err
    assert data["timeline"][0]["t_s"] == 0.0


GAP = slice(20, 60)
WITHOUT = {
    "no picture": [replace(item, image=None) for item in items(80, REPLAYED_PX)[GAP]],
    "neither picture nor reading of the tracker": [],
}


@pytest.mark.parametrize("lacking", WITHOUT)
def test_a_gap_of_a_recording_is_told_as_one_and_not_as_a_fault_of_the_scanner(calibration, tmp_path, lacking):
    whole, path, page = items(80, REPLAYED_PX), tmp_path / "gap.igs.mha", tmp_path / "page.html"
    write_metaimage(path, [*whole[: GAP.start], *WITHOUT[lacking], *whole[GAP.stop :]], REPLAYED_PX)
    _, out, err = run(path, "--calibration", calibration, "--json", "--html", page)
    said = f"The recording has {lacking} for 3.3 s from 1.52 s on: record again, or cut it there"
    told = [(change["state"], change["reason"]) for change in json.loads(out)["timeline"]]
    assert [one for one in told if one[0] in ("warning", "device lost")] == [("warning", said), ("device lost", said)]
    for text in (err, page.read_text()):
        assert said in text
        assert "No picture from the scanner" not in text


def test_several_gaps_that_lead_to_one_state_are_told_as_such(calibration, tmp_path):
    path = tmp_path / "slow.igs.mha"
    few = [item if n % 10 == 0 else replace(item, image=None) for n, item in enumerate(items(71, REPLAYED_PX))]
    write_metaimage(path, few, REPLAYED_PX)
    err = run(path, "--calibration", calibration)[1]
    assert "warning: The recording has no picture in 7 gaps from 0.00 to 5.60 s, the longest of 0.8 s" in err


def test_missing_readings_of_the_tracker_are_told_and_a_later_gap_is_told_apart():
    timeline = Timeline(START_NS, START_NS, START_NS + 199 * PERIOD_NS)
    for index in range(200):
        timeline.step(Frame(Stamp(START_NS + index * PERIOD_NS, 0), index, picture(index, REPLAYED_PX)), ())
        if not (40 <= index < 60 or 90 <= index < 100):
            timeline.step(reply(index, PoseStatus.OK), ())
    timeline.finish()
    said = [change.reason.partition(":")[0] for change in timeline.changes if change.fault is Fault.TRACKER_LOST]
    first = "The recording has no reading of the tracker for 1.7 s from 3.12 s on"
    assert said == [first, first, "The recording has no reading of the tracker for 0.9 s from 7.12 s on"]


@pytest.mark.parametrize("fault", ["lose-video", "lose-tracker"])
def test_a_device_that_is_lost_on_purpose_is_told_as_live(session, calibration, fault):
    assert "The recording has no" not in run(session, "--calibration", calibration, "--inject", f"{fault}@1")[1]


@pytest.mark.parametrize(
    ("fault", "named"),
    [("lose-video", "video-lost"), ("lose-tracker", "tracker-lost"), ("stale-tracker", "tracker-stale")],
)
def test_an_injected_device_fault_names_the_verdict(session, calibration, tmp_path, fault, named):
    code, out, _ = run(session, "--calibration", calibration, "--inject", fault, "--json")
    data = json.loads(out)
    assert (code, data["verdict"], data["fault"]) == (0, "FAULT", named)


def test_pictures_left_out_count_as_unpaired(calibration, tmp_path):
    holed = items(40, REPLAYED_PX)
    holed[7] = replace(holed[7], image=None)
    path = tmp_path / "holed.mha"
    write_metaimage(path, holed, REPLAYED_PX)
    _, out, _ = run(path, "--calibration", calibration, "--json")
    data = json.loads(out)
    assert data["frames"] == 40
    assert data["unpaired"]["picture marked invalid"] == 1


def test_a_black_box_without_pictures_is_not_verified(tmp_path):
    path = tmp_path / "poses.mcap"
    watched = Calibration(np.eye(3), (1, 1), np.array([0.2, 0.2]), np.zeros(3), REPLAYED_PX)
    record(path, EstimatorSettings(1, watched, Limits(), 500_000_000), [reply(k, PoseStatus.OK) for k in range(20)])
    code, out, _ = run(path, "--json")
    data = json.loads(out)
    assert (code, data["frames"], data["poses"], data["verdict"]) == (65, 0, 20, "NOT_VERIFIED")
    said = run(path)[1].splitlines()[-1]
    assert "verdict: NOT_VERIFIED  there are no pictures, without which motion shows nothing" in said, (
        "it asked for more motion"
    )


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
