"""The connection to the Optotrak's server: servers that misbehave, addresses and options."""

import socket
import time

import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.drivers.io.tcp_line import parse_address
from probewatch.drivers.registry import open_tracker as open_by_url
from probewatch.drivers.samples import PoseStatus
from probewatch.drivers.trackers.optotrak.rtc3d import (
    ByteOrder,
    NoData,
    PacketType,
    encode_packet,
)
from probewatch.drivers.trackers.optotrak.tracker import open_tracker, parse_options
from tests.drivers.trackers.optotrak.test_tracker import hand_made, reply
from tests.support.simulated_optotrak import bench, poses
from tests.support.stopwatch import Stopwatch


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ([reply("Error-No licence", PacketType.ERROR)], "the server refuses 'Version 1.0': the server reports: No lic"),
        (
            [reply("1.0"), reply("ok"), reply("Error-", PacketType.ERROR)],
            "'StreamFrames AllFrames 6D Events': the ",
        ),
        ([b"HTTP/1.1 400 Bad Request\r\n\r\n"], "the stream cannot be followed"),
        ([b""], "no reply to 'Version 1.0'"),
        ([reply("1.0"), encode_packet(NoData(), ByteOrder.BIG) * 3], "no reply to 'SetByteOrder BigEndian'"),
        ([reply("1.0")[:9]], "no reply to 'Version 1.0'"),
        ([encode_packet(NoData(), ByteOrder.BIG) * 1_000_000], "no reply to 'Version 1.0'"),
    ],
)
def test_a_server_that_does_not_play_along_is_named(script: list[bytes], words: str) -> None:
    clock = HostClock(rate=8.0)
    with hand_made(*script) as (target, _):
        watch = Stopwatch()
        with pytest.raises(DeviceLost) as loss:
            open_tracker(target, {}, clock)
        assert watch.spent_s() < 1.0, "the whole handshake shares one deadline"
    assert words in loss.value.what
    assert loss.value.where == f"optotrak://{target}"


def test_a_byte_log_that_cannot_be_written_is_refused() -> None:
    with bench() as cart, pytest.raises(ConfigurationError, match="the byte log cannot be written"):
        cart.open(log="/no/such/folder/bytes.log")


def test_replies_may_lack_the_nul_and_come_with_strays_between() -> None:
    stray = encode_packet(NoData(), ByteOrder.BIG) + reply("<a/>", PacketType.XML)
    script = [reply("Welcome") + reply("1.0", nul=False), stray + reply("x"), reply("y", nul=False) + reply("z")]
    with hand_made(*script, 0.1) as (target, _), open_tracker(target, {}, HostClock()) as tracker:
        assert tracker.read(0.05) is None


def test_a_connection_that_goes_dead_while_open_is_noticed() -> None:
    """Half open: the peer is gone without a word, as when its power fails."""
    script = [reply("1"), reply("2"), reply("3")]
    with hand_made(*script, 0.6) as (target, _), open_tracker(target, {}, HostClock()) as tracker:
        watch = Stopwatch()
        with pytest.raises(DeviceLost, match="sent no frame for 200 ms"):
            tracker.read(5.0)
        assert watch.elapsed_s() > 0.15
        assert watch.spent_s() < 0.45


def test_a_long_pause_of_the_owner_is_not_the_silence_of_the_server() -> None:
    with bench() as cart, cart.open(deadline_ms="50") as tracker:
        poses(tracker, 2)
        time.sleep(0.3)
        assert {pose.status for pose in poses(tracker, 10)} == {PoseStatus.OK}


def test_nobody_there_is_said_at_once() -> None:
    with socket.create_server(("127.0.0.1", 0)) as door:
        port = door.getsockname()[1]
    with pytest.raises(DeviceLost, match="nothing listens there"):
        open_by_url(f"optotrak://127.0.0.1:{port}", HostClock())


def test_an_unknown_name_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*_args: object, **_options: object) -> None:
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    with pytest.raises(DeviceLost, match="the name is unknown"):
        open_by_url("optotrak://tracker.invalid", HostClock())


def test_a_resolver_that_hangs_does_not_hang_us(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_args, **_options: time.sleep(0.8) or [])
    watch = Stopwatch()
    with pytest.raises(DeviceLost, match="not resolved within"):
        open_by_url("optotrak://tracker.invalid", HostClock(rate=10.0))
    assert watch.spent_s() < 0.6


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"bodies": "1"}, "unknown option 'bodies'"),
        ({"body": "0"}, "body=0 cannot be used. Use a whole number from 1 to 255"),
        ({"body": "one"}, "body=one"),
        ({"body": "2", "reference": "2"}, "the same rigid body"),
        ({"reference": "1"}, "the same rigid body"),
        ({"mode": "burst"}, "mode=burst cannot be used. Use stream or single"),
        ({"order": "middle"}, "order=middle cannot be used. Use big or little"),
        ({"rate": "0"}, "rate=0"),
        ({"rate": "4"}, "rate=4 is too slow for the deadline. Use deadline_ms=500"),
        ({"deadline_ms": "nan"}, "deadline_ms=nan"),
        ({"latency_ms": "-1"}, "latency_ms=-1"),
    ],
)
def test_options_that_cannot_work_are_refused_by_name(options: dict[str, str], words: str) -> None:
    with pytest.raises(ConfigurationError) as refusal:
        parse_options(options, "optotrak://host")
    assert words in str(refusal.value)


@pytest.mark.parametrize(
    ("target", "address"),
    [("host", ("host", 3020)), ("10.0.0.7:99", ("10.0.0.7", 99)), ("[::1]:5", ("::1", 5)), ("[::1]", ("::1", 3020))],
)
def test_addresses(target: str, address: tuple[str, int]) -> None:
    assert parse_address(target, 3020, "") == address


@pytest.mark.parametrize("target", ["", "::1", "host:", "host:0", "host:65536", "host:a", "a b", "[::1", "host/x:1"])
def test_what_is_no_address_is_refused(target: str) -> None:
    with pytest.raises(ConfigurationError, match="is not an address"):
        parse_address(target, 3020, "optotrak:")
