"""The Optotrak driver against the simulated server on real sockets, and against servers that misbehave."""

import json
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from probewatch.drivers.device_api import Identified
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.io.byte_log import Direction, read_log
from probewatch.drivers.samples import PoseStatus
from probewatch.drivers.trackers.optotrak.rtc3d import (
    Body,
    ByteOrder,
    Component,
    ComponentType,
    DataFrame,
    PacketType,
    Text,
    command,
    decode_packet,
    encode_packet,
    packet_length,
)
from probewatch.drivers.trackers.optotrak.tracker import open_tracker
from probewatch.drivers.twins.tool_motion import PROBE, REFERENCE
from tests.support.manual_clock import ManualClock
from tests.support.optotrak_logs import LOGS, OPTIONS, play
from tests.support.simulated_optotrak import Bench, bench, moving, poses, until
from tests.support.stopwatch import Stopwatch

SESSION = [
    "Version 1.0",
    "SetByteOrder BigEndian",
    "StreamFrames AllFrames 6D Events",
    "StreamFrames Stop",
    "Bye",
]
MODES = [{}, {"order": "little"}, {"mode": "single"}, {"mode": "single", "order": "little"}]


@pytest.mark.parametrize("options", MODES, ids=str)
def test_poses_and_times_are_those_of_the_device(options: dict[str, str]) -> None:
    with bench() as cart, cart.open(**options) as tracker:
        found = poses(tracker, 60)
        errors_ns = []
        for pose in found:
            assert pose.status is PoseStatus.OK
            assert pose.matrix is not None
            t_s = cart.measured_s(pose.sequence)
            np.testing.assert_allclose(pose.matrix, moving(PROBE, t_s, 0), atol=1e-3)
            assert pose.rms_mm == pytest.approx(0.21)
            errors_ns.append(abs(pose.stamp.t_ns - cart.clock.origin_ns - round(t_s * 1e9)))
        assert all(b.stamp.t_ns > a.stamp.t_ns and b.sequence > a.sequence for a, b in pairwise(found))
        covered = [error_ns <= pose.stamp.err_ns for error_ns, pose in zip(errors_ns, found, strict=True)]
        assert np.mean(covered) >= 0.95
        assert tracker.restarts == 0


def test_poses_relative_to_the_reference_body() -> None:
    with bench() as cart, cart.open(reference="2") as tracker:
        (pose,) = poses(tracker, 1)
        world = {tool: moving(tool, cart.measured_s(pose.sequence), 0) for tool in (PROBE, REFERENCE)}
        assert pose.matrix is not None
        np.testing.assert_allclose(pose.matrix, np.linalg.inv(world[REFERENCE]) @ world[PROBE], atol=1e-3)
        cart.show("reference-missing")
        assert until(tracker, PoseStatus.MISSING).reason == "the tracker does not see the reference body"


def test_another_body_can_be_the_probe() -> None:
    with bench() as cart, cart.open(body="2") as tracker:
        (pose,) = poses(tracker, 1)
        np.testing.assert_allclose(pose.matrix, moving(REFERENCE, 0, 0), atol=1e-3)


@pytest.mark.parametrize("options", [{"body": "3"}, {"reference": "3"}], ids=str)
def test_a_body_that_the_server_does_not_list_is_disabled(options: dict[str, str]) -> None:
    with bench() as cart, cart.open(**options) as tracker:
        (pose,) = poses(tracker, 1)
        assert pose.status is PoseStatus.DISABLED
        assert pose.reason == "the server lists 2 rigid bodies, number 3 is not among them"


def test_a_missing_body_is_a_fresh_fact() -> None:
    with bench() as cart, cart.open() as tracker:
        poses(tracker, 3)
        cart.show("missing")
        first = until(tracker, PoseStatus.MISSING)
        (second,) = poses(tracker, 1)
        assert (first.reason, second.status) == ("the tracker does not see the probe's rigid body", PoseStatus.MISSING)
        assert second.sequence > first.sequence
        cart.show()
        assert until(tracker, PoseStatus.OK).matrix is not None


