"""The HTTP side and the file, over real sockets: hostile and sleeping clients keep nobody out."""

import contextlib
import html
import http.client
import platform
import signal
import socket
import stat
import subprocess
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.printable import printable
from probewatch.tools.cli import probewatch
from probewatch.tools.monitoring.endpoint import Endpoint
from probewatch.tools.monitoring.reading import Exposition
from probewatch.tools.shared.listen_address import listen_address
from tests.support.answering import Answering
from tests.support.demo_cart import PROBEWATCH
from tests.support.polling import until
from tests.support.stopwatch import Stopwatch

HOSTILE = [
    b"",
    b"GET",
    b"\0" * 5000,
    b"GET /metrics HTTP/9.9\r\n\r\n",
    b"POST /metrics HTTP/1.0\r\n\r\n",
    b"A" * 100_000,
]


@pytest.fixture
def endpoint(tmp_path: Path) -> Iterator[Endpoint]:
    text = Exposition(tmp_path / "control").text
    with Answering(tmp_path / "control"), Endpoint("127.0.0.1", 0, text, ["Cart-2.example"]) as endpoint:
        yield endpoint


def asked(endpoint: Endpoint, path: str = "/metrics") -> str:
    with urllib.request.urlopen(f"http://127.0.0.1:{endpoint.server_address[1]}{path}", timeout=10) as reply:
        assert reply.headers["Content-Type"].startswith("text/plain; version=")
        return str(reply.read().decode())


def test_what_prometheus_gets(endpoint: Endpoint) -> None:
    assert "\nprobewatch_contact_closed 1.0\n" in asked(endpoint)
    with pytest.raises(urllib.error.HTTPError, match="404"):
        asked(endpoint, "/")


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("evil.example", 403),
        ("[::1]evil.example", 403),
        ("127.0.0.1.evil.example", 403),
        ("localhost:1:evil", 403),
        ("", 403),
        ("localhost:9797", 200),
        ("10.1.2.3:9797", 200),
        ("[fe80::1]:9797", 200),
        ("cart-2.example", 200),
        (platform.node(), 200),
    ],
)
def test_it_answers_to_addresses_and_to_its_own_names(endpoint: Endpoint, host: str, status: int) -> None:
    link = http.client.HTTPConnection(*endpoint.server_address[:2], timeout=10)
    with contextlib.closing(link):
        link.request("GET", "/metrics", headers={"Host": host})
        assert link.getresponse().status == status


@pytest.mark.parametrize("host", ["evil.example", "\xff\xfe\x1b[31m" + "x" * 300, "<b>"])
def test_it_says_by_which_name_it_was_called(endpoint: Endpoint, host: str) -> None:
    with socket.create_connection(endpoint.server_address[:2], 10) as link:
        link.sendall(b"GET /metrics HTTP/1.1\r\nHost: " + host.encode("latin-1") + b"\r\n\r\n")
        answer = b"".join(iter(lambda: link.recv(4096), b"")).decode()
    assert "403 this exporter is not called by that name" in answer
    assert f"Host {html.escape(printable(host, 100), quote=False)}" in answer


def test_who_names_no_host_is_no_browser(endpoint: Endpoint) -> None:
    with socket.create_connection(endpoint.server_address[:2], 10) as link:
        link.sendall(b"GET /metrics HTTP/1.0\r\n\r\n")
        assert link.recv(12) == b"HTTP/1.0 200"


def test_sleepers_and_hostile_clients_keep_nobody_out(endpoint: Endpoint) -> None:
    address = endpoint.server_address[:2]
    links = [socket.create_connection(address) for _ in range(60)]
    for number, link in enumerate(links):
        with contextlib.suppress(OSError):  # ended already, to make room
            link.sendall(HOSTILE[number % len(HOSTILE)])
    watch = Stopwatch()
    assert "probewatch_up 1.0" in asked(endpoint)
    assert watch.spent_s() < 5
    until(lambda: threading.active_count() < 40)
    for link in links:
        link.close()


def test_a_crowd_that_asks_keeps_nobody_from_an_answer() -> None:
    """All places wait for the service when one more asks; nobody of them is ended for it."""
    answers = threading.Event()

    def text() -> bytes:
        answers.wait(20)
        return b"answered"

    with Endpoint("127.0.0.1", 0, text) as endpoint, contextlib.ExitStack() as crowd:
        links = []
        for _ in range(17):
            link = crowd.enter_context(socket.create_connection(endpoint.server_address[:2], 10))
            link.sendall(b"GET /metrics HTTP/1.0\r\n\r\n")
            links.append(link)
        until(lambda: sum(client.asked for client in endpoint._open.values()) == 16)
        answers.set()
        for link in links:
            with link.makefile("rb") as said:
                assert said.read().endswith(b"answered")


