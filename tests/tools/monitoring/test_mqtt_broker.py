"""Brokers that misbehave, and ports that are none."""

import gc
import json
import socket
import ssl
import threading
import time
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO

import pytest

from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.monitoring.broker import Broker, broker_of
from probewatch.tools.monitoring.mqtt import Publisher
from tests.support.answering import recorded
from tests.support.polling import until

STATE, AVAILABLE = "probewatch/cart-2/state", "probewatch/cart-2/availability"
CONNACK = b"\x20\x03\x00\x00\x00"
OLD_CONNACK = b"\x20\x02\x00\x00"
HUGE = b"\x30" + b"\xff\xff\xff\x5d"  # PUBLISH of 197 MB
UNASKED = b"\x32\x07\x00\x01t\x00\x01hi"  # PUBLISH that must be acknowledged
CHUNK = bytes(1 << 16)


class FalseBroker:
    """A port that serves one connection after the other, until it is closed."""

    def __init__(self) -> None:
        self._door = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._door.getsockname()[1]
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while True:
            try:
                link, _ = self._door.accept()
            except OSError:
                return
            with link:
                self._serve(link)

    def _serve(self, link: socket.socket) -> None:
        raise NotImplementedError

    def close(self) -> None:
        self._door.shutdown(socket.SHUT_RDWR)
        self._door.close()
        self._thread.join()


class HostileBroker(FalseBroker):
    """Says what it is told to on each connection, then more without end. taken: bytes of that, by connection; came_s:
    when each connection was made.
    """

    def __init__(self, says: bytes, more: bytes) -> None:
        self._says, self._more = says, more
        self.taken: list[int] = []
        self.came_s: list[float] = []
        super().__init__()

    def _serve(self, link: socket.socket) -> None:
        self.came_s.append(time.monotonic())
        taken = 0
        link.settimeout(10)
        try:
            link.recv(4096)
            link.sendall(self._says)
            while taken < 32 << 20:
                taken += link.send(self._more)
        except OSError:
            pass
        self.taken.append(taken)


