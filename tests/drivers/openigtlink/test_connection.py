"""An OpenIGTLink server that falls silent, ends or sends damage, over a real connection."""

from collections.abc import Iterator

import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.openigtlink.tracker import IgtlTracker
from probewatch.drivers.samples import PoseStatus
from tests.drivers.openigtlink.test_tracker import PERIOD_NS, PROBE, RATE, _read_on, next_pose, opened, status
from tests.support.igtl import Server, server, transform, turned
from tests.support.stopwatch import Stopwatch


@pytest.fixture
def cart() -> Iterator[Server]:
    with server() as one:
        yield one


def test_a_silent_server_is_asked_and_lost_within_its_deadline(cart: Server) -> None:
    clock = HostClock(RATE)
    with opened(cart, clock, deadline_ms="200") as tracker:
        assert cart.asked() == ["GET_STATUS"]
        cart.send(status(1))
        watch = Stopwatch(RATE)
        with pytest.raises(DeviceLost, match="has been silent for 2"):
            _read_on(tracker)
        assert watch.elapsed_s() > 0.19
        assert watch.spent_s() < 0.45
        assert cart.asked() == ["GET_STATUS"]


def test_a_server_that_answers_is_not_lost_while_it_sees_no_tool(cart: Server) -> None:
    with opened(cart, HostClock(RATE), deadline_ms="200") as tracker:
        cart.asked()
        for _ in range(4):
            cart.send(status(1))
            while "GET_STATUS" not in _asked_meanwhile(cart, tracker):
                pass


def _asked_meanwhile(cart: Server, tracker: IgtlTracker) -> list[str]:
    pose = tracker.read(0.15)
    assert pose is None or pose.status is PoseStatus.MISSING
    assert cart.line is not None
    cart.line.settimeout(0.01)
    try:
        return ["GET_STATUS"] if cart.line.recv(4096) else []
    except TimeoutError:
        return []


def test_bytes_that_never_make_a_message_are_silence(cart: Server) -> None:
    clock = HostClock(RATE)
    with opened(cart, clock, deadline_ms="200") as tracker:
        watch = Stopwatch(RATE)
        with pytest.raises(DeviceLost, match="silent"):
            _dribble(cart, tracker, transform(PROBE, turned(), 0))
        assert watch.spent_s() < 0.45


def _dribble(cart: Server, tracker: IgtlTracker, data: bytes) -> None:
    for byte in data:
        cart.send(bytes([byte]))
        tracker.read(0.005)


def test_an_end_and_another_protocol_are_losses_with_a_remedy(cart: Server) -> None:
    with opened(cart) as tracker:
        cart.send(b"HTTP/1.1 400 Bad Request\r\nContent-Type: text/html; charset=utf-8\r\n\r\n")
        with pytest.raises(DeviceLost, match=r"cannot be followed .header version 18516 is not known"):
            tracker.read(1)
    with opened(cart) as tracker:
        cart.asked()
        cart.close()
        with pytest.raises(DeviceLost, match="the server closed the connection") as loss:
            tracker.read(1)
        assert loss.value.remedy


def test_damage_is_refused_counted_and_named(cart: Server) -> None:
    with opened(cart) as tracker:
        spoilt = bytearray(transform(PROBE, turned(), 0))
        spoilt[-1] ^= 1
        cart.send(bytes(spoilt))
        pose = next_pose(tracker)
        assert "damaged: TRANSFORM 'ProbeToTracker' is damaged" in pose.reason
        cart.send(transform(PROBE, turned(), PERIOD_NS))
        while (good := next_pose(tracker)).status is not PoseStatus.OK:
            assert good.status is PoseStatus.MISSING
        assert tracker.refused == 1
        assert tracker.describe().remarks == ("1 damaged messages were refused",)
