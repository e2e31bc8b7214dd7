"""The NDI driver against a simulated Polaris on a real pseudo-terminal: states it may find, faults it must tell."""

import json
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from statistics import median

import numpy as np
import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.drivers.rigid import rigid, rotation_from_vector
from probewatch.drivers.samples import Matrix4, PoseStatus
from probewatch.drivers.trackers.ndi.pose_status import status_of_system, status_of_tool
from probewatch.drivers.trackers.ndi.replies import HandleState, ToolReply
from probewatch.drivers.trackers.ndi.tracker import open_tracker
from probewatch.drivers.twins.faults import Episode, Schedule
from probewatch.drivers.twins.ndi.combined_api import Mode
from probewatch.drivers.twins.ndi.tool_definitions import REFERENCE, make_rom
from tests.support import simulated_ndi
from tests.support.simulated import PROBEWATCH
from tests.support.simulated_ndi import bench, moving, poses, until
from tests.support.stopwatch import Stopwatch


def test_poses_are_those_of_the_device(tmp_path: Path) -> None:
    with bench(tmp_path) as cart, cart.open() as tracker:
        for _ in range(20):
            pose = until(tracker, PoseStatus.OK)
            assert pose.matrix is not None
            t_s = cart.twin.device.frame_s(pose.sequence)
            np.testing.assert_allclose(pose.matrix, moving("probe", t_s, 0), atol=1e-3)
            assert pose.rms_mm == pytest.approx(0.2, abs=1e-6)


def test_poses_relative_to_the_reference_tool(tmp_path: Path) -> None:
    with bench(tmp_path) as cart, cart.open(reference=str(tmp_path / "reference.rom")) as tracker:
        (pose,) = poses(tracker, 1)
        t_s = cart.twin.device.frame_s(pose.sequence)
        expected = np.linalg.inv(moving("reference", t_s, 0)) @ moving("probe", t_s, 0)
        assert pose.matrix is not None
        np.testing.assert_allclose(pose.matrix, expected, atol=1e-3)
        cart.twin.device.ports[cart.handle(REFERENCE)].seen = False
        assert until(tracker, PoseStatus.MISSING).reason == "reference tool: the tracker does not see the tool"