def test_an_address_that_is_taken_is_refused(endpoint: Endpoint) -> None:
    with pytest.raises(ConfigurationError, match=r"cannot listen there \(address already in use\)"):
        Endpoint("127.0.0.1", endpoint.server_address[1], bytes)


@pytest.mark.parametrize("listen", ["", "9797", "localhost", "a:b", "a:70000", ":1", "a:\u0663"])
def test_what_is_no_address_is_refused(listen: str) -> None:
    with pytest.raises(ConfigurationError, match="HOST:PORT"):
        listen_address(listen, "127.0.0.1:9797")


def test_an_ipv6_address() -> None:
    assert listen_address("[::1]:9797", "127.0.0.1:9797") == ("::1", 9797)


def run(*arguments: object) -> "subprocess.Popen[str]":
    command = [str(PROBEWATCH), "metrics", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.thorough
def test_the_file_for_node_exporter_is_whole_and_goes_with_its_writer(tmp_path: Path) -> None:
    file = tmp_path / "textfile" / "probewatch.prom"
    file.parent.mkdir()
    with Answering(tmp_path / "control") as service:
        program = run("--socket", tmp_path / "control", "--no-http", "--textfile", file, "--every", 1)
        try:
            until(file.exists, 60)
            text = file.read_text()
            assert text.startswith("# HELP probewatch_up ")
            assert "probewatch_contact_closed 1.0\n" in text
            assert text.endswith("\n")
            assert stat.S_IMODE(file.stat().st_mode) == 0o644, "node_exporter is another user"
            service.mute = True
            until(lambda: "probewatch_up 0.0\n" in file.read_text(), 20)
            assert "contact_closed" not in file.read_text()
            assert [*file.parent.iterdir()] == [file]
        finally:
            program.send_signal(signal.SIGTERM)
            said = program.communicate(timeout=20)
    assert (program.returncode, said) == (0, ("", ""))
    assert not file.exists()


def test_it_says_where_it_serves_and_ends_by_ctrl_c(tmp_path: Path) -> None:
    program = run("--listen", "127.0.0.1:0", "--socket", tmp_path / "nobody")
    assert program.stdout is not None
    said = program.stdout.readline().strip()
    with urllib.request.urlopen(said, timeout=10) as answer:
        assert b"probewatch_up 0.0" in answer.read()
    program.send_signal(signal.SIGINT)
    rest, told = program.communicate(timeout=20)
    assert (program.returncode, rest, said.endswith("/metrics")) == (0, "", True)
    assert told.startswith(f"{tmp_path / 'nobody'}: no service answers (No such file or directory). Start it: ")


def test_once_without_a_service(tmp_path: Path) -> None:
    program = run("--once", "--socket", tmp_path / "nobody")
    out, err = program.communicate(timeout=60)
    assert (program.returncode, err) == (69, "")
    assert "\nprobewatch_up 0.0\n" in out


@pytest.mark.parametrize("host", ["a..b", "nobody.invalid"])
def test_a_host_that_is_none_is_refused_in_words(host: str) -> None:
    with pytest.raises(ConfigurationError, match=r"cannot listen there \((?!\[Errno)[a-z]"):
        Endpoint(host, 0, bytes)


def test_once_writes_no_file_and_says_so(tmp_path: Path) -> None:
    typed = ["metrics", "--once", "--textfile", str(tmp_path / "x.prom"), "--socket", str(tmp_path / "nobody")]
    ended = CliRunner().invoke(probewatch, typed)
    assert "--once prints and ends, and writes no --textfile" in ended.output
    assert ended.exit_code == 2


@pytest.mark.parametrize("name", ["x.txt", "x", "x.prom.new"])
def test_a_file_that_node_exporter_passes_over_is_refused(tmp_path: Path, name: str) -> None:
    """It was written, and nobody saw why its values were missing."""
    typed = ["metrics", "--no-http", "--textfile", str(tmp_path / name), "--socket", str(tmp_path / "nobody")]
    refused = CliRunner().invoke(probewatch, typed)
    assert isinstance(refused.exception, ConfigurationError), refused.output
    assert refused.exception.remedy in ("Name it x.prom", "Name it x.prom.prom")


def test_nothing_to_do_is_refused(tmp_path: Path) -> None:
    program = run("--no-http")
    assert "needs --textfile" in program.communicate(timeout=60)[1]
    assert program.returncode == 2


@pytest.mark.parametrize(
    ("typed", "what"),
    [
        (("--once", "--listen", "127.0.0.1:1"), "--listen has no effect with --once"),
        (("--once", "--every", "30"), "--every has no effect with --once"),
        (("--no-http", "--textfile", "x.prom", "--host", "cart-2"), "--host has no effect with --no-http"),
    ],
)
def test_an_option_without_effect_is_refused(typed: tuple[str, ...], what: str) -> None:
    ended = CliRunner().invoke(probewatch, ["metrics", *typed])
    assert (ended.exit_code, what in ended.output) == (2, True)
