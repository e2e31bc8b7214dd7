"""The publisher at a real mosquitto: retained state, last will, credentials, TLS, and a broker that comes and goes."""

import json
import shutil
import signal
import socket
import ssl
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.monitoring.broker import Broker, broker_of
from probewatch.tools.monitoring.mqtt import Publisher, message
from tests.support.answering import Answering, recorded
from tests.support.answers import answered
from tests.support.demo_cart import PROBEWATCH
from tests.support.polling import until

MOSQUITTO = shutil.which("mosquitto") or "/usr/sbin/mosquitto"
needs_mosquitto = pytest.mark.skipif(not Path(MOSQUITTO).exists(), reason="needs mosquitto (mosquitto)")
needs_openssl = pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl (openssl)")
STATE, AVAILABLE = "probewatch/cart-2/state", "probewatch/cart-2/availability"


class Mosquitto:
    """The broker on a port of its own, as often as it is started."""

    def __init__(self, folder: Path, *lines: str) -> None:
        with socket.socket() as taken:
            taken.bind(("127.0.0.1", 0))
            self.port: int = taken.getsockname()[1]
        self.file = folder / "mosquitto.conf"
        listening = [f"listener {self.port} 127.0.0.1", "user root", "persistence false", "log_dest none"]
        self.file.write_text("\n".join((*listening, *lines)) + "\n")
        self.start()

    def start(self) -> None:
        self.process = subprocess.Popen([MOSQUITTO, "-c", str(self.file)])
        until(self._listens, 20)

    def _listens(self) -> bool:
        with socket.socket() as link:
            return link.connect_ex(("127.0.0.1", self.port)) == 0

    def end(self) -> None:
        self.process.kill()
        self.process.wait()


class Reader:
    """What somebody sees who looks on: the last message of each topic."""

    def __init__(self, port: int, tls: ssl.SSLContext | None = None) -> None:
        self.seen: dict[str, str] = {}
        self.retained: set[str] = set()
        self._client = Client(CallbackAPIVersion.VERSION2)
        if tls is not None:
            self._client.tls_set_context(tls)
        self._client.on_message = self._note
        self._client.on_connect = lambda client, *_: client.subscribe("#", 1)
        self._client.username_pw_set("reader", "secret")
        self._client.connect("localhost", port)
        self._client.loop_start()

    def __enter__(self) -> "Reader":
        return self

    def __exit__(self, *_: object) -> None:
        self._client.disconnect()
        self._client.loop_stop()

    def _note(self, _client: Client, _data: Any, told: MQTTMessage) -> None:
        self.seen[told.topic] = told.payload.decode()
        if told.retain:
            self.retained.add(told.topic)

    def state(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.seen.get(STATE, "{}"))
        return found


class Program:
    """`probewatch mqtt`; said: its lines on stderr."""

    def __init__(self, control: Path, *options: object) -> None:
        command = [str(PROBEWATCH), "mqtt", "--socket", str(control), "--cart", "cart-2", *map(str, options)]
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        self.said: list[str] = []
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None

        for line in self.process.stderr:
            self.said.append(line.strip())

    def __enter__(self) -> "Program":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        self._reader.join()
        assert self.process.stderr is not None
        self.process.stderr.close()


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Answering]:
    with Answering(tmp_path / "control") as service:
        yield service


def told_entities(reader: Reader) -> list[dict[str, object]]:
    """What Home Assistant has been told so far: one message an entity."""
    return [json.loads(text) for topic, text in tuple(reader.seen.items()) if topic.startswith("homeassistant/")]


def test_every_name_that_subscribers_rely_on_is_published() -> None:
    """Names are added, never removed: a dashboard of somebody's own reads them."""
    computed = {"up", "verified", "alarm", "lost", "simulated", "reference"}
    as_they_are = {"state", "text", "remedy", "fault", "priority", "notices", "software", "reference_due_utc"}
    as_they_are |= {"latched", "acknowledged"}
    assert computed | as_they_are <= message(recorded()).keys()
    assert message({name: told for name, told in recorded().items() if name != "text"}) == message(None)


