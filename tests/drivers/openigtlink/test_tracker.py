"""The tracker source against a server that says what the test tells it to, over a real connection."""

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.drivers.openigtlink.content import (
    Status,
    Tool,
    Turn,
    TurnedTool,
    tools_content,
    transform_content,
    turned_tools_content,
)
from probewatch.drivers.openigtlink.message import UTF_8, Message, encode, time_of
from probewatch.drivers.openigtlink.tracker import IgtlTracker
from probewatch.drivers.registry import check_options, is_simulated, open_tracker
from probewatch.drivers.rigid import seen_from
from probewatch.drivers.samples import Matrix4, Pose, PoseStatus
from tests.support.igtl import UTC_NS, Server, server, transform, turned

PROBE, REFERENCE = "ProbeToTracker", "ReferenceToTracker"
PERIOD_NS = 20_000_000
RATE = 0.25
"""Of a slow clock, which leaves a busy machine four times as long."""
FIXED = turned(100, 90)


@pytest.fixture
def cart() -> Iterator[Server]:
    with server() as one:
        yield one


def opened(cart: Server, clock: HostClock | None = None, **options: str) -> IgtlTracker:
    query = "&".join(f"{key}={value}" for key, value in options.items())
    tracker = open_tracker(f"igtl://{cart.target}?{query}", clock or HostClock())
    assert isinstance(tracker, IgtlTracker)
    cart.accept()
    return tracker


def next_pose(tracker: IgtlTracker) -> Pose:
    pose = tracker.read(1.0)
    assert pose is not None
    return pose


def status(code: int, device: str = "Tracker", text: str = "") -> bytes:
    return encode(Message("STATUS", device, Status(code, 0, "", text).content, time_of(UTC_NS)))


def test_a_transform_is_a_pose(cart: Server) -> None:
    with opened(cart) as tracker:
        began_ns = time.monotonic_ns()
        for count in range(5):
            cart.send(transform(PROBE, turned(count), count * PERIOD_NS))
            pose = next_pose(tracker)
            assert (pose.status, pose.sequence, math.isnan(pose.rms_mm)) == (PoseStatus.OK, count, True)
            np.testing.assert_allclose(pose.matrix, turned(count), atol=1e-3)
            assert began_ns - pose.stamp.err_ns <= pose.stamp.t_ns <= time.monotonic_ns()


def test_a_pose_is_relative_to_the_reference_of_its_own_time_in_either_order(cart: Server) -> None:
    with opened(cart, reference="Reference") as tracker:
        for count in range(4):
            both = [transform(PROBE, turned(count), count * PERIOD_NS), transform(REFERENCE, FIXED, count * PERIOD_NS)]
            cart.send(*both[:: 1 if count % 2 else -1])
            pose = next_pose(tracker)
            np.testing.assert_allclose(pose.matrix, seen_from(FIXED, turned(count)), atol=1e-3)


def test_a_reference_of_another_time_makes_no_pose(cart: Server) -> None:
    with opened(cart, reference="Reference") as tracker:
        cart.send(transform(REFERENCE, FIXED, 0), transform(PROBE, turned(1), 50_000_000))
        cart.send(transform(PROBE, turned(2), 70_000_000))
        pose = next_pose(tracker)
        assert (pose.status, pose.matrix) == (PoseStatus.MISSING, None)
        assert pose.reason == "no transform 'ReferenceToTracker' of the same time"
        cart.send(transform(REFERENCE, FIXED, 73_000_000))
        late = next_pose(tracker)
        assert late.status is PoseStatus.OK
        assert late.stamp.err_ns >= 3_000_000 - 1


SECOND = "WitnessToTracker"


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 0, 2), (0, 2, 1)], ids=str)
def test_a_witness_of_the_same_time_comes_with_the_pose_in_any_order(cart: Server, order: tuple[int, ...]) -> None:
    with opened(cart, reference="Reference", witness="Witness") as tracker:
        for count in range(6):
            t_ns = count * PERIOD_NS
            three = [(PROBE, turned(count)), (REFERENCE, FIXED), (SECOND, turned(count + 80, 50))]
            cart.send(*(transform(*three[one], t_ns) for one in order))
            pose = next_pose(tracker)
            np.testing.assert_allclose(pose.matrix, seen_from(FIXED, turned(count)), atol=1e-3)
            if count == 0:
                continue  # until then it is not known that the server sends the witness last
            np.testing.assert_allclose(pose.witness, seen_from(FIXED, turned(count + 80, 50)), atol=1e-3)