@pytest.mark.parametrize("mode", ["stream", "single"])
@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("stale-tracker", "no new frame for"),
        ("no-data", "no new frame for"),
        ("stale-number", "the frame number has stood still for"),
        ("stale-time", "the time of the frames has stood still for"),
    ],
)
def test_what_does_not_advance_is_stale_and_recovers(fault: str, words: str, mode: str) -> None:
    with bench() as cart, cart.open(mode=mode) as tracker:
        poses(tracker, 10)
        watch = Stopwatch()
        cart.show(fault)
        stale = until(tracker, PoseStatus.STALE)
        assert words in stale.reason
        assert stale.matrix is None
        assert watch.spent_s() < 0.25
        assert until(tracker, lambda pose: True).status is PoseStatus.STALE, "word that it is still stale"
        cart.show()
        assert until(tracker, PoseStatus.OK).matrix is not None


def test_a_repeated_pose_under_running_frames_is_stale() -> None:
    with bench() as cart:
        cart.show("frozen-pose")
        with cart.open() as tracker:
            found = poses(tracker, 13)
            assert {pose.status for pose in found[:11]} == {PoseStatus.OK}
            assert {pose.status for pose in found[11:]} == {PoseStatus.STALE}
            assert found[11].reason == "12 poses in a row are equal to the last bit"
            cart.show()
            assert until(tracker, PoseStatus.OK).matrix is not None


def test_a_poor_fit_is_passed_on() -> None:
    with bench() as cart, cart.open() as tracker:
        assert poses(tracker, 1)[0].rms_mm == pytest.approx(0.21)
        cart.show("marker-drift")
        assert until(tracker, lambda pose: pose.rms_mm > 1).rms_mm == pytest.approx(1.4)


@pytest.mark.parametrize("mode", ["stream", "single"])
def test_an_error_packet_is_a_fault_in_the_words_of_the_server(mode: str) -> None:
    with bench() as cart, cart.open(mode=mode) as tracker:
        poses(tracker, 2)
        cart.show("error")
        assert until(tracker, PoseStatus.FAULT).reason == "the server reports: System is not collecting"
        cart.show()
        assert until(tracker, PoseStatus.OK).matrix is not None


def test_events_are_kept() -> None:
    with bench() as cart, cart.open() as tracker:
        cart.show("events")
        until(tracker, lambda pose: len(tracker.events) > 2)
        assert {event.number for event in tracker.events} == {7}


def test_packets_in_segments_are_put_together() -> None:
    with bench() as cart:
        cart.show("split")
        with cart.open() as tracker:
            assert {pose.status for pose in poses(tracker, 30)} == {PoseStatus.OK}
            assert tracker.refused == 0


@pytest.mark.parametrize("mode", ["stream", "single"])
@pytest.mark.parametrize("fault", ["lose-tracker", "dribble"])
def test_silence_is_told_within_the_deadline(fault: str, mode: str) -> None:
    with bench() as cart:
        with cart.open(mode=mode, deadline_ms="150") as tracker:
            poses(tracker, 5)
            cart.show(fault)
            watch = Stopwatch()
            with pytest.raises(DeviceLost, match="sent no frame for 150 ms"):
                poses(tracker, 1000)
            assert watch.elapsed_s() > 0.1
            assert watch.spent_s() < 0.4
        cart.show()
        watch = Stopwatch()
        with cart.open(mode=mode) as tracker:
            assert until(tracker, PoseStatus.OK).matrix is not None
        assert watch.spent_s() < 2, "tracking resumes within two seconds"


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("unplug", "the server closed the connection"),
        ("reset", "the connection broke off"),
        ("garbage", "the stream cannot be followed"),
        ("wrong-size", "sent no frame for 300 ms; before that: a component of"),
        ("wrong-order", "does order= fit the server?"),
        ("bad-quaternion", "before that: a rigid body whose quaternion has length 2"),
    ],
)
def test_a_broken_stream_is_a_lost_device_that_comes_back(fault: str, words: str) -> None:
    with bench() as cart:
        with cart.open(deadline_ms="300") as tracker:
            poses(tracker, 5)
            cart.show(fault)
            with pytest.raises(DeviceLost) as loss:
                poses(tracker, 1000)
            assert words in loss.value.what
        cart.show()
        with ExitStack() as open_devices:
            tracker = _reopened(open_devices, cart)
            assert until(tracker, PoseStatus.OK).matrix is not None