@pytest.mark.filterwarnings("ignore:unclosed <socket:ResourceWarning")  # of the library, with each connection
@pytest.mark.parametrize(
    ("says", "more", "words"),
    [
        (CONNACK + HUGE, CHUNK, "sends 197132287 unsolicited bytes"),
        (HUGE, CHUNK, "sends 197132287 unsolicited bytes"),
        (CONNACK, UNASKED * 100, "sends 7 unsolicited bytes"),
        (CONNACK, b"\x40\x02\x00\x01" * 1000, "sends answers without end"),
    ],
    ids=["huge", "huge at once", "unasked", "answers without end"],
)
def test_a_broker_that_says_more_than_answers_is_left_and_tried_again_ever_later(
    says: bytes, more: bytes, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("probewatch.tools.monitoring.mqtt._FIRST_WAIT_S", 0.02)
    broker, said, stop = HostileBroker(says, more), list[str](), threading.Event()
    publisher = Publisher(Broker("127.0.0.1", broker.port), "cart-2", lambda: None, said.append, "probewatch", "")
    running = threading.Thread(target=publisher.run, args=(stop,))
    running.start()
    try:
        until(lambda: len(broker.came_s) >= 5, 20, otherwise=lambda: None)
    finally:
        stop.set()
        running.join()
        broker.close()
    assert max(broker.taken[:4]) < 16 << 20, "it is left before it is heard"
    waits_s = [later - earlier for earlier, later in pairwise(broker.came_s)]
    assert all(wait_s >= 0.02 * 2**number for number, wait_s in enumerate(waits_s))
    assert any(words in line for line in said)
    del publisher, running
    gc.collect()


class TakingBroker(FalseBroker):
    """Takes what is published and answers pings; acknowledges only while it is told to. to_newer: what it answers who
    speaks MQTT 5, or nothing at all; who speaks 3.1.1 is accepted. told: what came on each topic; ends: how each
    connection ended, DISCONNECT or broken off.
    """

    def __init__(self, to_newer: bytes = CONNACK) -> None:
        self._to_newer = to_newer
        self.acknowledges = False
        self.told: list[tuple[str, str]] = []
        self.ends: list[str] = []
        super().__init__()

    def _serve(self, link: socket.socket) -> None:
        with link.makefile("rb") as stream:
            self.ends.append(self._end_of(link, stream))

    def _end_of(self, link: socket.socket, stream: BinaryIO) -> str:
        newer = False
        while head := stream.read(1):
            length, shift = 0, 0
            while True:
                (byte,) = stream.read(1)
                length |= (byte & 0x7F) << shift
                shift += 7
                if byte < 0x80:
                    break
            body = stream.read(length)
            kind = head[0] >> 4
            if kind == 14:
                return "DISCONNECT"
            if kind == 1:
                newer = body[6] == 5
                if newer and self._to_newer != CONNACK:
                    link.sendall(self._to_newer)
                    return "too old"
                link.sendall(CONNACK if newer else OLD_CONNACK)
            elif kind == 12:
                link.sendall(b"\xd0\x00")
            elif kind == 3:
                topic_end = 2 + int.from_bytes(body[:2])
                begins = topic_end + 2 + (1 + body[topic_end + 2] if newer else 0)  # after the properties
                self.told.append((body[2:topic_end].decode(), body[begins:].decode()))
                if self.acknowledges:
                    link.sendall(b"\x40\x02" + body[topic_end : topic_end + 2])
        return "broken off"


def test_a_broker_that_acknowledges_nothing_is_said_once_and_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """It answered pings, so nothing was said, and after 20 messages the library sent no more."""
    monkeypatch.setattr("probewatch.tools.monitoring.mqtt._ACKNOWLEDGED_S", 0.1)
    monkeypatch.setattr("probewatch.tools.monitoring.mqtt._FIRST_WAIT_S", 0.02)
    monkeypatch.setattr("probewatch.tools.monitoring.mqtt._LOOK_S", 0.05)
    broker, said, stop = TakingBroker(), list[str](), threading.Event()
    where = Broker("127.0.0.1", broker.port)
    publisher = Publisher(where, "cart-2", recorded, said.append, "probewatch", "homeassistant")
    running = threading.Thread(target=publisher.run, args=(stop,))
    running.start()
    try:
        until(lambda: len(broker.ends) >= 3, 20)
        assert said == [
            f"telling {STATE} at 127.0.0.1:{broker.port}",
            f"no broker at 127.0.0.1:{broker.port}: it has acknowledged nothing for 0.1 s; trying again",
        ]
        assert set(broker.ends) == {"broken off"}, "a goodbye would take the last will back"
        monkeypatch.setattr("probewatch.tools.monitoring.mqtt._ACKNOWLEDGED_S", 20.0)  # of a busy computer
        broker.acknowledges = True
        until(lambda: len(said) > 2, 20)
        assert said[2:] == [f"telling {STATE} at 127.0.0.1:{broker.port}"]
        held = len(broker.ends)
    finally:
        stop.set()
        running.join()
        broker.close()
    assert broker.ends[held:] == ["DISCONNECT"], "who acknowledges is not left"
    state = json.loads(next(text for topic, text in broker.told if topic == STATE))
    assert (state["latched"], state["acknowledged"]) == (recorded()["latched"], recorded()["acknowledged"])


@pytest.mark.parametrize(
    "answer", [b"\x20\x02\x00\x01", b"\x20\x03\x00\x84\x00", OLD_CONNACK, b""], ids=["old", "new", "unaware", "none"]
)
def test_a_broker_that_knows_no_mqtt_5_is_told_in_the_older_version(answer: bytes) -> None:
    broker, said, stop = TakingBroker(answer), list[str](), threading.Event()
    broker.acknowledges = True
    publisher = Publisher(Broker("127.0.0.1", broker.port), "cart-2", recorded, said.append, "probewatch", "")
    running = threading.Thread(target=publisher.run, args=(stop,))
    running.start()
    try:
        until(lambda: len(broker.told) >= 3, 20)
    finally:
        stop.set()
        running.join()
        broker.close()
    assert broker.told[0] == (AVAILABLE, "offline")
    assert json.loads(broker.told[1][1])["verified"] is True
    assert broker.told[2] == (AVAILABLE, "online")
    assert broker.ends == ["too old", "DISCONNECT"]
    assert len(said) == 1
    assert said[0].endswith("by MQTT 3.1.1, which neither refuses nor forgets a message; use a broker with MQTT 5")


def test_a_password_that_is_not_sent_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "password"
    file.write_text("word\n")
    file.chmod(0o600)
    with pytest.raises(ConfigurationError, match=r"without a user is never sent\. Give --user"):
        broker_of("mqtts://broker.example", None, file, None, None, None)
    file.write_text("\nword\n")
    with pytest.raises(ConfigurationError, match="holds no password"):
        broker_of("mqtts://broker.example", "me", file, None, None, None)


@pytest.mark.filterwarnings("ignore::ResourceWarning")  # the library leaves the socket of a failed handshake open
def test_a_port_without_tls_and_one_where_nobody_listens_are_told_in_words() -> None:
    said: list[str] = []
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        _say_of(Broker("127.0.0.1", nobody.getsockname()[1]), said)
    with socket.create_server(("127.0.0.1", 0)) as plain:
        answering = threading.Thread(target=_answer_in_the_clear, args=(plain,))
        answering.start()
        _say_of(Broker("127.0.0.1", plain.getsockname()[1], ssl.create_default_context()), said)
        answering.join()
    assert said[0].endswith(": connection refused; trying again")
    assert said[1].endswith("; is it a port for mqtts://?; trying again")


def _answer_in_the_clear(plain: socket.socket) -> None:
    line, _ = plain.accept()
    with line:
        line.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")
        line.recv(4096)


def _say_of(broker: Broker, said: list[str]) -> None:
    """The publisher's first message about this broker."""
    stop = threading.Event()

    def say(text: str) -> None:
        said.append(text)
        stop.set()

    Publisher(broker, "cart", lambda: None, say, "probewatch", "").run(stop)


@pytest.mark.parametrize(
    "url",
    [
        "",
        "broker",
        "http://broker",
        "http://broker:1883",
        "https://a:8883",
        "ws://a:9001",
        "mqtt://",
        "mqtt://a:b",
        "mqtt://a:99999",
        "mqtts://me:word@a",
        "mqtt://a/b",
    ],
)
def test_what_is_no_broker_is_refused(url: str) -> None:
    with pytest.raises(ConfigurationError, match="is not the address of a broker") as refused:
        broker_of(url, None, None, None, None, None)
    assert "me:word" not in str(refused.value)
