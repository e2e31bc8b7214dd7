"""The server beside a service: over real sockets, with clients that ask, sleep, flood and break off."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from threading import Event

import click
import pytest
from click.testing import CliRunner

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.openigtlink.content import CHECK_SUM, OK, TIMEOUT, Status, parse_status
from probewatch.drivers.openigtlink.message import Message, encode
from probewatch.tools.cli import probewatch
from probewatch.tools.openigtlink.passage import Passage
from probewatch.tools.openigtlink.server import StateServer
from probewatch.tools.shared.named_cart import NAMED
from probewatch.tools.shared.status_watch import StatusWatch
from tests.support.answering import Answering
from tests.support.example_status import OPEN, example_status
from tests.support.igtl import good_bytes
from tests.support.igtl_listener import Listener
from tests.support.polling import until
from tests.support.stopwatch import Stopwatch

EVERY_S = 0.05


class Bench:
    def __init__(self, service: Answering, server: StateServer, watch: StatusWatch, told: list[str]) -> None:
        self.service, self.server, self.watch, self.told = service, server, watch, told

    def connect(self) -> Listener:
        return Listener(self.server.address)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    stop, told = Event(), list[str]()
    with (
        Answering(tmp_path / "control", example_status) as service,
        StatusWatch(service.path, EVERY_S) as watch,
        Passage(tmp_path / "feed", print) as passage,
        StateServer(("127.0.0.1", 0), watch, EVERY_S, passage, say=told.append) as server,
    ):
        thread = threading.Thread(target=server.run, args=(stop,))
        thread.start()
        try:
            until(lambda: watch.seen().status)
            yield Bench(service, server, watch, told)
        finally:
            stop.set()
            thread.join()


def status_of(message: Message) -> Status:
    return parse_status(message.content)


def said(client: Listener, code: int) -> Message:
    return until(lambda: (found := client.until("STATUS", "Probewatch")) and status_of(found).code == code and found)


def test_a_client_is_told_everything_at_once_and_then_what_changes(bench: Bench) -> None:
    with bench.connect() as client:
        assert status_of(client.until("STATUS", "Probewatch")).code == OK
        client.until("STRING", "ProbewatchState")
        client.until("TRANSFORM", "ImageToProbe")
        bench.service.changes = OPEN
        halted = said(client, 10)
        bench.service.changes = {}
        closed = said(client, OK)
        assert closed.time_ns > halted.time_ns
        assert len([one for one in client.heard if one.kind == "STATUS"]) > len(
            [one for one in client.heard if one.kind == "STRING"]
        )


def test_a_service_that_hangs_is_told_as_silent_and_comes_back(bench: Bench) -> None:
    with bench.connect() as client:
        said(client, OK)
        bench.service.mute = True
        hung_ns = time.time_ns()
        silent = said(client, TIMEOUT)
        assert status_of(silent).error == "service silent"
        last_ok = max(one.time_ns for one in client.heard if one.kind == "STATUS" and status_of(one).code == OK)
        assert last_ok <= hung_ns + 100_000_000, "an OK has the time for which it was true"
        bench.service.mute = False
        said(client, OK)


def test_a_client_of_header_version_2_gets_metadata_and_others_none(bench: Bench) -> None:
    with bench.connect() as old, bench.connect() as new:
        new.ask("GET_STATUS", version=2)
        found = until(lambda: (one := new.until("STATUS")).version == 2 and one)
        assert found.said("State") == "monitoring"
        assert until(lambda: (one := new.until("STRING")).version == 2 and one).said("ContactClosed") == "true"
        assert {one.version for one in old.listen(0.2)} == {1}


def test_questions_are_answered_on_the_same_connection(bench: Bench) -> None:
    with bench.connect() as client:
        for kind, reply in (("GET_CAPABIL", "CAPABILITY"), ("GET_TRANS", "TRANSFORM"), ("GET_IMAGE", "STATUS")):
            client.ask(kind, "ImageToProbe")
            client.until(reply)
        client.line.sendall(b"".join(good_bytes()))
        client.until("RTS_COMMAND", "Recorder")


def test_a_question_that_comes_damaged_is_answered_as_that_and_told_once(bench: Bench) -> None:
    question = bytearray(encode(Message("GET_TRANS", "ImageToProbe", b"\1\2")))
    question[-1] ^= 1
    with bench.connect() as client:
        client.line.sendall(bytes(question) * 20)
        until(lambda: client.listen(0.1) and len(_of_image_to_probe(client)) == 20)
        for refused in map(status_of, _of_image_to_probe(client)):
            assert (refused.code, refused.error) == (CHECK_SUM, "refused")
            assert "GET_TRANS 'ImageToProbe' is damaged (its check sum does not fit)" in refused.text
        client.ask("GET_TRANS", "ImageToProbe")
        client.until("TRANSFORM", "ImageToProbe")
    assert bench.server.damaged == 20
    (line,) = bench.told
    assert line.startswith("the client 127.0.0.1 sends questions that come damaged: GET_TRANS 'ImageToProbe'")
    assert "CRC-64 (ECMA-182)" in line


def _of_image_to_probe(client: Listener) -> list[Message]:
    return [one for one in client.heard if (one.kind, one.device) == ("STATUS", "ImageToProbe")]


def test_a_client_of_another_protocol_is_told_in_the_journal(bench: Bench) -> None:
    with bench.connect() as liar:
        liar.line.sendall(b"GET / HTTP/1.1\r\n\r\n" * 10)
        until(lambda: bench.server.dropped == 1)
    with bench.connect() as again:
        again.line.sendall(b"GET / HTTP/1.1\r\n\r\n" * 10)
        until(lambda: bench.server.dropped == 2)
    (line,) = bench.told
    assert "was sent away, as it sends no OpenIGTLink: header version 18245 is not known" in line


def test_clients_that_sleep_flood_or_break_off_hold_up_nobody(bench: Bench) -> None:
    with ExitStack() as others, bench.connect() as client:
        said(client, OK)
        for _ in range(5):
            others.enter_context(bench.connect())
        for _ in range(5):
            flood = others.enter_context(bench.connect())
            flood.line.setblocking(False)
            with pytest.raises(OSError, match=r".*"):
                _flood(flood.line)
        liar = others.enter_context(bench.connect())
        liar.line.sendall(b"GET / HTTP/1.1\r\n\r\n" * 10)
        bench.service.changes = OPEN
        watch = Stopwatch()
        said(client, 10)
        assert watch.spent_s() < 2.0
        until(lambda: bench.server.dropped >= 1)
        asked, began_s = bench.service.asked.total(), time.monotonic()
        time.sleep(0.5)
        asked = bench.service.asked.total() - asked
        assert asked <= (time.monotonic() - began_s) / EVERY_S + 2, "the service notices nothing"


def _flood(line: socket.socket) -> None:
    """Until nothing more is taken, or the server has had enough of it."""
    while True:
        line.send(b"".join(good_bytes()) * 40)


def test_more_clients_than_places_are_sent_away(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("probewatch.tools.openigtlink.server._SETTLED_S", 60.0)
    with ExitStack() as crowd:
        clients = [crowd.enter_context(bench.connect()) for _ in range(32)]
        for client in clients:
            client.until("STATUS")
        with bench.connect() as late:
            late.line.settimeout(5)
            assert late.line.recv(1) == b""
        assert bench.server.turned_away == 1
        clients[0].line.close()
        until(lambda: bench.server.dropped == 1)
        with bench.connect() as next_one:
            next_one.until("STATUS")


def test_a_crowd_that_says_nothing_keeps_nobody_out(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("probewatch.tools.openigtlink.server._SETTLED_S", 0.0)
    with ExitStack() as crowd:
        silent = [crowd.enter_context(bench.connect()) for _ in range(31)]
        asking = crowd.enter_context(bench.connect())
        asking.ask("GET_CAPABIL")
        asking.until("CAPABILITY")
        for late in [crowd.enter_context(bench.connect()) for _ in range(3)]:
            late.until("STATUS")
        until(lambda: bench.server.turned_away == 3)
        for first in silent[:3]:
            until(lambda first=first: _ended(first.line))  # type: ignore[misc]
        asking.until("STATUS")
        silent[3].until("STATUS")


def _ended(line: socket.socket) -> bool:
    return line.recv(1 << 16) == b""


def test_a_crowd_that_asks_one_question_keeps_nobody_out(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who has started a stream keeps the place, where all others leave."""
    monkeypatch.setattr("probewatch.tools.openigtlink.server._SETTLED_S", 0.0)
    with ExitStack() as crowd:
        streams = crowd.enter_context(bench.connect())
        streams.ask("STT_TRANS", "ProbeToTracker")
        streams.until("RTS_TRANS")
        asked = [crowd.enter_context(bench.connect()) for _ in range(31)]
        for one in asked:
            one.ask("GET_CAPABIL")
            one.until("CAPABILITY")
        later = [crowd.enter_context(bench.connect()) for _ in range(31)]
        until(lambda: bench.server.turned_away == 31)
        for one in asked:
            until(lambda one=one: _ended(one.line))  # type: ignore[misc]
        for kept in (streams, *later):
            kept.until("STATUS")


