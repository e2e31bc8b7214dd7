"""The control socket against well-behaved and hostile clients, over real sockets."""

import contextlib
import json
import socket
import stat
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.service.control.server import ControlRefused, ControlServer, Peer
from probewatch.drivers.errors import ConfigurationError, DeviceLost


class Service:
    """A tick that does nothing but serve; asked holds what reached it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.asked: list[tuple[str, dict[str, Any]]] = []
        self.slowest_s = 0.0
        self._end = threading.Event()
        self.server = ControlServer(path)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        self.asked.append((do, request))
        if do == "echo":
            return {"text": request["text"]}
        if do == "acknowledge":
            raise ControlRefused("the cause still stands (polarity)")
        return {"status": {"state": "monitoring", "checks": "x" * 20_000 * ("long" in request)}}

    def _run(self) -> None:
        while not self._end.wait(0.002):
            start_s = time.thread_time()
            self.server.poll(self.answer)
            self.slowest_s = max(self.slowest_s, time.thread_time() - start_s)

    def close(self) -> None:
        self._end.set()
        self._thread.join()
        self.server.close()


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    service = Service(tmp_path / "control")
    yield service
    service.close()


def connected(service: Service) -> socket.socket:
    link = socket.socket(socket.AF_UNIX)
    link.connect(str(service.path))
    link.settimeout(5)
    return link


def test_status_and_requests(service: Service, tmp_path: Path) -> None:
    with ControlClient(service.path) as client:
        assert client.status()["state"] == "monitoring"
        client.begin_recalibration()
        client.end_recalibration(tmp_path / "new.toml")
        client.abort_recalibration()
    assert [do for do, _ in service.asked] == [
        "status",
        "begin-recalibration",
        "end-recalibration",
        "abort-recalibration",
    ]
    assert service.asked[2][1]["file"] == str(tmp_path / "new.toml")


def test_a_refusal_gives_its_reason(service: Service) -> None:
    with ControlClient(service.path) as client, pytest.raises(ControlRefused, match="the cause still stands"):
        client.acknowledge()


def test_the_socket_is_for_user_and_group_only_and_goes_with_the_service(tmp_path: Path) -> None:
    with ControlServer(tmp_path / "control"):
        assert stat.S_IMODE((tmp_path / "control").stat().st_mode) == 0o660
    assert not (tmp_path / "control").exists()


def test_only_its_owner_may_open_the_lock(tmp_path: Path) -> None:
    """Whoever can open it can hold it, and no service starts; the group of the socket could, in an earlier version."""
    lock = tmp_path / "control.lock"
    lock.touch(0o660)
    lock.chmod(0o660)
    with ControlServer(tmp_path / "control"):
        assert lock.stat().st_mode & 0o777 == 0o600


def test_a_second_service_is_refused_and_the_first_unharmed(service: Service) -> None:
    with pytest.raises(DeviceLost, match="another probewatch service is running"):
        ControlServer(service.path)
    with ControlClient(service.path) as client:
        assert client.status()


def test_a_socket_left_by_a_killed_service_is_no_obstacle(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(tmp_path / "control"))
    with ControlServer(tmp_path / "control"):
        pass


def test_a_folder_that_is_missing_is_a_configuration_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="No such file"):
        ControlServer(tmp_path / "nowhere" / "control")


def test_no_service_is_said_so(tmp_path: Path) -> None:
    with pytest.raises(DeviceLost, match="no service answers"):
        ControlClient(tmp_path / "control")
    with pytest.raises(DeviceLost, match="too long"):
        ControlClient(tmp_path / ("x" * 100))


@pytest.mark.parametrize("line", [b"[]", b'{"do": "status"}', b'{"v": 2, "do": "status"}', b"\xff\xfe", b"[" * 3000])
def test_nonsense_is_answered_as_such(service: Service, line: bytes) -> None:
    with connected(service) as link:
        link.sendall(line + b"\n")
        reply = json.loads(link.makefile("rb").readline())
    assert (reply["v"], reply["ok"]) == (1, False)
    assert service.asked == []


@pytest.mark.parametrize(
    ("line", "says"),
    [
        (b'{"v": 0, "do": "status"}', "version 1 is spoken here, and the request says v = 0"),
        (b'{"v": "1", "do": "status"}', "says v = '1'"),
        (b'{"v": true, "do": "status"}', "says v = True"),
        (b'{"do": "status"}', "a request is a JSON object with v = 1"),
        (b'{"v": 1}', '"do" must name a request'),
        (b'{"v": 1, "do": 3}', '"do" must name a request'),
        (b'{"v": 1, "do": "status", "do": "echo"}', "the field 'do' is given twice"),
        (b'{"v": 1, "do": "echo", "seconds": NaN}', "not JSON: it has no NaN"),
        (b"hello", "the line is not JSON"),
        (b'{"v": 1, "do": "status"}' + b" " * 4096, "a request has at most 4096 bytes"),
    ],
)
def test_what_a_request_lacks_is_said(service: Service, line: bytes, says: str) -> None:
    with connected(service) as link:
        link.sendall(line + b"\n")
        assert says in json.loads(link.makefile("rb").readline())["error"]
    assert service.asked == []


def test_a_lone_surrogate_is_answered_and_harms_nobody(service: Service) -> None:
    """JSON can name what no UTF-8 text can hold."""
    with connected(service) as link, link.makefile("rb") as lines:
        link.sendall(b'{"v": 1, "do": "echo", "text": "\\ud800"}\n')
        assert json.loads(lines.readline())["text"] == "\N{REPLACEMENT CHARACTER}"
    with ControlClient(service.path) as client:
        assert client.status()


def test_slow_answers_to_many_clients_are_spread_over_ticks_and_each_gets_its_turn(tmp_path: Path) -> None:
    answered = list[str]()

    def slow(do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        answered.append(do)
        time.sleep(0.02)
        return {}

    with ControlServer(tmp_path / "control") as server, contextlib.ExitStack() as stack:
        for number in range(8):
            link = stack.enter_context(contextlib.closing(socket.socket(socket.AF_UNIX)))
            link.connect(str(tmp_path / "control"))
            link.sendall(b'{"v": 1, "do": "%d"}\n' % number * 3)
        for ticks in range(1, 17):
            server.poll(slow)
            assert len(answered) <= ticks
    assert answered == [str(number) for number in range(8)] * 2


def test_what_is_no_socket_is_not_removed(tmp_path: Path) -> None:
    (tmp_path / "control").write_text("precious")
    with pytest.raises(ConfigurationError, match="another file"):
        ControlServer(tmp_path / "control")
    assert (tmp_path / "control").read_text() == "precious"


def flood(link: socket.socket, chunk: bytes, megabytes: int = 8) -> None:
    for _ in range(megabytes * 1_000_000 // len(chunk)):
        link.sendall(chunk)


def test_an_endless_line_is_cut_off(service: Service) -> None:
    with connected(service) as link, pytest.raises((BrokenPipeError, ConnectionResetError)):
        flood(link, b"x" * 4096)


def test_a_client_that_never_reads_is_dropped_and_harms_nobody(service: Service) -> None:
    with connected(service) as deaf, ControlClient(service.path) as client:
        with pytest.raises((BrokenPipeError, ConnectionResetError)):
            flood(deaf, b'{"v": 1, "do": "status", "long": 1}\n')
        assert client.status()


def test_two_hundred_idle_clients_do_not_keep_a_person_out(service: Service) -> None:
    with contextlib.ExitStack() as stack:
        for _ in range(200):
            stack.enter_context(contextlib.closing(connected(service)))
        with ControlClient(service.path) as client:
            assert client.status()["state"] == "monitoring"
        assert service.server.dropped_clients >= 200 + 1 - 32
    assert service.slowest_s < 0.05


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(line=st.binary(max_size=300))
def test_no_bytes_harm_the_service(service: Service, line: bytes) -> None:
    with connected(service) as link:
        link.sendall(line + b"\n")
        assert link.recv(1), "every line is answered"
    with ControlClient(service.path) as client:
        assert client.status()


def answered_at(server: ControlServer, link: socket.socket, most: int) -> int:
    """Which poll answered a client that has asked; 0 where none of so many did."""
    link.setblocking(False)
    for poll in range(1, most + 1):
        server.poll(lambda do, request, who: {"status": {}})
        with contextlib.suppress(BlockingIOError):
            return poll if link.recv(1 << 16) else 0
    return 0


@pytest.mark.parametrize("before", [0, 4, 20, 33, 36, 50, 100])
def test_who_asks_among_idlers_is_answered_before_anyone_takes_the_place(tmp_path: Path, before: int) -> None:
    """All are in the queue of the kernel when the tick comes; whoever is accepted in the same tick may not push out."""
    with ControlServer(tmp_path / "control") as server, contextlib.ExitStack() as stack:

        def connect() -> socket.socket:
            link = stack.enter_context(contextlib.closing(socket.socket(socket.AF_UNIX)))
            link.setblocking(False)
            link.connect(str(tmp_path / "control"))
            return link

        for _ in range(before):
            connect()
        asking = connect()
        asking.sendall(b'{"v": 1, "do": "status"}\n')
        for _ in range(100 - before):
            connect()
        assert answered_at(server, asking, 60) >= 1


def test_the_room_of_a_tick_is_kept_however_many_come(tmp_path: Path) -> None:
    with ControlServer(tmp_path / "control") as server, contextlib.ExitStack() as stack:
        longest_s = 0.0
        for _ in range(5):
            for _ in range(200):
                link = stack.enter_context(contextlib.closing(socket.socket(socket.AF_UNIX)))
                link.setblocking(False)
                link.connect(str(tmp_path / "control"))
            began_s = time.thread_time()
            server.poll(lambda do, request, who: {"status": {}})
            longest_s = max(longest_s, time.thread_time() - began_s)
        assert longest_s < 0.025


def test_who_asks_now_and_then_keeps_the_place_while_others_come_and_say_nothing(tmp_path: Path) -> None:
    with ControlServer(tmp_path / "control") as server, contextlib.ExitStack() as stack:
        watching = stack.enter_context(contextlib.closing(socket.socket(socket.AF_UNIX)))
        watching.connect(str(tmp_path / "control"))
        for _ in range(10):
            watching.setblocking(True)
            watching.sendall(b'{"v": 1, "do": "status"}\n')
            assert answered_at(server, watching, 60)
            for _ in range(60):
                link = stack.enter_context(contextlib.closing(socket.socket(socket.AF_UNIX)))
                link.connect(str(tmp_path / "control"))
            for _ in range(20):
                server.poll(lambda do, request, who: {})
        assert server.dropped_clients >= 10 * 60 - 32


class Crowd:
    """Clients that always have the next request waiting, and come again when they are sent away."""

    def __init__(self, path: Path, size: int) -> None:
        self._path = path
        self.links = [self._connected() for _ in range(size)]

    def press(self) -> None:
        for place, link in enumerate(self.links):
            try:
                with contextlib.suppress(BlockingIOError):
                    link.send(b'{"v": 1, "do": "status"}\n' * 40)
            except OSError:
                link.close()
                self.links[place] = self._connected()

    def _connected(self) -> socket.socket:
        link = socket.socket(socket.AF_UNIX)
        link.setblocking(False)
        link.connect(str(self._path))
        link.send(b'{"v": 1, "do": "status"}\n' * 40)
        return link

    def close(self) -> None:
        for link in self.links:
            link.close()


def test_a_crowd_that_always_asks_keeps_nobody_waiting(tmp_path: Path) -> None:
    """One who comes is answered within four ticks, and keeps the place; who comes and asks once as well."""
    with (
        ControlServer(tmp_path / "control") as server,
        contextlib.closing(Crowd(tmp_path / "control", 40)) as crowd,
        socket.socket(socket.AF_UNIX) as staying,
    ):

        def polls_until_answered(link: socket.socket) -> int:
            link.send(b'{"v": 1, "do": "acknowledge"}\n')
            polls = 0
            while polls < 20:
                crowd.press()
                polls += 1
                if answered_at(server, link, 1):
                    break
            return polls

        for _ in range(5):
            server.poll(lambda do, request, who: {})
            crowd.press()
        staying.connect(str(tmp_path / "control"))
        assert polls_until_answered(staying) <= 4
        for _ in range(10):
            with socket.socket(socket.AF_UNIX) as link:
                link.connect(str(tmp_path / "control"))
                assert polls_until_answered(link) <= 4
            assert polls_until_answered(staying) <= 4
