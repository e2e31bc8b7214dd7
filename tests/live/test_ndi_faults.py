"""Faults at run time: what the simulated trackers do on the wire, and that the driver tells them apart and recovers."""

import json
from pathlib import Path

import numpy as np
import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.registry import open_tracker
from probewatch.drivers.samples import PoseStatus
from probewatch.drivers.trackers.ndi.tracker import NdiTracker
from probewatch.drivers.twins.fault_control import FaultControl, parse_fault, parse_faults
from probewatch.drivers.twins.faults import Episode, Schedule
from probewatch.drivers.twins.ndi.models import SPECTRA, VEGA, Model
from probewatch.drivers.twins.ndi.tracker import NDI_FAULTS
from probewatch.drivers.twins.optotrak.tracker import FAULTS as OPTOTRAK_FAULTS
from probewatch.drivers.twins.tool_motion import pose_file, recorded_motion
from tests.support.recordings import plus_file
from tests.support.simulated import matrix_of, probe_place, simulated_ndi, write_poses
from tests.support.simulated_ndi import bench, poses, until

LINES = pytest.mark.parametrize("model", [SPECTRA, VEGA], ids=["serial", "network"])


@pytest.mark.parametrize("fault", ["corrupt-crc", "truncate", "extra-bytes"])
@LINES
def test_damaged_replies_cost_nothing_but_time(model: Model, fault: str, tmp_path: Path) -> None:
    with bench(tmp_path, model, rate=1.0) as cart, cart.open(deadline_ms="400") as tracker:
        poses(tracker, 3)
        cart.faults(fault)
        found = [pose for _ in range(8) if (pose := tracker.read(1.0))]
        cart.faults()
        assert tracker.telemetry.refused > 0 or fault == "extra-bytes", "junk after a whole reply is thrown away unread"
        for pose in [pose for pose in found if pose.matrix is not None]:
            np.testing.assert_allclose(pose.matrix, cart.true(pose), atol=1e-3)
        until(tracker, PoseStatus.OK)


@LINES
def test_a_counter_that_jumps_starts_the_time_again_and_goes_on(model: Model, tmp_path: Path) -> None:
    with bench(tmp_path, model, rate=1.0) as cart, cart.open() as tracker:
        before = until(tracker, PoseStatus.OK)
        cart.faults("counter-jump")
        after = until(tracker, PoseStatus.OK)
        while after.sequence < before.sequence + 100_000:
            after = until(tracker, PoseStatus.OK)
        np.testing.assert_allclose(after.matrix, cart.true(after), atol=1e-3)
        assert after.stamp.t_ns > before.stamp.t_ns
        assert abs(cart.clock.now_ns() - after.stamp.t_ns) < 100e6


def patient(url: str) -> NdiTracker:
    """A tracker that waits for a busy host."""
    tracker = open_tracker(f"{url}&deadline_ms=2000", HostClock())
    assert isinstance(tracker, NdiTracker)
    return tracker


def test_faults_of_the_command_line_and_of_the_control_file(tmp_path: Path) -> None:
    """The real command: at a time of its own, then by the file, which is looked at whenever it changes."""
    poses_csv = str(write_poses(tmp_path / "p.csv", [k / 60 for k in range(1800)], probe=probe_place))
    tools = ["--rom", str(tmp_path / "probe.rom"), "--poses", poses_csv, "--fault", "missing@0..1.5"]
    model = ["--model", "vega", "--tcp", "0"]
    with simulated_ndi(tmp_path, *model, *tools) as device, patient(device.url) as tracker:
        seen = tracker.read(1.0)
        assert seen is not None
        assert seen.status is PoseStatus.MISSING
        ok = until(tracker, PoseStatus.OK, limit=300)
        np.testing.assert_allclose(ok.matrix, matrix_of(probe_place(ok.sequence / 60)), atol=1e-3)
        for fault, status in (("out-of-volume", PoseStatus.OUT_OF_VOLUME), ("stale-counter", PoseStatus.STALE)):
            device.faults(fault)
            until(tracker, status, limit=300)
        device.faults()
        until(tracker, PoseStatus.OK, limit=300)


def test_control_file_adds_to_the_schedule_and_may_come_and_go(tmp_path: Path) -> None:
    file = tmp_path / "control.json"
    control = FaultControl(NDI_FAULTS, Schedule((Episode("hot", 5.0, 6.0),)), file)
    assert control.active(0.0) == frozenset()
    file.write_text('["bump", {"fault": "slow", "from_s": 2, "to_s": 3}]')
    assert control.active(1.0) == {"bump"}
    assert control.active(2.5) == {"bump", "slow"}
    assert control.active(5.5) == {"bump", "hot"}
    file.write_text('["bump", "nonsense"]')
    assert control.active(6.5) == {"bump"}, "a refused file changes nothing"
    assert "'nonsense' is not a known fault" in control.refusal
    assert (control.new_refusal(), control.new_refusal()) == (control.refusal, None), "told once"
    file.write_bytes(b"\xff\xfe")
    assert control.active(6.7) == {"bump"}
    assert f"{file}: cannot be read (it is not UTF-8 text)" in control.refusal
    file.write_text("")
    assert (control.active(6.9), control.refusal) == (frozenset(), ""), "an empty file lists none"
    file.write_text('["bump"]')
    control.active(7.1)
    file.unlink()
    assert (control.active(7.3), control.refusal) == (frozenset(), "")