def _reopened(open_devices: ExitStack, cart: Bench):  # type: ignore[no-untyped-def]
    """The server listens again a moment after its fault has ended."""
    end_s = time.monotonic() + 5
    while True:
        try:
            return open_devices.enter_context(cart.open())
        except DeviceLost:
            assert time.monotonic() < end_s
            time.sleep(0.01)


def test_one_damaged_packet_costs_one_pose() -> None:
    with bench() as cart, cart.open() as tracker:
        poses(tracker, 3)
        cart.show("bad-quaternion")
        end_s = time.monotonic() + 5
        while tracker.refused == 0:
            tracker.read(0.02)
            assert time.monotonic() < end_s
        cart.show()
        assert until(tracker, PoseStatus.OK).matrix is not None
        assert tracker.describe().remarks == (f"{tracker.refused} damaged packets were refused",)


def test_a_jump_of_number_and_time_starts_the_clock_again() -> None:
    with bench() as cart, cart.open() as tracker:
        before = poses(tracker, 30)[-1]
        cart.show("counter-jump")
        after = until(tracker, lambda pose: pose.sequence > before.sequence + 90_000)
        assert after.status is PoseStatus.OK
        assert tracker.restarts == 1
        now_ns = cart.clock.now_ns()
        assert before.stamp.t_ns < after.stamp.t_ns <= now_ns
        assert after.stamp.err_ns >= 50e6, "a fresh line does not pretend to be sure"


def test_known_latency_is_taken_off_the_stamp() -> None:
    with bench() as cart, cart.open(latency_ms="40") as shifted, cart.open() as plain:
        both = [
            (pose, tracker is shifted) for _ in range(40) for tracker in (shifted, plain) for pose in poses(tracker, 1)
        ]
        late = {pose.sequence: pose.stamp.t_ns for pose, is_shifted in both if not is_shifted}
        early = {pose.sequence: pose.stamp.t_ns for pose, is_shifted in both if is_shifted}
        differences_ns = [late[sequence] - early[sequence] for sequence in late.keys() & early.keys()]
        assert len(differences_ns) > 10
        assert np.median(differences_ns) == pytest.approx(40e6, abs=5e6)


def test_several_clients_at_several_rates_and_orders() -> None:
    with bench() as cart, cart.open(rate="20") as slow, cart.open(order="little") as fast:
        steps = [b.sequence - a.sequence for a, b in pairwise(poses(slow, 10))]
        assert {step % 5 for step in steps} == {0}
        assert min(steps) == 5
        assert min(b.sequence - a.sequence for a, b in pairwise(poses(fast, 50))) == 1
        with cart.open(mode="single", rate="50") as single:
            assert len({pose.sequence for pose in poses(single, 10)}) == 10


def test_identity_names_the_server_and_its_bodies() -> None:
    with bench() as cart, cart.open(reference="2") as tracker:
        assert isinstance(tracker, Identified)
        poses(tracker, 5)
        told = tracker.describe()
        assert told.firmware == "Version 1.0 (simulated)"
        assert told.tools == ("rigid body 1", "rigid body 2 (reference)")
        assert told.rate_hz == pytest.approx(100, rel=0.01)
        assert told.remarks == ()


def test_read_honours_its_timeout() -> None:
    with bench() as cart:
        cart.show("no-data")
        with cart.open(deadline_ms="5000") as tracker:
            watch = Stopwatch()
            assert tracker.read(0.03) is None
            assert watch.elapsed_s() >= 0.03
            assert watch.spent_s() < 0.2
            assert tracker.read(0.0) is None


