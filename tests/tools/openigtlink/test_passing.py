"""Pictures and poses of the service's feed, passed through on request: over real sockets, from a real feed."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from threading import Event

import numpy as np
import pytest

from probewatch.appliance.service.estimator.tap import ALL_BUT_PICTURES, NOTHING, PICTURES
from probewatch.drivers.openigtlink.content import NOT_FOUND, NOT_PRESENT, OK, parse_status, parse_transform
from probewatch.drivers.openigtlink.image import grey_picture, parse_image
from probewatch.drivers.openigtlink.message import Message, encode
from probewatch.drivers.samples import PoseStatus
from probewatch.tools.openigtlink import asked
from probewatch.tools.openigtlink.asked import USUAL_NAMES
from probewatch.tools.openigtlink.passage import Passage
from probewatch.tools.openigtlink.server import StateServer
from probewatch.tools.shared.status_watch import StatusWatch
from tests.support.answering import Answering
from tests.support.example_status import example_status
from tests.support.igtl_listener import Listener
from tests.support.polling import until
from tests.support.scripted_feed import ScriptedFeed, unread
from tests.support.stopwatch import Stopwatch

EVERY_S = 0.05


class Bench:
    def __init__(self, folder: Path, size_px: tuple[int, int] = (64, 48), unasked: bool = False) -> None:
        self.said: list[str] = []
        self._running = ExitStack()
        enter = self._running.enter_context
        self.service = enter(Answering(folder / "control", example_status))
        self.feed = ScriptedFeed(folder / "feed", size_px)
        self._running.callback(self._close_feed)
        self.watch = enter(StatusWatch(self.service.path, EVERY_S))
        passage = enter(Passage(self.feed.path, self.said.append))
        self.server = enter(StateServer(("127.0.0.1", 0), self.watch, EVERY_S, passage, USUAL_NAMES, unasked))
        self._stop = Event()
        thread = threading.Thread(target=self.server.run, args=(self._stop,))
        thread.start()
        self._running.callback(thread.join)
        self._running.callback(self._stop.set)
        until(lambda: self.watch.seen().status)

    def close(self) -> None:
        self._running.close()

    def _close_feed(self) -> None:
        """The last one that the test has made."""
        self.feed.close()

    def connect(self) -> Listener:
        return Listener(self.server.address)

    def show(self, client: Listener, kind: str) -> tuple[int, Message]:
        """(number, message) of the first picture or pose that reaches it."""
        told = {}
        until(lambda: self.feed.counts.clients == 1)

        def look() -> Message | None:
            sample = self.feed.show() if kind == "IMAGE" else self.feed.track()
            told[sample.stamp.t_ns] = sample
            client.listen(0.02)
            names = ("Image", "ProbeToTracker")
            return next((one for one in client.heard if one.kind == kind and one.device in names), None)

        message = until(look)
        utc_ns = time.time_ns() - time.monotonic_ns()
        near = min(told, key=lambda t_ns: abs(t_ns + utc_ns - message.time_ns))
        assert abs(near + utc_ns - message.time_ns) < 2_000_000, "the time is that of the sample"
        return told[near].sequence, message


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is asked for is noticed sooner than on a cart."""
    monkeypatch.setattr("probewatch.tools.openigtlink.passage._AGAIN_S", 0.02)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path)
    yield bench
    bench.close()


def granted(client: Listener, kind: str, device: str = "", version: int = 1) -> bool:
    client.ask(kind, device, version=version)
    return client.until(f"RTS_{kind[4:]}").content == b"\0"


def test_nothing_is_passed_before_it_is_asked_for(bench: Bench) -> None:
    with bench.connect() as client:
        client.until("STATUS")
        bench.feed.show()
        bench.feed.track()
        client.listen(0.1)
        assert (bench.feed.counts.clients, bench.feed.wanted) == (0, NOTHING)
        assert {one.kind for one in client.heard} == {"STATUS", "STRING", "TRANSFORM"}
        assert {one.device for one in client.heard if one.kind == "TRANSFORM"} == {
            "ImageToProbe",
            "ImageToProbeEstimate",
        }