@pytest.mark.thorough
@needs_mosquitto
def test_who_comes_later_knows_the_state_and_who_looks_on_learns_of_the_end(service: Answering, tmp_path: Path) -> None:
    broker = Mosquitto(tmp_path, "allow_anonymous true")
    try:
        with Program(tmp_path / "control", "--broker", f"mqtt://127.0.0.1:{broker.port}") as program:
            with Reader(broker.port) as first:
                until(lambda: first.state().get("verified") and first.seen.get(AVAILABLE) == "online", 60)
                service.changes = {
                    "energised": False,
                    "state": "halt",
                    "text": "HALT",
                    "priority": "high",
                    "fault": "scale",
                }
                until(lambda: first.state().get("state") == "halt", 20)
                assert (first.state()["verified"], first.state()["alarm"]) == (False, True)
            with Reader(broker.port) as later:
                until(lambda: later.state().get("state") == "halt", 10)
                assert {STATE, AVAILABLE} <= later.retained
                until(lambda: len(told_entities(later)) == 7, 10)
                entities = told_entities(later)
                assert {entity["state_topic"] for entity in entities} == {STATE}
                assert {entity["availability_topic"] for entity in entities} == {AVAILABLE}
                assert len({entity["unique_id"] for entity in entities}) == 7
                service.mute = True
                until(lambda: later.state().get("up") is False, 20)
                assert later.state()["verified"] is False, "nothing old is told of a service that is silent"
                service.mute = False
                until(lambda: later.state().get("up"), 20)
                program.process.kill()
                until(lambda: later.seen[AVAILABLE] == "offline", 30)
        again = Program(tmp_path / "control", "--broker", f"mqtt://127.0.0.1:{broker.port}")
        with again as program, Reader(broker.port) as reader:
            until(lambda: reader.seen.get(AVAILABLE) == "online" and reader.state().get("up"), 60)
            program.process.send_signal(signal.SIGTERM)
            assert program.process.wait(20) == 0
            until(lambda: reader.seen[AVAILABLE] == "offline" and reader.state()["up"] is False, 10)
    finally:
        broker.end()
    assert set(service.asked) == {"status"}, "it asks nothing else"


@pytest.mark.thorough
@needs_mosquitto
def test_a_broker_that_vanishes_is_said_once_and_comes_back_by_itself(service: Answering, tmp_path: Path) -> None:
    broker = Mosquitto(tmp_path, "allow_anonymous true")
    try:
        with Program(tmp_path / "control", "--broker", f"mqtt://127.0.0.1:{broker.port}") as program:
            until(lambda: program.said, 60)
            assert program.said == [f"telling {STATE} at 127.0.0.1:{broker.port}"]
            broker.end()
            until(lambda: len(program.said) > 1, 20)
            time.sleep(4)  # two more tries
            assert [line.partition(":")[0] for line in program.said[1:]] == ["no broker at 127.0.0.1"]
            broker.start()
            until(lambda: program.said[-1].startswith("telling "), 60)
            with Reader(broker.port) as reader:
                until(lambda: reader.state().get("verified"), 20)
    finally:
        broker.end()


@pytest.mark.thorough
@needs_mosquitto
def test_a_wrong_password_is_said_and_a_right_one_is_taken(service: Answering, tmp_path: Path) -> None:
    users = tmp_path / "users"
    users.touch(0o600)
    for name, word in (("cart", "right"), ("reader", "secret")):
        subprocess.run(["mosquitto_passwd", "-b", users, name, word], check=True)
    broker = Mosquitto(tmp_path, "allow_anonymous false", f"password_file {users}")
    password = tmp_path / "password"
    password.touch(0o600)
    try:
        for word, said in (("wrong", "refuses this cart"), ("right", "telling ")):
            password.write_text(f"{word}\n")
            options = ("--broker", f"mqtt://127.0.0.1:{broker.port}", "--user", "cart", "--password-file", password)
            with Program(tmp_path / "control", *options) as program:
                until(lambda: program.said, 60)
                assert said in program.said[0]
                assert word not in program.said[0]
    finally:
        broker.end()


def authority(folder: Path) -> tuple[Path, Path, Path]:
    """(authority, certificate, key) of a broker called localhost."""
    ca, ca_key, request = folder / "ca.pem", folder / "ca.key", folder / "broker.csr"
    certificate, key = folder / "broker.pem", folder / "broker.key"
    new = ["openssl", "req", "-newkey", "rsa:2048", "-nodes"]
    subprocess.run([*new, "-x509", "-days", "2", "-subj", "/CN=test", "-keyout", ca_key, "-out", ca], check=True)
    subprocess.run([*new, "-subj", "/CN=localhost", "-keyout", key, "-out", request], check=True)
    names = folder / "names"
    names.write_text("subjectAltName=DNS:localhost\n")
    signing = ["openssl", "x509", "-req", "-in", request, "-CA", ca, "-CAkey", ca_key, "-CAcreateserial", "-days", "2"]
    subprocess.run([*signing, "-extfile", names, "-out", certificate], check=True)
    return ca, certificate, key


@pytest.mark.thorough
@needs_mosquitto
@needs_openssl
def test_tls_only_with_a_broker_whose_certificate_is_good(service: Answering, tmp_path: Path) -> None:
    ca, certificate, key = authority(tmp_path)
    broker = Mosquitto(tmp_path, "allow_anonymous true", f"certfile {certificate}", f"keyfile {key}", f"cafile {ca}")
    try:
        for host, options, said in (
            ("localhost", ("--ca", ca), "telling "),
            ("localhost", (), "certificate verify failed"),
            ("127.0.0.1", ("--ca", ca), "certificate verify failed"),
        ):
            with Program(tmp_path / "control", "--broker", f"mqtts://{host}:{broker.port}", *options) as program:
                until(lambda: program.said, 60)
                assert said in program.said[0]
        program = Program(tmp_path / "control", "--broker", f"mqtts://localhost:{broker.port}", "--ca", ca)
        with program, Reader(broker.port, ssl.create_default_context(cafile=str(ca))) as reader:
            until(lambda: reader.state().get("verified"), 60)
    finally:
        broker.end()