def test_a_tracker_that_was_moved_is_told_and_changes_no_pose_relative_to_the_reference(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blow = rigid(rotation_from_vector(np.deg2rad([1.0, 4.0, -1.0])), np.array([5.0, 0.0, -3.0]))
    moved: list[Matrix4] = []

    def seen(tool: str, t_s: float, number: int) -> Matrix4:
        return moved[0] @ moving(tool, t_s, number) if moved else moving(tool, t_s, number)

    monkeypatch.setattr(simulated_ndi, "moving", seen)
    with bench(tmp_path, rate=16.0) as cart, cart.open(reference=str(tmp_path / "reference.rom")) as tracker:
        until(tracker, PoseStatus.OK)

        def run(seconds: float) -> tuple[str, ...]:
            """What is said after them; every pose is right."""
            end_ns = cart.clock.now_ns() + round(seconds * 1e9)
            while cart.clock.now_ns() < end_ns:
                if (pose := tracker.read(1.0)) is not None and pose.matrix is not None:
                    t_s = cart.twin.device.frame_s(pose.sequence)
                    expected = np.linalg.inv(moving("reference", t_s)) @ moving("probe", t_s)
                    np.testing.assert_allclose(pose.matrix, expected, atol=2e-3)
            return tracker.describe().remarks

        assert not [said for said in run(5.0) if "was moved" in said]
        moved.append(blow)
        assert [said for said in run(5.0) if "the tracker or the reference tool was moved" in said]


def test_what_every_start_counts_is_told_as_no_fault(tmp_path: Path) -> None:
    """The first pose is always read a second time."""
    with bench(tmp_path) as cart, cart.open() as tracker:
        until(tracker, PoseStatus.OK)
        (said,) = tracker.describe().remarks
    assert said == "poses read a second time, after a leap or a gap, and then used: 1; this is no fault"


def test_closing_leaves_the_device_as_a_fresh_program_expects_it(tmp_path: Path) -> None:
    with bench(tmp_path) as cart:
        with cart.open() as tracker:
            poses(tracker, 1)
        assert (cart.twin.device.mode, cart.twin.device.baud) == (Mode.INITIALISED, 9600)


def test_the_first_wired_tool_needs_no_definition(tmp_path: Path) -> None:
    with bench(tmp_path) as cart:
        cart.twin.device.handles.wired = ("probe",)
        with open_tracker(str(tmp_path / "tracker"), {"deadline_ms": "2000"}, cart.clock) as tracker:
            assert until(tracker, PoseStatus.OK).matrix is not None


def test_no_tool_at_all_says_so(tmp_path: Path) -> None:
    with bench(tmp_path) as cart, pytest.raises(DeviceLost, match="no tool is connected"):
        open_tracker(str(tmp_path / "tracker"), {}, cart.clock)


@pytest.mark.parametrize(
    ("bits", "status", "word"),
    [
        (0x40, PoseStatus.OUT_OF_VOLUME, "outside"),
        (0x80, PoseStatus.PARTIAL, "partly outside"),
        (0x200, PoseStatus.FAULT, "interference"),
        (0x1000, PoseStatus.FAULT, "exception"),
    ],
)
def test_port_status_takes_the_number_away(tmp_path: Path, bits: int, status: PoseStatus, word: str) -> None:
    with bench(tmp_path) as cart, cart.open() as tracker:
        poses(tracker, 1)
        cart.twin.device.ports[cart.handle()].extra_status = bits
        pose = until(tracker, status)
        assert word in pose.reason
        cart.twin.device.ports[cart.handle()].extra_status = 0
        assert until(tracker, PoseStatus.OK).matrix is not None


def test_missing_tool_is_a_fresh_fact(tmp_path: Path) -> None:
    with bench(tmp_path) as cart, cart.open() as tracker:
        poses(tracker, 1)
        cart.twin.device.ports[cart.handle()].seen = False
        first = until(tracker, PoseStatus.MISSING)
        second = until(tracker, PoseStatus.MISSING)
        assert second.sequence > first.sequence
        assert second.stamp.t_ns > first.stamp.t_ns
        cart.twin.device.ports[cart.handle()].seen = True
        assert until(tracker, PoseStatus.OK).matrix is not None


def test_bump_is_latched_and_names_itself(tmp_path: Path) -> None:
    with bench(tmp_path) as cart, cart.open() as tracker:
        poses(tracker, 1)
        cart.twin.device.raise_alert(0x200000)
        assert until(tracker, PoseStatus.FAULT).reason == "the position sensor was bumped"
        assert cart.twin.device.new_alerts == 0, "the alert was read"
        assert {pose.status for pose in poses(tracker, 5)} == {PoseStatus.FAULT}


@pytest.mark.parametrize(("unanswered", "lost"), [(2, False), (100, True)])
def test_an_alert_that_is_asked_for_in_vain_loses_the_tracker_only_when_it_insists(
    unanswered: int, lost: bool, tmp_path: Path
) -> None:
    with bench(tmp_path) as cart, cart.open() as tracker:
        poses(tracker, 1)
        answer, left = cart.twin.device.answer, [b""] * unanswered

        def deaf_to_get(line: bytes, t_s: float, monitor: bool = False) -> bytes:
            return left.pop() if line.startswith(b"GET") and left else answer(line, t_s, monitor)

        cart.twin.device.answer = deaf_to_get  # type: ignore[method-assign]
        cart.twin.device.raise_alert(0x200000)
        if lost:
            with pytest.raises(DeviceLost, match="does not report its alerts"):
                poses(tracker, 20)
        else:
            assert until(tracker, PoseStatus.FAULT).reason == "the position sensor was bumped"


def test_low_battery_does_not_stop_the_watch(tmp_path: Path) -> None:
    with bench(tmp_path) as cart, cart.open() as tracker:
        cart.twin.device.raise_alert(0x100000)
        assert {pose.status for pose in poses(tracker, 5)} == {PoseStatus.OK}


def test_standing_counter_is_stale_and_recovers(tmp_path: Path) -> None:
    with bench(tmp_path, rate=1.0) as cart, cart.open() as tracker:
        poses(tracker, 30)
        cart.faults("stale-tracker")
        watch = Stopwatch()
        stale = until(tracker, PoseStatus.STALE)
        assert "stood still" in stale.reason
        assert watch.spent_s() < 0.15
        assert tracker.read(0.2) is not None, "word that it is still stale"
        cart.faults()
        assert until(tracker, PoseStatus.OK).matrix is not None


def test_repeated_pose_under_a_running_counter_is_stale(tmp_path: Path) -> None:
    with bench(tmp_path) as cart, cart.open() as tracker:
        poses(tracker, 3)
        cart.twin.device._pose_at = lambda tool, t_s, number: np.eye(4)
        until(tracker, PoseStatus.STALE, reason="equal to the last bit")


def test_a_20_hz_unit_is_not_stale(tmp_path: Path) -> None:
    with bench(tmp_path, rate=1.0, track_hz=20) as cart, cart.open() as tracker:
        found = poses(tracker, 25)
        assert {pose.status for pose in found} == {PoseStatus.OK}
        steps = [b.sequence - a.sequence for a, b in pairwise(found)]
        assert median(steps) == 3
        assert all(step % 3 == 0 for step in steps), "one lost on a busy host makes two"


def test_scheduled_faults_act_on_the_probe(tmp_path: Path) -> None:
    schedule = Schedule((Episode("slide-marker", 0.0),))
    with bench(tmp_path, schedule=schedule) as cart, cart.open() as tracker:
        (pose,) = poses(tracker, 1)
        assert pose.matrix is not None
        true = moving("probe", cart.twin.device.frame_s(pose.sequence), 0)
        assert np.linalg.norm(pose.matrix[:3, 3] - true[:3, 3]) == pytest.approx(10.0, abs=0.05)


@pytest.mark.parametrize(("track_hz", "step"), [(60, 1), (20, 3)])
def test_sparse_poses_are_one_measurement_in_twelve(tmp_path: Path, track_hz: int, step: int) -> None:
    schedule = Schedule((Episode("sparse-poses", 0.0),))
    with bench(tmp_path, track_hz=track_hz, schedule=schedule) as cart, cart.open() as tracker:
        found = poses(tracker, 60)
    expected = [PoseStatus.MISSING if pose.sequence // step % 12 else PoseStatus.OK for pose in found]
    assert [pose.status for pose in found] == expected
    assert PoseStatus.OK in expected


def test_latency_reports_an_old_pose_as_fresh(tmp_path: Path) -> None:
    with bench(tmp_path, schedule=Schedule((Episode("latency", 0.0),))) as cart, cart.open() as tracker:
        (pose,) = poses(tracker, 1)
        assert pose.matrix is not None
        assert pose.matrix[0, 3] == pytest.approx(10 * (cart.twin.device.frame_s(pose.sequence) - 0.1), abs=1e-3)


def test_a_counter_that_starts_again_is_believed_after_a_few_replies(tmp_path: Path) -> None:
    with bench(tmp_path) as cart, cart.open() as tracker:
        before = poses(tracker, 3)[-1]
        cart.twin.device._counter_zero = before.sequence + 2
        after = until(tracker, PoseStatus.OK)
        assert after.sequence < before.sequence
        assert after.stamp.t_ns > before.stamp.t_ns


def test_reset_in_mid_stream_is_a_lost_device_and_heals(tmp_path: Path) -> None:
    with bench(tmp_path, rate=8.0) as cart:
        with cart.open() as tracker:
            poses(tracker, 2)
            cart.twin.spoil = lambda reply: b"RESETBE6F\r"
            with pytest.raises(DeviceLost, match="restarted by itself"):
                poses(tracker, 10)
            cart.twin.spoil = bytes
            cart.twin.device.reset()
        with cart.open() as tracker:
            assert until(tracker, PoseStatus.OK).matrix is not None


def test_device_out_of_tracking_mode_is_lost(tmp_path: Path) -> None:
    with bench(tmp_path) as cart, cart.open() as tracker:
        poses(tracker, 2)
        cart.twin.device.mode = Mode.INITIALISED
        with pytest.raises(DeviceLost, match="ERROR0C"):
            poses(tracker, 3)


def test_unplugged_cable_is_lost_at_once(tmp_path: Path) -> None:
    with bench(tmp_path) as cart, cart.open() as tracker:
        poses(tracker, 2)
        cart.line.unplug()
        with pytest.raises(DeviceLost, match="serial port failed"):
            poses(tracker, 3)


def test_tool_unplugged_or_plugged_starts_the_connection_again(tmp_path: Path) -> None:
    with bench(tmp_path) as cart, cart.open() as tracker:
        poses(tracker, 2)
        cart.twin.device.system_status = 0x80
        with pytest.raises(DeviceLost, match="plugged"):
            poses(tracker, 3)


def test_port_in_use_and_absent_port(tmp_path: Path) -> None:
    with bench(tmp_path) as cart, cart.open():
        with pytest.raises(DeviceLost, match="in use by another program"):
            cart.open()
        with pytest.raises(DeviceLost, match="no such serial port"):
            open_tracker(str(tmp_path / "nothing"), {}, cart.clock)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"baud": "12345"}, "baud=12345"),
        ({"probee": "x"}, "unknown option 'probee'"),
        ({"probe": "/nowhere/p.rom"}, "cannot be read"),
        ({"reference": "r.rom"}, "need a probe"),
        ({"deadline_ms": "0"}, "deadline_ms=0"),
        ({"counter_hz": "fast"}, "counter_hz=fast"),
    ],
)
def test_bad_options_are_refused_before_the_port_is_opened(options: dict[str, str], words: str) -> None:
    with pytest.raises(ConfigurationError, match=words):
        open_tracker("/dev/null", options, HostClock())