@contextmanager
def hand_made(*script: bytes | float) -> Iterator[tuple[str, list[socket.socket]]]:
    """A server for one client that says these bytes one after the other, each after one command or after a pause.

    Yields its address and, once a client has come, the server's end of the line.
    """
    door = socket.create_server(("127.0.0.1", 0))
    line: list[socket.socket] = []

    def run() -> None:
        line.append(door.accept()[0])
        line[0].settimeout(5)
        for step in script:
            if isinstance(step, float):
                time.sleep(step)
                continue
            try:
                if not line[0].recv(4096):
                    return
                line[0].sendall(step)
            except OSError:
                return

    thread = Thread(target=run)
    thread.start()
    try:
        yield f"127.0.0.1:{door.getsockname()[1]}", line
    finally:
        door.close()
        thread.join()
        for found in line:
            found.close()


def reply(text: str, kind: PacketType = PacketType.COMMAND, nul: bool = True) -> bytes:
    return encode_packet(Text(kind, text, nul), ByteOrder.BIG)


def test_stamps_are_true_although_frames_come_late_and_the_clocks_differ() -> None:
    """60 frames per second, 100 ppm fast, delays of 16 ms mean and bursts to 70 ms."""
    chance, clock = np.random.default_rng(5), ManualClock()
    begin_ns, errors_ns, bounds_ns, last_ns = clock.now_ns(), [], [], 0
    with hand_made(*[reply(text) for text in "123"]) as (target, lines), open_tracker(target, {}, clock) as tracker:
        for number in range(1, 2400):
            true_ns = begin_ns + round(number / 60 * 1e9)
            delay_s = chance.uniform(0.03, 0.07) if number % 200 < 30 else min(chance.exponential(0.016), 0.07)
            last_ns = max(last_ns, true_ns + round(delay_s * 1e9))
            clock.told_ns[0] = last_ns
            body = Body((1.0, 0.0, 0.0, 0.0), (number * 0.1, 0.0, -1500.0), 0.2)
            time_us = round(number / 60 * 1e6 * (1 + 100e-6))
            frame = DataFrame((Component(ComponentType.BODIES, number, time_us, (body,)),))
            lines[0].sendall(encode_packet(frame, ByteOrder.BIG))
            pose = tracker.read(1.0)
            assert pose is not None
            assert pose.sequence == number
            errors_ns.append(abs(pose.stamp.t_ns - true_ns))
            bounds_ns.append(pose.stamp.err_ns)
    errors, bounds = np.array(errors_ns[300:]), np.array(bounds_ns[300:])
    assert np.median(errors) <= 0.5e6
    assert np.quantile(errors, 0.99) <= 2e6
    assert np.mean(errors <= bounds) >= 0.997


def test_the_byte_log_holds_both_directions_and_the_drivers_poses(tmp_path: Path) -> None:
    log = tmp_path / "bytes.log"
    with bench() as cart:
        with cart.open(log=str(log)) as tracker:
            found = poses(tracker, 5)
        tracker.__exit__(None, None, None)
    entries = read_log(log)
    sent = b"".join(entry.data for entry in entries if entry.direction is Direction.SENT)
    assert sent == b"".join(map(command, SESSION))
    received = b"".join(entry.data for entry in entries if entry.direction is Direction.RECEIVED)
    frames = []
    while length := packet_length(received):
        packet, received = decode_packet(received[:length], ByteOrder.BIG), received[length:]
        frames += [packet] if isinstance(packet, DataFrame) else []
    assert [frame.components[0].frame for frame in frames][:5] == [pose.sequence for pose in found]


@pytest.mark.parametrize("name", OPTIONS)
def test_a_recorded_server_decodes_as_it_did(name: str) -> None:
    stated = json.loads((LOGS / f"{name}.json").read_text())
    assert play(name) == stated
    assert {entry["status"] for entry in stated} >= {"ok", "missing", "fault"}
    for entry in stated:
        if "matrix" in entry and entry["frame"] < 100_000:
            world = {tool: moving(tool, entry["frame"] / 100, 0) for tool in (PROBE, REFERENCE)}
            true = np.linalg.inv(world[REFERENCE]) @ world[PROBE] if "reference" in OPTIONS[name] else world[PROBE]
            np.testing.assert_allclose(entry["matrix"], true[:3], atol=1.5e-3)