@pytest.mark.thorough
@needs_mosquitto
@needs_openssl
def test_a_broker_that_asks_for_a_certificate_is_named_as_that(service: Answering, tmp_path: Path) -> None:
    """It breaks off without a word."""
    ca, certificate, key = authority(tmp_path)
    lines = (f"certfile {certificate}", f"keyfile {key}", f"cafile {ca}", "require_certificate true")
    broker = Mosquitto(tmp_path, "allow_anonymous true", *lines)
    where = f"localhost:{broker.port}"
    try:
        with Program(tmp_path / "control", "--broker", f"mqtts://{where}", "--ca", ca) as program:
            until(lambda: program.said, 60)
            why = "it breaks off before it accepts this cart; does it ask for a --certificate?"
            assert program.said[0] == f"no broker at {where}: {why}; trying again"
    finally:
        broker.end()


def test_a_password_is_neither_told_in_the_clear_nor_readable_by_all(tmp_path: Path) -> None:
    file = tmp_path / "password"
    file.write_text("word\n")
    file.chmod(0o600)
    with pytest.raises(ConfigurationError, match="everybody on the network"):
        broker_of("mqtt://broker.example", "me", file, None, None, None)
    assert broker_of("mqtts://broker.example", "me", file, None, None, None).password == "word"
    file.chmod(0o644)
    with pytest.raises(ConfigurationError, match="everybody may read"):
        broker_of("mqtts://broker.example", "me", file, None, None, None)
    absent = tmp_path / "absent"
    with pytest.raises(ConfigurationError, match=rf"^{absent}: cannot be read \(No such file or directory\)\. Check"):
        broker_of("mqtts://broker.example", None, None, absent, None, None)
    absent.write_text("no certificate")
    with pytest.raises(ConfigurationError, match="cannot be used"):
        broker_of("mqtts://broker.example", None, None, absent, None, None)


@pytest.mark.parametrize("status", [None, {}, {"energised": True}, recorded(outputs=None), recorded(lost=3)])
def test_of_what_is_no_status_nothing_is_told(status: Any) -> None:
    assert message(status) == {"up": False, "verified": False, "alarm": None}


def test_verified_is_what_the_outputs_have_written() -> None:
    status = recorded()
    assert message(status)["verified"] is True
    status["outputs"][0]["energised"] = None
    assert message(status)["verified"] is False


@pytest.mark.parametrize("option", ["--cart", "--prefix"])
def test_a_name_that_is_empty_makes_no_topic(option: str) -> None:
    answer = answered("mqtt", "--broker", "mqtt://127.0.0.1", option, "")
    assert (answer.returncode, f"'{option}': must not be empty" in answer.stderr) == (2, True), answer


def test_a_key_that_is_not_used_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"key without its certificate is never used\. Give --certificate"):
        broker_of("mqtts://broker.example", None, None, None, None, Path("cart.key"))


def test_a_port_that_speaks_tls_alone_is_named_as_that(service: Answering, tmp_path: Path) -> None:
    """It breaks off as soon as it is spoken to in the clear; "it has gone (Unspecified error)" told no remedy."""
    with socket.create_server(("127.0.0.1", 0)) as door:
        door.settimeout(10)

        def breaks_off() -> None:
            link, _ = door.accept()
            link.recv(4096)
            link.close()

        broken = threading.Thread(target=breaks_off)
        broken.start()
        said, stop = list[str](), threading.Event()
        broker = Broker("127.0.0.1", door.getsockname()[1])
        publisher = Publisher(broker, "cart-2", lambda: None, said.append, "probewatch", "")
        running = threading.Thread(target=publisher.run, args=(stop,))
        running.start()
        until(lambda: said, 20)
        stop.set()
        running.join(20)
        broken.join(20)
    assert "it breaks off before it accepts this cart; is it a port for mqtts://?" in said[0]


def test_a_broker_that_closes_is_told_in_words_of_that(service: Answering, tmp_path: Path) -> None:
    """It was "it has gone (Unspecified error)", which is what the library says of it."""
    with socket.create_server(("127.0.0.1", 0)) as door:
        door.settimeout(10)

        def accepts_and_closes() -> None:
            link, _ = door.accept()
            link.recv(4096)
            link.sendall(b"\x20\x03\x00\x00\x00")  # CONNACK: accepted
            link.recv(4096)
            link.close()

        closing = threading.Thread(target=accepts_and_closes)
        closing.start()
        said, stop = list[str](), threading.Event()
        publisher = Publisher(Broker("127.0.0.1", door.getsockname()[1]), "c", lambda: None, said.append, "p", "")
        running = threading.Thread(target=publisher.run, args=(stop,))
        running.start()
        until(lambda: len(said) > 1, 20)
        stop.set()
        running.join(20)
        closing.join(20)
    assert ": it has closed the connection; does another program log in there as probewatch-c?" in said[1]
    assert said[1].endswith("Give this cart a --cart of its own; trying again")