@pytest.mark.parametrize("damage", [lambda rom: rom[:-1] + b"\x01", lambda rom: rom[:100], lambda rom: b"PK" + rom])
def test_damaged_tool_definition_is_refused(tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    (tmp_path / "bad.rom").write_bytes(damage(make_rom()))
    with pytest.raises(ConfigurationError, match="tool definition"):
        open_tracker("/dev/null", {"probe": str(tmp_path / "bad.rom")}, HostClock())


@pytest.mark.thorough
def test_a_slow_line_gives_long_replies_their_time(tmp_path: Path) -> None:
    """Four tools at 9600 baud: with details a reply takes half a second, and the deadline is 200 ms."""
    with bench(tmp_path) as cart:
        probe, reference = cart.rom("probe"), cart.rom("reference")
        options = {"baud": "9600", "reference": reference, "tools": f"{probe},{probe}", "deadline_ms": "200"}
        with cart.open(**options) as tracker:
            assert {pose.status for pose in poses(tracker, 6)} == {PoseStatus.OK}
            assert len(tracker.telemetry.tools) == 4


def test_a_speed_the_device_lacks_is_a_configuration_error(tmp_path: Path) -> None:
    with bench(tmp_path) as cart, pytest.raises(ConfigurationError, match="does not have 1228739 baud"):
        cart.open(baud="1228739")


def test_disabled_and_unready_ports_carry_no_pose() -> None:
    assert status_of_tool(ToolReply(1, HandleState.DISABLED))[0] is PoseStatus.DISABLED
    assert status_of_tool(ToolReply(1, HandleState.VALID, None, 0x30, 1))[0] is PoseStatus.DISABLED
    assert status_of_tool(ToolReply(1, HandleState.VALID, None, 0x11, 1))[0] is PoseStatus.DISABLED
    assert status_of_tool(ToolReply(1, HandleState.VALID, None, 0x31, 1)) == (PoseStatus.OK, "")


@pytest.mark.parametrize("bit", [0, 1, 2, 3, 4, 5, 9, 10])
def test_a_device_that_reports_a_fault_of_its_own_is_not_believed(bit: int) -> None:
    status, reason = status_of_system(1 << bit, 0)
    assert status is PoseStatus.FAULT
    assert reason


@pytest.mark.parametrize("bit", [6, 7, 8])
def test_plugs_and_pending_alerts_are_looked_into_and_no_fault_by_themselves(bit: int) -> None:
    assert status_of_system(1 << bit, 0) == (PoseStatus.OK, "")


@pytest.mark.thorough
def test_killed_twin_is_lost_and_a_new_one_takes_the_link_over(tmp_path: Path) -> None:
    command = [*PROBEWATCH, "simulate", "ndi", "--model", "polaris-spectra", "--pty", str(tmp_path / "tracker")]
    command += ["--rom", str(tmp_path / "probe.rom"), "--origin-ns", str(time.monotonic_ns())]
    clock = HostClock()
    with _process(command) as (first, url), open_tracker(*_split(url), clock) as tracker:
        assert until(tracker, PoseStatus.OK).matrix is not None
        first.send_signal(signal.SIGKILL)
        first.wait()
        with pytest.raises(DeviceLost):
            poses(tracker, 3)
    with _process(command) as (second, url):
        with open_tracker(*_split(url), clock) as tracker:
            assert until(tracker, PoseStatus.OK).matrix is not None
        second.terminate()
        assert second.wait(5) == 0
    assert not (tmp_path / "tracker").is_symlink(), "a stopped twin removes what it made"


def _split(url: str) -> tuple[str, dict[str, str]]:
    target, _, rom = url.removeprefix("ndi:").partition("?probe=")
    return target, {"probe": rom}


@contextmanager
def _process(command: list[str]) -> Iterator[tuple[subprocess.Popen[str], str]]:
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield process, json.loads(process.stdout.readline())["url"]
        finally:
            process.kill()
