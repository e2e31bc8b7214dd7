"""`python -m tests.tools.openigtlink.soak [HOURS]`: the OpenIGTLink traffic of so many hours as fast as it goes.

In: pictures and poses from the simulated server over a real connection, cut and decoded. Out: rounds of state to a
client that stays, to those that come and go and to those that talk nonsense, and pictures and poses of a feed that are
passed through. Counts are those of 8 hours at 30 pictures, 60 poses and 10 rounds a second; memory and descriptors of
this process, which holds all ends, are read on the way.
"""

import json
import math
import os
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path
from threading import Event

import numpy as np

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.openigtlink.content import parse_status, parse_transform
from probewatch.drivers.openigtlink.image import grey_picture, parse_image
from probewatch.drivers.openigtlink.message import Message, encode
from probewatch.drivers.openigtlink.stream import MessageStream
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Sample, Stamp
from probewatch.drivers.twins.fault_control import FaultControl
from probewatch.drivers.twins.faults import Schedule
from probewatch.drivers.twins.openigtlink import FAULTS, IgtlTwin
from probewatch.tools.openigtlink.passage import Passage
from probewatch.tools.openigtlink.server import StateServer
from probewatch.tools.shared.status_watch import StatusWatch
from tests.support.answering import Answering
from tests.support.example_status import example_status
from tests.support.igtl_listener import Listener
from tests.support.scripted_feed import ScriptedFeed

HOUR_S = 3600
PICTURES_HZ, POSES_HZ, ROUNDS_HZ = 30, 60, 10
"""Of a cart, and of the server of its state."""
READINGS = 40
"""Of memory in each half; the first quarter is warming up."""
MOST_MIB = 6.0
"""Growth from the second to the last quarter that is taken for noise of the allocator: an hour's traffic left .3 MiB. A
leak of 4 bytes a message is 10 MiB in 8 h.
"""
MOST_DESCRIPTORS = 4
"""By how many two counts may differ: connections that come and go, and what waits for them. More hides a connection in
so many that is left open; less takes one that is just open for a leak. Not measured.
"""
_IN_FLIGHT = 100
"""Samples ahead of the reader, so that the simulated server does not drop it for reading slowly."""


@dataclass(frozen=True)
class Half:
    """messages: that arrived whole. rss_mib: medians of the second and the last quarter. descriptors: at both."""

    messages: int
    seconds: float
    rss_mib: tuple[float, float]
    descriptors: tuple[int, int]

    @property
    def grown_mib(self) -> float:
        return self.rss_mib[1] - self.rss_mib[0]

    @property
    def leaks(self) -> bool:
        return self.grown_mib > MOST_MIB or self.descriptors[1] > self.descriptors[0] + MOST_DESCRIPTORS