@pytest.mark.parametrize(
    ("text", "line", "meant"),
    [
        ('["bmup"]', 1, "Did you mean 'bump'?"),
        ('[\n "bump",\n\n {"fault": "hto", "from_s": 1}]', 4, "Did you mean 'hot'?"),
        ('[{"fault": "bump",\n"from_s": 1}, "bump",\n"LOSE"]', 3, "Did you mean 'lose-tracker'?"),
        ('["depth"]', 1, "of this device; the scanner shows it"),
        ('[\n["bump"]]', 2, "each entry needs fault"),
        ('["x,]", \n\n7]', 1, "is not a known fault. Use "),
        ('["bump"\n,\n{"fault": "bump", "from_s": -1}]', 3, "from_s must be"),
    ],
)
def test_a_misspelt_fault_is_refused_with_its_line_and_what_was_meant(text: str, line: int, meant: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^x.json, line {line}: ") as refused:
        parse_faults(text, NDI_FAULTS, "x.json")
    assert meant in str(refused.value)


@pytest.mark.parametrize("names", [NDI_FAULTS, OPTOTRAK_FAULTS], ids=["ndi", "optotrak"])
def test_every_fault_can_be_named_on_the_command_line_and_in_the_control_file(
    names: tuple[str, ...], tmp_path: Path
) -> None:
    file = tmp_path / "control.json"
    for name in names:
        file.write_text(json.dumps([name]))
        assert FaultControl(names, file=file).active(1.0) == {name}
        assert FaultControl(names, Schedule((parse_fault(f"{name}@1..2", names),))).active(1.0) == {name}


@pytest.mark.parametrize("text", ["{}", "[3]", '["nonsense"]', "[", '[{"fault": "bump", "from_s": -1}]'])
def test_damaged_fault_lists_are_refused(text: str) -> None:
    with pytest.raises(ConfigurationError):
        parse_faults(text, NDI_FAULTS)


def test_fault_of_the_command_line() -> None:
    assert parse_fault("bump", NDI_FAULTS) == Episode("bump", 0.0, None)
    assert parse_fault("bump@3", NDI_FAULTS) == Episode("bump", 3.0, None)
    assert parse_fault("bump@3..4.5", NDI_FAULTS) == Episode("bump", 3.0, 4.5)
    for text in ("bumps", "bump@x", "bump@4..3", "bump@1..x"):
        with pytest.raises(ConfigurationError):
            parse_fault(text, NDI_FAULTS)


def test_pose_file_is_interpolated_and_tells_where_a_tool_is_not_seen(tmp_path: Path) -> None:
    heading = "t_s,tool,q0,qx,qy,qz,x_mm,y_mm,z_mm\n"
    rows = "0,probe,1,0,0,0,0,0,-1000\n2,probe,0,0,0,1,10,20,-1000\n3,probe,,,,,,,\n4,probe,1,0,0,0,5,5,5\n"
    (tmp_path / "p.csv").write_text(heading + rows)
    pose_at = pose_file(tmp_path / "p.csv")
    middle = pose_at("probe", 1.0, 0)
    assert middle is not None
    np.testing.assert_allclose(middle[:3, 3], (5, 10, -1000))
    np.testing.assert_allclose(middle[:2, :2], [[0, -1], [1, 0]], atol=1e-12)
    assert pose_at("probe", 3.5, 0) is None
    for t_s, x_mm in ((-5.0, 0), (4.0, 5), (99.0, 5)):
        found = pose_at("probe", t_s, 0)
        assert found is not None
        assert found[0, 3] == x_mm
    assert pose_at("reference", 1.0, 0) is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0,probe,1,0,0,0,0,0,0\n", "heading is missing"),
        ("HEAD0,probe,1,0,0,0\n", "line 2"),
        ("HEAD0,probe,1,0,0,0,0,0,nan\n", "line 2"),
        ("HEAD0,probe,2,0,0,0,0,0,0\n", "quaternion has length 2"),
        ("HEAD1,probe,1,0,0,0,0,0,0\n1,probe,1,0,0,0,0,0,0\n", "do not rise"),
    ],
)
def test_damaged_pose_files_are_refused_by_line(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text(text.replace("HEAD", "t_s,tool,q0,qx,qy,qz,x_mm,y_mm,z_mm\n"))
    with pytest.raises(Exception, match=words) as refusal:
        pose_file(tmp_path / "p.csv")
    assert type(refusal.value).__name__ == "RecordingError"


def test_a_recording_drives_a_simulated_tracker(tmp_path: Path) -> None:
    path = plus_file("fCal_Test_Validation_3NWires_fCal2.0.igs.mha")
    pose_at = recorded_motion(path)
    probe, reference = pose_at("probe", 0.0, 0), pose_at("reference", 0.0, 0)
    assert (probe is None, reference is None) == (False, False)
    options = ["--model", "vega", "--tcp", "0", "--recording", str(path), "--rom", f"{tmp_path}/p.rom"]
    with simulated_ndi(tmp_path, *options) as device, patient(device.url) as tracker:
        pose = until(tracker, PoseStatus.OK, limit=300)
        expected = pose_at("probe", pose.sequence / 60, 0)
        assert expected is not None
        np.testing.assert_allclose(pose.matrix, expected, atol=2e-3)


def test_a_refused_control_file_is_told_on_stderr(tmp_path: Path) -> None:
    control = FaultControl(NDI_FAULTS, file=tmp_path / "c.json")
    (tmp_path / "c.json").write_text(json.dumps(["bump", 7]))
    control.active(0.0)
    assert "each entry needs fault" in control.refusal