def test_a_picture_is_whole_at_its_own_time_and_stops_when_told(bench: Bench) -> None:
    with bench.connect() as client:
        assert granted(client, "STT_IMAGE", "Image", version=2)
        until(lambda: bench.feed.wanted == PICTURES)
        number, message = bench.show(client, "IMAGE")
        picture = parse_image(message.content)
        assert np.unique(grey_picture(picture, None)).tolist() == [number % 256]
        assert (picture.size, picture.matrix[9:]) == ((64, 48, 1), (31.5, 23.5, 0.0))
        assert (message.device, message.said("FrameNumber")) == ("Image", str(number))
        assert (message.said("TimeErrorS"), message.said("Simulated")) == ("0.001000", "false")
        assert granted(client, "STP_IMAGE")
        until(lambda: bench.feed.counts.clients == 0)


def test_a_pose_has_plus_name_and_one_that_is_none_is_left_out(bench: Bench) -> None:
    with bench.connect() as client:
        assert granted(client, "STT_TRANS", "ProbeToTracker", version=2)
        until(lambda: bench.feed.wanted == ALL_BUT_PICTURES)
        for _ in range(3):
            bench.feed.track(PoseStatus.MISSING)
        number, message = bench.show(client, "TRANSFORM")
        assert parse_transform(message.content)[0, 3] == number > 3
        assert (message.device, message.said("TransformStatus")) == ("ProbeToTracker", "OK")


@pytest.mark.parametrize(
    ("ask", "device", "kind"), [("GET_IMAGE", "", "IMAGE"), ("GET_TRANS", "ProbeToTracker", "TRANSFORM")]
)
def test_one_may_be_asked_for_alone(bench: Bench, ask: str, device: str, kind: str) -> None:
    with bench.connect() as client:
        client.ask(ask, device)
        bench.show(client, kind)
        until(lambda: bench.feed.counts.clients == 0)


def test_who_comes_is_shown_everything_where_nobody_needs_to_ask(tmp_path: Path) -> None:
    bench = Bench(tmp_path, unasked=True)
    try:
        with bench.connect() as client:
            bench.show(client, "IMAGE")
            bench.show(client, "TRANSFORM")
        until(lambda: bench.feed.counts.clients == 0)
    finally:
        bench.close()


def test_another_name_and_a_ninth_viewer_are_refused(bench: Bench) -> None:
    with ExitStack() as crowd:
        viewers = [crowd.enter_context(bench.connect()) for _ in range(9)]
        assert not granted(viewers[0], "STT_IMAGE", "Other")
        assert [granted(viewer, "STT_IMAGE") for viewer in viewers] == [True] * 8 + [False]
        viewers[8].ask("GET_IMAGE")
        refused = parse_status(viewers[8].until("STATUS", "").content)
        assert (refused.code, refused.text) == (NOT_FOUND, "too many look at pictures already")
        assert granted(viewers[8], "STT_TRANS")
        viewers[0].line.close()
        until(lambda: granted(viewers[8], "STT_IMAGE"))


def test_a_viewer_that_sleeps_costs_others_nothing_and_gets_the_state_first(tmp_path: Path) -> None:
    """Pictures of 3 MB, of which no buffer holds two."""
    bench = Bench(tmp_path, (2048, 1536))
    try:
        with socket.socket() as sleeper, bench.connect() as client:
            unread(sleeper)
            sleeper.connect(bench.server.address)
            sleeper.sendall(encode(Message("STT_IMAGE", "", b"")))
            assert granted(client, "STT_IMAGE")
            until(lambda: bench.feed.counts.clients == 1)
            statuses = []
            for _ in range(8):
                bench.feed.show()
                client.until("IMAGE")
                statuses += [one for one in client.heard if one.kind == "STATUS"]
                assert all(parse_status(one.content).code == OK for one in statuses)
            watch = Stopwatch()
            client.until("STATUS")
            assert watch.spent_s() < 1.0
            assert bench.server.dropped == 0
    finally:
        bench.close()


def test_a_feed_that_ends_is_said_once_and_comes_back(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(asked, "_ONCE_S", 0.05)
    with bench.connect() as client:
        assert granted(client, "STT_IMAGE")
        until(lambda: bench.feed.counts.clients == 1)
        bench.feed.close()
        lost = parse_status(client.until("STATUS", "Image").content)
        assert (lost.code, lost.error) == (NOT_PRESENT, "nothing comes")
        client.ask("GET_TRANS", "ProbeToTracker")
        assert parse_status(client.until("STATUS", "ProbeToTracker").content).code == NOT_PRESENT
        client.listen(0.2)
        assert len([one for one in client.heard if one.device == "Image"]) <= 2
        bench.feed = ScriptedFeed(tmp_path / "feed")
        bench.show(client, "IMAGE")
        assert [said.partition(":")[0] for said in bench.said] == [
            "no pictures or poses",
            "pictures and poses come again",
        ]