def test_a_witness_of_another_time_or_that_is_gone_is_not_seen_and_holds_up_one_pose_at_most(cart: Server) -> None:
    with opened(cart, witness="Witness") as tracker:
        for count in range(3):
            cart.send(transform(PROBE, turned(count), count * PERIOD_NS))
            cart.send(transform(SECOND, turned(count + 80), count * PERIOD_NS))
            assert next_pose(tracker).sequence == count
        cart.send(transform(PROBE, turned(3), 3 * PERIOD_NS), transform(PROBE, turned(4), 4 * PERIOD_NS))
        gone = next_pose(tracker), next_pose(tracker)
        assert [(pose.sequence, pose.witness) for pose in gone] == [(3, None), (4, None)]
        cart.send(transform(SECOND, turned(84), 5 * PERIOD_NS + 8_000_000), transform(PROBE, turned(5), 5 * PERIOD_NS))
        assert next_pose(tracker).witness is None
        assert "second on the probe" in tracker.describe().tools[-1]


def test_a_name_of_a_transform_is_taken_as_it_is(cart: Server) -> None:
    with opened(cart, probe="StylusToReference") as tracker:
        cart.send(transform("StylusToTracker", turned(1), 0), transform("StylusToReference", turned(2), 0))
        assert next_pose(tracker).matrix[0, 3] == pytest.approx(2)  # type: ignore[index]


@pytest.mark.parametrize("name", ["Probe", PROBE])
def test_tracking_data_hold_both_tools(cart: Server, name: str) -> None:
    with opened(cart, reference="Reference", ask="tdata", header="1") as tracker:
        assert cart.asked() == ["GET_STATUS", "STT_TDATA"]
        tools = (Tool("Other", 1, turned(7)), Tool(name, 2, turned(1)), Tool("Reference", 2, FIXED))
        cart.send(encode(Message("TDATA", "NDITracker", tools_content(tools), time_of(UTC_NS))))
        np.testing.assert_allclose(next_pose(tracker).matrix, seen_from(FIXED, turned(1)), atol=1e-3)


def test_quaternions_hold_the_same_turn(cart: Server) -> None:
    with opened(cart) as tracker:
        half = math.radians(15)
        turn = Turn((10, 20, -1600), (0, 0, math.sin(half), math.cos(half)))
        content = turned_tools_content((TurnedTool("Probe", 2, turn),))
        cart.send(encode(Message("QTDATA", "NDITracker", content, time_of(UTC_NS))))
        np.testing.assert_allclose(next_pose(tracker).matrix, turned(), atol=1e-3)


def said(key: str, value: str) -> dict[str, Any]:
    return {"version": 2, "metadata": ((key, UTF_8, value),)}


@pytest.mark.parametrize(
    ("more", "wanted"),
    [
        (said("TransformStatus", "OK"), PoseStatus.OK),
        (said("TransformStatus", "SWITCH1_IS_ON"), PoseStatus.OK),
        (said("TransformStatus", "INVALID"), PoseStatus.MISSING),
        (said("TransformStatus", "OUT_OF_VIEW"), PoseStatus.MISSING),
        (said("TransformStatus", "OUT_OF_VOLUME"), PoseStatus.OUT_OF_VOLUME),
        (said("TransformStatus", "MISSING"), PoseStatus.DISABLED),
        (said("TransformStatus", "REQ_TIMEOUT"), PoseStatus.STALE),
        (said("TransformStatus", "\x1b[2J"), PoseStatus.NOT_UNDERSTOOD),
        (said("TransformValid", "false"), PoseStatus.MISSING),
        (said("TransformValid", "true"), PoseStatus.OK),
    ],
)
def test_plus_says_in_the_metadata_what_a_transform_is_worth(
    cart: Server, more: dict[str, Any], wanted: PoseStatus
) -> None:
    with opened(cart) as tracker:
        cart.send(transform(PROBE, turned(), 0, **more))
        pose = next_pose(tracker)
        assert pose.status is wanted
        assert pose.reason.isprintable()


def spoilt(change: Callable[[Matrix4], Any]) -> Matrix4:
    matrix = turned()
    change(matrix)
    return matrix


@pytest.mark.parametrize(
    ("matrix", "wanted", "what"),
    [
        (np.eye(4), PoseStatus.MISSING, "not a measurement"),
        (np.zeros((4, 4)), PoseStatus.MISSING, "not a measurement"),
        (spoilt(lambda m: m.__setitem__((0, 0), 1.2)), PoseStatus.NOT_UNDERSTOOD, "not a rotation"),
        (spoilt(lambda m: m.__setitem__((slice(3), 2), -m[:3, 2])), PoseStatus.NOT_UNDERSTOOD, "not a rotation"),
        (spoilt(lambda m: m.__setitem__((1, 1), math.nan)), PoseStatus.NOT_UNDERSTOOD, "not finite"),
        (spoilt(lambda m: m.__setitem__((1, 3), 1e9)), PoseStatus.NOT_UNDERSTOOD, "further away"),
    ],
)
@pytest.mark.parametrize("name", [PROBE, REFERENCE])
def test_a_matrix_that_is_no_measurement_is_no_pose(
    cart: Server, matrix: Matrix4, wanted: PoseStatus, what: str, name: str
) -> None:
    with opened(cart, reference="Reference") as tracker:
        matrices = {PROBE: turned(), REFERENCE: FIXED} | {name: matrix}
        cart.send(*(transform(one, matrices[one], 0) for one in matrices))
        pose = next_pose(tracker)
        assert (pose.status, pose.matrix) == (wanted, None)
        assert name in pose.reason
        assert what in pose.reason


