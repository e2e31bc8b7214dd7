"""Who subscribes sees no `online` beside a `verified` that is long over, whatever the broker keeps or drops."""

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from probewatch.tools.monitoring.broker import Broker
from probewatch.tools.monitoring.mqtt import Publisher, message
from tests.support.answering import recorded
from tests.support.polling import until
from tests.tools.monitoring.test_mqtt import AVAILABLE, STATE, Mosquitto, Reader, needs_mosquitto

pytestmark = [pytest.mark.thorough, needs_mosquitto]
HALT = recorded(energised=False, state="halt", priority="high", fault="rotation", text="HALT · " + 200 * "x")


@contextmanager
def publishing(
    port: int, read: Callable[[], dict[str, Any] | None], discovery: str = ""
) -> Iterator[tuple[Publisher, list[str]]]:
    """The publisher, and what it says."""
    said, stop = list[str](), threading.Event()
    publisher = Publisher(Broker("127.0.0.1", port), "cart-2", read, said.append, "probewatch", discovery)
    thread = threading.Thread(target=publisher.run, args=(stop,))
    thread.start()
    try:
        yield publisher, said
    finally:
        stop.set()
        thread.join()


@pytest.mark.parametrize(
    ("limit", "why"), [("message_size_limit", "Quota exceeded"), ("max_packet_size", "Packet too large")]
)
def test_a_broker_that_refuses_a_long_state_is_left_until_it_keeps_one(tmp_path: Path, limit: str, why: str) -> None:
    """Mosquitto drops what exceeds message_size_limit; by MQTT 3.1.1 it acknowledged that all the same. It broke off at
    what exceeds max_packet_size, and the state before, `verified`, stayed.
    """
    healthy = len(json.dumps(message(recorded()), ensure_ascii=False).encode())
    broker = Mosquitto(tmp_path, "allow_anonymous true", f"{limit} {healthy + 100}")
    now = [recorded()]
    try:
        with publishing(broker.port, lambda: now[0]) as (_, said), Reader(broker.port) as looking:
            until(lambda: looking.seen.get(AVAILABLE) == "online" and looking.state().get("verified"), 20)
            now[0] = HALT
            until(lambda: looking.seen[AVAILABLE] == "offline" and looking.state()["verified"] is False, 5)
            told = []
            end_s = time.monotonic() + 5
            while time.monotonic() < end_s:  # two more tries
                with Reader(broker.port) as later:
                    until(lambda later=later: len(later.seen) == 2, 20)
                    told.append((later.seen[AVAILABLE], later.state()["verified"]))
            assert set(told) == {("offline", False)}
            where = f"127.0.0.1:{broker.port}"
            words = f"it refuses {STATE} ({why}); raise its limit of a message; trying again"
            assert said == [f"telling {STATE} at {where}", f"no broker at {where}: {words}"]
            now[0] = recorded()
            until(lambda: looking.seen[AVAILABLE] == "online" and looking.state()["verified"], 20)
    finally:
        broker.end()


NO_RIGHT, TOO_LARGE = (
    "(Not authorized); let this user write that topic",
    "(Packet too large); raise its limit of a message",
)


@pytest.mark.parametrize(("limit", "why"), [("acl_file {rights}", NO_RIGHT), ("max_packet_size {bytes}", TOO_LARGE)])
def test_a_broker_that_refuses_what_is_for_home_assistant_is_told_the_state(
    tmp_path: Path, limit: str, why: str
) -> None:
    """It broke off at what was too large for it, again at each try."""
    rights = tmp_path / "rights"
    rights.write_text("pattern readwrite probewatch/#\n")
    rights.chmod(0o600)
    short = recorded(text="", remedy="", reference=None)
    most = len(json.dumps(message(short), ensure_ascii=False).encode()) + 100
    broker = Mosquitto(tmp_path, "allow_anonymous true", limit.format(rights=rights, bytes=most))
    try:
        with publishing(broker.port, lambda: short, "homeassistant") as (_, said), Reader(broker.port) as reader:
            until(lambda: reader.seen.get(AVAILABLE) == "online" and len(said) > 1, 20)
            time.sleep(2)
            assert reader.seen[AVAILABLE] == "online"
            assert reader.state()["verified"] is True
    finally:
        broker.end()
    assert len(said) == 2
    assert said[1].startswith("the broker refuses homeassistant/binary_sensor/probewatch_cart-2/")
    assert said[1].endswith(f"/config {why}; or give --discovery ''")


def test_who_comes_back_is_not_online_before_its_state_is_told(tmp_path: Path) -> None:
    broker = Mosquitto(tmp_path, "allow_anonymous true")
    slow, seen = threading.Event(), [("online", True)]

    def read() -> dict[str, Any] | None:
        if not slow.is_set():
            return recorded()
        time.sleep(2)  # a service that hangs
        return None

    try:
        with publishing(broker.port, read) as (publisher, _), Reader(broker.port) as reader:
            until(lambda: reader.state().get("verified") and reader.seen.get(AVAILABLE) == "online", 20)
            slow.set()
            publisher._client.socket().shutdown(2)  # the network breaks
            end_s = time.monotonic() + 8
            while time.monotonic() < end_s:
                told = (reader.seen[AVAILABLE], reader.state()["verified"])
                if seen[-1] != told:
                    seen.append(told)
                time.sleep(0.02)
    finally:
        broker.end()
    assert ("online", True) not in seen[1:], seen
    assert seen[-1] == ("online", False)


def test_a_power_cut_of_cart_and_broker_leaves_nothing_that_outlives_its_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A broker with persistence keeps retained messages, and no last will."""
    monkeypatch.setattr("probewatch.tools.monitoring.mqtt._EXPIRES_S", 4)
    monkeypatch.setattr("probewatch.tools.monitoring.mqtt._REPEAT_S", 1.0)
    (tmp_path / "db").mkdir()
    kept = ("allow_anonymous true", "persistence true", f"persistence_location {tmp_path}/db/", "autosave_interval 1")
    broker, number = Mosquitto(tmp_path, *kept), count()
    monkeypatch.setattr("probewatch.tools.monitoring.mqtt._LOOK_S", 0.2)
    try:
        with publishing(broker.port, lambda: recorded(text=str(next(number))), "homeassistant"):
            with Reader(broker.port) as reader:
                until(lambda: len(reader.seen) >= 9, 20)
            time.sleep(6)
            with Reader(broker.port) as reader:
                until(lambda: {STATE, AVAILABLE} <= reader.retained, 10)  # it stays, however often the state changes
            broker.end()
        time.sleep(5)
        broker.start()
        with Reader(broker.port) as reader:
            until(lambda: len(reader.seen) >= 7, 20)
            time.sleep(1)
            assert {topic.partition("/")[0] for topic in reader.seen} == {"homeassistant"}, reader.seen
    finally:
        broker.end()


def test_two_carts_of_one_name_are_named(tmp_path: Path) -> None:
    broker = Mosquitto(tmp_path, "allow_anonymous true")
    try:
        with publishing(broker.port, recorded) as (_, said):
            until(lambda: said, 20)
            with publishing(broker.port, recorded):
                until(lambda: len(said) > 1, 20)
    finally:
        broker.end()
    words = "does another program log in there as probewatch-cart-2? Give this cart a --cart of its own; trying again"
    assert said[1] == f"no broker at 127.0.0.1:{broker.port}: it has closed the connection; {words}"