class Gauge:
    """Read it READINGS times on the way to `wanted`."""

    def __init__(self, wanted: int) -> None:
        self._every, self._began_s = max(1, wanted // READINGS), time.monotonic()
        self._rss_mib: list[float] = []
        self._descriptors: list[int] = []

    def look(self, done: int) -> None:
        if done // self._every > len(self._rss_mib):
            self._rss_mib.append(_rss_mib())
            self._descriptors.append(len([*Path("/proc/self/fd").iterdir()]))

    def half(self, messages: int) -> Half:
        quarter = len(self._rss_mib) // 4
        early, late = slice(quarter, 2 * quarter), slice(-quarter, None)
        rss = float(np.median(self._rss_mib[early])), float(np.median(self._rss_mib[late]))
        seconds = round(time.monotonic() - self._began_s, 1)
        # The client that comes and goes has a descriptor at either end, or none.
        return Half(messages, seconds, rss, (max(self._descriptors[early]), max(self._descriptors[late])))


class Source:
    """Samples as fast as the reader takes them."""

    def __init__(self, pictures: bool, room: threading.Semaphore) -> None:
        self._pictures, self._room, self._numbers = pictures, room, count()
        self._image = np.zeros((48, 64), np.uint8)

    def __enter__(self) -> "Source":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def read(self, timeout_s: float) -> Sample | None:
        if not self._room.acquire(timeout=timeout_s):
            return None
        number, stamp = next(self._numbers), Stamp(time.monotonic_ns(), 1000)
        if self._pictures:
            return Frame(stamp, number, self._image)
        matrix = np.eye(4)
        matrix[0, 3] = number % 1000
        return Pose(stamp, number, matrix, math.nan, PoseStatus.OK)


def incoming(hours: float) -> Half:
    """Pictures and poses, two poses for a picture, from the twin's connection."""
    wanted = round(hours * HOUR_S * (PICTURES_HZ + POSES_HZ))
    rooms = {kind: threading.Semaphore(0) for kind in ("IMAGE", "TRANSFORM")}
    sources = (lambda: Source(True, rooms["IMAGE"]), lambda: Source(False, rooms["TRANSFORM"]))
    stop, gauge, stream, done = Event(), Gauge(wanted), MessageStream(lambda header: True), 0
    given = FaultControl(FAULTS, Schedule(()), None)
    with IgtlTwin(("127.0.0.1", 0), HostClock(), sources, given) as twin, ExitStack() as running:
        thread = threading.Thread(target=twin.run, args=(stop,))
        thread.start()
        running.callback(thread.join)
        running.callback(stop.set)
        line = running.enter_context(socket.create_connection(twin.address, 10))
        line.sendall(encode(Message("GET_STATUS", "", b"", version=2)))
        while done < wanted:
            data = line.recv(1 << 16)
            assert data, "the simulated server has gone"
            stream.add(data, time.monotonic_ns())
            while (arrived := stream.take()) is not None:
                done += _decoded(arrived.message)
                if arrived.message.kind in rooms:
                    rooms[arrived.message.kind].release()
                else:
                    # Answered: it has this client, and what it sends from here on arrives.
                    for room in rooms.values():
                        room.release(_IN_FLIGHT)
            gauge.look(done)
    return gauge.half(done)


def _decoded(message: Message) -> int:
    if message.kind == "IMAGE":
        assert grey_picture(parse_image(message.content), None).shape == (48, 64)
    elif message.kind == "TRANSFORM":
        assert parse_transform(message.content)[1, 1] == 1
    else:
        parse_status(message.content)
    return 1


def outgoing(hours: float) -> Half:
    """As many rounds of STATUS as in that time at one client; what else is sent meanwhile comes on top."""
    wanted = round(hours * HOUR_S * ROUNDS_HZ)
    gauge, statuses, messages = Gauge(wanted), 0, 0
    with _served() as (server, feed), ExitStack() as clients:
        stays = clients.enter_context(Listener(server.address))
        for kind in ("STT_IMAGE", "STT_TRANS"):
            stays.ask(kind, version=2)
        for turn in count():
            if statuses >= wanted:
                break
            feed.track()
            feed.show()
            if turn % 50 == 0:
                _come_and_go(server.address, turn)
            stays.listen(0.002)
            statuses += sum(one.kind == "STATUS" for one in stays.heard)
            messages += len(stays.heard)
            stays.heard.clear()
            gauge.look(statuses)
    return gauge.half(messages)


def _come_and_go(address: tuple[str, int], turn: int) -> None:
    """One who asks and ends, or one who talks nonsense."""
    with suppress(OSError), socket.create_connection(address, 5) as line:
        if turn % 100:
            line.sendall(b"GET / HTTP/1.1\r\n\r\n" * 10)
        else:
            for kind in ("GET_STRING", "GET_IMAGE", "STT_TRANS", "GET_CAPABIL"):
                line.sendall(encode(Message(kind, "", b"")))
        line.settimeout(5)
        line.recv(1 << 12)


@contextmanager
def _served() -> Iterator[tuple[StateServer, ScriptedFeed]]:
    with tempfile.TemporaryDirectory() as folder, ExitStack() as running:
        numbers = count()
        busy = Answering(Path(folder) / "control", lambda: example_status(reason=f"answer {next(numbers)}"))
        service = running.enter_context(busy)
        feed = ScriptedFeed(Path(folder) / "feed")
        running.callback(feed.close)
        watch = running.enter_context(StatusWatch(service.path, 0.01))
        passage = running.enter_context(Passage(feed.path, print))
        server = running.enter_context(StateServer(("127.0.0.1", 0), watch, 0.0, passage))
        stop = Event()
        thread = threading.Thread(target=server.run, args=(stop,))
        thread.start()
        running.callback(thread.join)
        running.callback(stop.set)
        yield server, feed


def _rss_mib() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / (1 << 20)


def main() -> int:
    hours = float(sys.argv[1]) if len(sys.argv) > 1 else 8.0
    halves = {"in": incoming(hours), "out": outgoing(hours)}
    told = {name: {**asdict(half), "grown_mib": round(half.grown_mib, 2)} for name, half in halves.items()}
    print(json.dumps({"hours": hours, **told}, indent=1))
    return int(any(half.leaks for half in halves.values()))


if __name__ == "__main__":
    sys.exit(main())
