"""Whoever answers byte by byte gains nothing by it: a deadline is that of the whole answer, at every client of ours.

Each answer is a good one, whole after a second; who had a deadline for each read alone would take it.
"""

import json
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from probewatch.appliance.configuration.config import config_of
from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.service.feed import message
from probewatch.drivers.errors import DeviceLost
from probewatch.tools.monitoring import fleet
from probewatch.tools.page import token_socket
from probewatch.tools.recorder import run
from probewatch.tools.shared import feed

DEADLINE_S, WHOLE_S = 0.2, 1.2
HTTP = b"HTTP/1.0 200 OK\r\nContent-Type: application/json\r\n\r\n"


@contextmanager
def dripping(listener: socket.socket, answer: bytes) -> Iterator[None]:
    """The first client gets the answer byte after byte, all others at once."""
    ended = threading.Event()

    def serve() -> None:
        pause_s = WHOLE_S / len(answer)
        with suppress(OSError):
            while not ended.is_set():
                link, _ = listener.accept()
                with link, suppress(OSError):
                    link.recv(4096)
                    for at in range(len(answer)):
                        link.sendall(answer[at : at + 1])
                        ended.wait(pause_s)
                pause_s = 0

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        listener.shutdown(socket.SHUT_RDWR)
        thread.join()


@pytest.fixture
def listener(tmp_path: Path) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "socket"))
        listener.listen()
        yield listener


def line(**fields: object) -> bytes:
    return json.dumps({"v": 1, "ok": True, **fields}).encode() + b"\n"


def asked(path: Path) -> object:
    with ControlClient(path, DEADLINE_S) as client:
        return client.status()


@pytest.mark.parametrize(
    ("answer", "ask"),
    [
        (line(status={"state": "monitoring"}), asked),
        (line(token="AAAA-BBBB", url="http://127.0.0.1:9780/"), token_socket.invitation),
        (line(recording=True, files=3, entries=11), lambda path: run.ask(path, "status")),
        (message.hello("probewatch 0.1.0"), feed.Feed),
    ],
    ids=["control socket", "token", "recorder", "feed"],
)
def test_a_deadline_is_that_of_the_whole_answer(
    listener: socket.socket, answer: bytes, ask: Callable[[Path], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    for module, deadline_s in ((token_socket, DEADLINE_S), (run, DEADLINE_S / 2), (feed, DEADLINE_S)):
        monkeypatch.setattr(module, "_ANSWER_S", deadline_s)
    with dripping(listener, answer), pytest.raises(DeviceLost):
        ask(Path(listener.getsockname()))


def test_a_prometheus_that_drips_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet, "_TIMEOUT_S", DEADLINE_S)
    body = json.dumps({"status": "success", "data": {"result": []}}).encode()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        url = "http://{}:{}".format(*listener.getsockname())
        with dripping(listener, HTTP + body), pytest.raises(DeviceLost, match=r"no Prometheus answers \(.*within"):
            fleet.reports(url, "probewatch", "30m")


def test_a_message_of_the_feed_that_drips_is_waited_for_as_long_as_was_said_and_not_lost(
    listener: socket.socket,
) -> None:
    answer, looks = message.hello("probewatch 0.1.0") + message.lost(7), 0
    with dripping(listener, answer), feed.Feed(Path(listener.getsockname())) as link:
        while (said := link.next(WHOLE_S / 20)) is None:
            looks += 1
    assert isinstance(said, message.Lost)
    assert (said.samples, looks > 0) == (7, True)


def test_a_client_that_drips_keeps_nobody_from_the_recorder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "_ANSWER_S", 1.0)
    place, ended = tmp_path / "control", threading.Event()
    devices = 'video.url = "sim:/tmp/no"\ntracker.url = "ndi:/tmp/no"\noutput = [{ url = "relay:/tmp/none" }]\n'
    own = f'recorder = {{ folder = "{tmp_path}/black", socket = "{place}" }}\ncontrol.socket = "{tmp_path}/none"\n'
    service = run.RecorderService(config_of(devices + own, tmp_path / "probewatch.toml"), say=lambda _: None)

    def drip(link: socket.socket) -> None:
        with suppress(OSError):
            while not ended.wait(0.1):
                link.sendall(b"x")

    with service, socket.socket(socket.AF_UNIX) as link:
        link.connect(str(place))
        parts = [
            threading.Thread(target=drip, args=(link,)),
            threading.Thread(target=service.run, args=(ended.is_set,)),
        ]
        for part in parts:
            part.start()
        try:
            assert run.ask(place, "status")
        finally:
            ended.set()
            for part in parts:
                part.join()