def test_a_crowd_of_one_address_keeps_no_other_out(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """However new they are, and though all have started streams; the crowd takes no place of another address."""
    monkeypatch.setattr("probewatch.tools.openigtlink.server._SETTLED_S", 60.0)
    with ExitStack() as crowd:
        for _ in range(32):
            one = crowd.enter_context(bench.connect())
            one.ask("STT_TRANS", "ProbeToTracker")
            one.until("RTS_TRANS")
        with socket.create_connection(bench.server.address, 10, ("127.0.0.2", 0)) as other:
            assert other.recv(1), "it has a place"
            with bench.connect() as late:
                late.line.settimeout(5)
                assert late.line.recv(1) == b""
            assert other.recv(1)


def test_one_who_never_reads_is_dropped_in_time(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("probewatch.tools.openigtlink.server._ASLEEP_S", 0.3)
    with socket.socket() as sleeper:
        sleeper.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
        sleeper.connect(bench.server.address)
        sleeper.sendall(encode(Message("GET_STRING", "", b"")) * 100)
        until(lambda: bench.server.dropped == 1, 20)


def test_a_service_that_never_was_is_named(tmp_path: Path) -> None:
    with StatusWatch(tmp_path / "control", EVERY_S) as watch:
        silence = until(lambda: "no service answers" in (found := watch.seen()).silence and found)
        assert silence.status is None


def test_a_service_that_is_silent_is_told_with_the_start_of_its_own_cart(tmp_path: Path) -> None:
    """Clients read of --config FILE, "with the FILE whose [control] socket this is", where the command had named it."""
    cart = tmp_path / "cart.toml"
    cart.write_text('[control]\nsocket = "control"\n')
    with click.Context(click.Command("x")) as context:
        context.meta[NAMED] = cart
        watch = StatusWatch(tmp_path / "control", EVERY_S)
    with watch:
        silence = until(lambda: "no service answers" in (found := watch.seen()).silence and found).silence
    assert silence.endswith(f"Start it: probewatch run --config {cart}")


@pytest.mark.parametrize("host", ["a..b", "nobody.invalid"])
def test_a_host_that_is_none_is_refused_in_words(bench: Bench, host: str) -> None:
    with pytest.raises(ConfigurationError, match=r"cannot listen there \((?!unknown error|\[Errno)[a-z]"):
        StateServer((host, 0), bench.watch, EVERY_S, Passage(Path("feed"), print))


def test_a_port_in_use_is_refused_by_name(bench: Bench) -> None:
    with pytest.raises(ConfigurationError, match=r"cannot listen there \(address already in use\)"):
        StateServer(bench.server.address, bench.watch, EVERY_S, Passage(Path("feed"), print))
    _, port = bench.server.address
    result = CliRunner().invoke(probewatch, ["openigtlink", "--port", str(port)])
    assert isinstance(result.exception, ConfigurationError)


def test_pictures_and_poses_of_one_name_are_refused() -> None:
    refused = CliRunner().invoke(probewatch, ["openigtlink", "--image", "A", "--pose", "A", "--port", "0"])
    assert refused.exit_code == 2
    assert "--image and --pose are both 'A'" in refused.output


def test_it_listens_at_an_address_of_ipv6_as_page_and_metrics_do(bench: Bench, tmp_path: Path) -> None:
    with (
        Passage(tmp_path / "feed", print) as passage,
        StateServer(("::1", 0), bench.watch, EVERY_S, passage) as server,
    ):
        assert server.address[0] == "::1"
        with socket.create_connection(server.address, 2):
            pass