def test_a_complaint_holds_until_the_same_device_is_well(cart: Server) -> None:
    with opened(cart) as tracker:
        cart.send(transform(PROBE, turned(0), 0))
        assert next_pose(tracker).status is PoseStatus.OK
        cart.send(status(13, text="warming up"))
        complaint = next_pose(tracker)
        assert complaint.status is PoseStatus.MISSING
        assert complaint.reason == "the server reports of 'Tracker': not ready (warming up)"
        cart.send(status(1, "Other"), transform(PROBE, turned(1), PERIOD_NS))
        assert next_pose(tracker).reason == complaint.reason
        cart.send(status(1), transform(PROBE, turned(2), 2 * PERIOD_NS))
        assert next_pose(tracker).status is PoseStatus.OK
        assert cart.asked().count("GET_STATUS") >= 2


def test_that_a_server_does_not_know_our_question_is_no_complaint(cart: Server) -> None:
    with opened(cart) as tracker:
        cart.send(status(12), status(17), transform(PROBE, turned(0), 0))
        assert next_pose(tracker).status is PoseStatus.OK


def test_a_server_that_invents_devices_is_not_kept(cart: Server) -> None:
    with opened(cart) as tracker:
        for first in range(0, 2000, 500):
            cart.send(*(status(2, f"Device{number}") for number in range(first, first + 500)))
            for _ in range(500):
                assert next_pose(tracker).status is PoseStatus.MISSING
        assert len(tracker._complaints) == 16
        assert len(tracker._client.received) <= 32


def test_a_server_that_floods_is_lost_by_name(cart: Server) -> None:
    with opened(cart) as tracker:
        cart.send(*(encode(Message("X", "", b"")) for _ in range(5001)))
        with pytest.raises(DeviceLost, match="sends too much: 5001 messages"):
            _read_on(tracker)


def test_a_transform_that_comes_again_is_no_new_pose(cart: Server) -> None:
    with opened(cart, deadline_ms="2000") as tracker:
        cart.send(transform(PROBE, turned(0), 0), transform(PROBE, turned(1), PERIOD_NS))
        assert [next_pose(tracker).status for _ in range(2)] == [PoseStatus.OK] * 2
        cart.send(transform(PROBE, turned(1), PERIOD_NS))
        pose = next_pose(tracker)
        assert pose.status is PoseStatus.STALE
        assert "repeats an old transform" in pose.reason


def test_equal_poses_under_a_running_clock_are_frozen(cart: Server) -> None:
    with opened(cart) as tracker:
        cart.send(*(transform(PROBE, turned(), count * PERIOD_NS) for count in range(13)))
        found = [next_pose(tracker).status for _ in range(13)]
        assert found == [PoseStatus.OK] * 11 + [PoseStatus.STALE] * 2


def test_a_server_that_lives_without_the_transform_says_what_it_sends(cart: Server) -> None:
    with opened(cart) as tracker:
        cart.send(transform("NeedleToTracker", turned(), 0), status(1))
        pose = next_pose(tracker)
        assert pose.status is PoseStatus.MISSING
        assert pose.reason == (
            "no new transform 'ProbeToTracker'; the server sends STATUS 'Tracker', TRANSFORM 'NeedleToTracker'"
        )


@pytest.mark.parametrize("named", [{}, {"probe": "Probe"}])
def test_a_tool_may_be_sent_by_its_name_alone(cart: Server, named: dict[str, str]) -> None:
    with opened(cart, **named) as tracker:
        cart.send(transform("Probe", turned(1), 0))
        np.testing.assert_allclose(next_pose(tracker).matrix, turned(1), atol=1e-3)
        cart.send(transform(PROBE, turned(2), PERIOD_NS), transform("Probe", turned(3), 2 * PERIOD_NS))
        cart.send(transform(PROBE, turned(4), 3 * PERIOD_NS))
        for angle in (2, 4):
            np.testing.assert_allclose(next_pose(tracker).matrix, turned(angle), atol=1e-3)


def test_a_whole_name_stands_for_no_other(cart: Server) -> None:
    with opened(cart, probe="ProbeToTracker") as tracker:
        cart.send(transform("Probe", turned(1), 0))
        assert next_pose(tracker).status is PoseStatus.MISSING


def test_what_is_named_and_never_came_has_the_name_as_its_remedy(cart: Server) -> None:
    with opened(cart) as tracker:
        cart.send(transform("NeedleToTracker", turned(), 0))
        next_pose(tracker)
        told = tracker.describe()
        assert told.absent == "no transform 'ProbeToTracker' came; the server sends TRANSFORM 'NeedleToTracker'"
        assert "probe=" in told.remedy
        cart.send(transform(PROBE, turned(), 0))
        while next_pose(tracker).status is not PoseStatus.OK:
            pass
        assert (tracker.describe().absent, tracker.describe().remedy) == ("", "")


def test_a_transform_that_comes_damaged_each_time_is_told_as_that(cart: Server) -> None:
    with opened(cart) as tracker:
        damaged = bytearray(transform(PROBE, turned(), 0))
        damaged[50:58] = bytes(8)
        cart.send(bytes(damaged))
        next_pose(tracker)
        told = tracker.describe()
        assert told.absent.startswith(
            "no transform 'ProbeToTracker' could be read: TRANSFORM 'ProbeToTracker' is damaged"
        )
        assert "CRC-64" in told.remedy
        cart.send(transform(PROBE, turned(), PERIOD_NS))
        while next_pose(tracker).status is not PoseStatus.OK:
            pass
        assert tracker.describe().absent == ""


def test_messages_without_a_time_have_a_stamp_as_the_remedy(cart: Server) -> None:
    with opened(cart) as tracker:
        cart.send(encode(Message("TRANSFORM", PROBE, transform_content(turned()))))
        assert next_pose(tracker).status is PoseStatus.OK
        assert "stamp what it sends" in tracker.describe().time_remedy


@pytest.mark.parametrize("before", [0, 1])
def test_a_slow_server_is_told_of_the_deadline(cart: Server, before: int) -> None:
    with opened(cart, HostClock(RATE)) as tracker:
        if before:
            cart.send(transform(PROBE, turned(), 0))
            assert next_pose(tracker).status is PoseStatus.OK
        with pytest.raises(DeviceLost, match="has been silent") as lost:
            [tracker.read(1.0) for _ in range(100)]
        assert "deadline_ms=" in str(lost.value)


def _read_on(tracker: IgtlTracker) -> None:
    for _ in range(100):
        tracker.read(0.05)


def test_without_a_time_a_pose_has_that_of_its_arrival_and_says_so(cart: Server) -> None:
    with opened(cart) as tracker:
        cart.send(transform(PROBE, turned(), -UTC_NS))
        before_ns = time.monotonic_ns()
        pose = next_pose(tracker)
        assert pose.stamp.err_ns >= 100_000_000
        assert abs(pose.stamp.t_ns - before_ns) < 200_000_000
        assert "1 poses had no time" in tracker.describe().remarks[0]


def test_a_clock_of_the_sender_that_jumps_does_not_move_the_stamps(cart: Server) -> None:
    with opened(cart) as tracker:
        for count, jump_ns in enumerate((0, 0, 3_600_000_000_000, 0, -3_600_000_000_000)):
            cart.send(transform(PROBE, turned(count), count * PERIOD_NS + jump_ns))
            pose = next_pose(tracker)
            assert pose.status is PoseStatus.OK
            assert abs(pose.stamp.t_ns - time.monotonic_ns()) < 1_000_000_000
            assert not pose.stamp.later_than(time.monotonic_ns())
        assert "times the server's clock jumped, or its messages came later" in tracker.describe().remarks[0]


@pytest.mark.parametrize(
    ("query", "what"),
    [
        ("probe=A&reference=A", "same transform"),
        ("probe=ProbeToTracker&reference=Probe", "same transform"),
        ("deadline_ms=5", "deadline_ms=5 cannot"),
        ("latency_ms=fast", "latency_ms=fast cannot"),
        ("ask=video", "ask=video cannot be used. Use tdata or qtdata"),
        ("header=3", "header=3 cannot be used. Use 1 or 2"),
        ("simulated=maybe", "Use yes or no"),
        ("levels=5,5", "not two rising numbers"),
        ("levels=1", "not two rising numbers"),
        ("crop=1,2,3", "not a part of a picture"),
        ("colour=red", "unknown option 'colour'"),
    ],
)
def test_options_are_refused_by_name(query: str, what: str) -> None:
    for kind in ("video", "tracker"):
        with pytest.raises(ConfigurationError, match=what):
            check_options(f"igtl://cart?{query}", kind)


def test_a_server_is_real_unless_its_url_says_otherwise() -> None:
    assert not is_simulated("igtl://cart?probe=Probe&simulated=no")
    assert is_simulated("igtl://cart?probe=Probe&simulated=yes")
