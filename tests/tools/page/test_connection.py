"""Who says nothing to the page, or takes nothing from it, keeps no place: a crowd over real sockets."""

import asyncio
import signal
import socket
import threading
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack

import pytest
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route

from probewatch.tools.page import connection, request_body
from probewatch.tools.page.pace import Pace
from tests.support.polling import until
from tests.support.web_page import WebPage
from tests.tools.page.test_page import answering, asked, web

__all__ = ["answering", "web"]

GET = b"GET / HTTP/1.1\r\nHost: x\r\n"
POST = b"POST /body HTTP/1.1\r\nHost: x\r\nContent-Length: 100\r\n\r\n"
Address = tuple[str, int]


async def _endless(_: Request) -> Response:
    async def parts() -> AsyncIterator[bytes]:
        while True:
            yield b"x" * (1 << 20)
            await asyncio.sleep(0)

    return StreamingResponse(parts())


async def _slow(_: Request) -> Response:
    await asyncio.sleep(0.5)
    return PlainTextResponse("slow")


async def _held(request: Request) -> Response:
    while not await request.is_disconnected():
        await asyncio.sleep(0.01)
    return PlainTextResponse("gone")


async def _quick(_: Request) -> Response:
    return PlainTextResponse("quick")


async def _body(request: Request) -> Response:
    return PlainTextResponse(str(await request_body.body_of(request)))


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener


@pytest.fixture
def address(served: uvicorn.Server, listener: socket.socket) -> Address:
    address: Address = listener.getsockname()
    return address


@pytest.fixture
def served(listener: socket.socket, monkeypatch: pytest.MonkeyPatch) -> Iterator[uvicorn.Server]:
    """With a shorter timeout than that of the page."""
    for module, name in ((connection, "_SILENT_S"), (connection, "_ASLEEP_S"), (request_body, "_BODY_S")):
        monkeypatch.setattr(module, name, 0.25)
    routes = [
        Route("/", _slow),
        Route("/quick", _quick),
        *(Route(path, _held) for path in ("/held", connection.EVENTS)),
        Route("/endless", _endless),
        Route("/body", _body, methods=["POST"]),
    ]
    app, kind = Starlette(routes=routes, exception_handlers=request_body.BODY_HANDLERS), connection.Connection
    config = uvicorn.Config(app, http=kind, lifespan="off", log_config=None, timeout_graceful_shutdown=1)
    served = uvicorn.Server(config)
    thread = threading.Thread(target=served.run, kwargs={"sockets": [listener]})
    thread.start()
    yield served
    served.handle_exit(signal.SIGTERM, None)
    thread.join()


def until_the_end(link: socket.socket) -> bytes:
    """All that comes before the server ends it."""
    link.settimeout(10)
    said = b""
    try:
        while data := link.recv(1 << 16):
            said += data
    except ConnectionResetError:
        pass
    return said


@pytest.mark.parametrize("said", [b"", b"GET / HT", GET], ids=["nothing", "part of a line", "part of a head"])
def test_who_does_not_ask_in_time_loses_the_place(address: Address, said: bytes) -> None:
    with socket.create_connection(address) as link:
        link.sendall(said)
        assert until_the_end(link) == b""


def test_who_drips_loses_it_as_well(address: Address) -> None:
    """Each byte comes long before a deadline that it would move."""
    with socket.create_connection(address) as link:
        link.settimeout(0.05)
        ended = False
        while not ended:
            try:
                link.sendall(b"G")
                ended = link.recv(1) == b""
            except TimeoutError:
                continue
            except OSError:
                ended = True


def test_who_has_asked_waits_for_the_answer_and_may_ask_again(address: Address) -> None:
    with socket.create_connection(address, 10) as link:
        for _ in range(2):
            link.sendall(GET + b"\r\n")
            said = b""
            while not said.endswith(b"slow"):
                said += link.recv(1 << 16)
        assert until_the_end(link) == b"", "the deadline begins anew after each answer"


def test_a_body_that_does_not_come_is_refused_as_that(address: Address) -> None:
    with socket.create_connection(address) as link:
        link.sendall(POST)
        said = until_the_end(link)
    assert said.startswith(b"HTTP/1.1 408 ")
    assert b"did not come whole within 0.25 s" in said


@pytest.mark.parametrize(
    ("body", "status", "why"),
    [
        (b'{"token": ', b"400", b"is no JSON object"),
        (b"[1, 2]", b"400", b"is no JSON object"),
        (b"\xff\xfe{", b"400", b"is no JSON object"),
        (b" " * 9000 + b"{}", b"413", b"has more than 8192 bytes"),
        (b"", b"200", b"{}"),
        (b'{"index": 2}', b"200", b"{'index': 2}"),
    ],
)
def test_a_body_that_cannot_be_taken_is_told_by_what_is_wrong(
    address: Address, body: bytes, status: bytes, why: bytes
) -> None:
    """A cut request was told as a wrong token."""
    head = b"POST /body HTTP/1.1\r\nHost: x\r\nConnection: close\r\nContent-Length: %d\r\n\r\n" % len(body)
    with socket.create_connection(address) as link:
        link.sendall(head + body)
        said = until_the_end(link)
    assert said.startswith(b"HTTP/1.1 " + status)
    assert why in said


def test_who_takes_nothing_loses_the_place(served: uvicorn.Server, address: Address) -> None:
    with socket.create_connection(address) as link:
        link.sendall(b"GET /endless HTTP/1.1\r\nHost: x\r\n\r\n")
        assert link.recv(1)
        until(lambda: not served.server_state.connections, 10)


def test_a_crowd_that_says_nothing_keeps_nobody_from_the_page(web: WebPage) -> None:
    host, port = web.address.split(":")
    with ExitStack() as crowd:
        for _ in range(connection.MOST_AT_ONCE + 6):
            crowd.enter_context(socket.create_connection((host, int(port)), 5))
        assert asked(web, "GET", "/").status == 200


def test_a_crowd_that_sends_heads_without_bodies_keeps_nobody_from_it(
    served: uvicorn.Server, address: Address, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bodies may take longer than this test."""
    monkeypatch.setattr(request_body, "_BODY_S", 60.0)
    monkeypatch.setattr(connection.Connection, "most", 3)
    with ExitStack() as crowd:
        for _ in range(3):
            crowd.enter_context(socket.create_connection(address)).sendall(POST)
        until(lambda: len(served.server_state.tasks) == 3)
        with socket.create_connection(address) as link:
            link.sendall(GET + b"Connection: close\r\n\r\n")
            assert until_the_end(link).endswith(b"slow")


def test_who_waits_leaves_for_who_comes_but_not_who_is_told_events(
    served: uvicorn.Server, address: Address, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A crowd that asks for pictures again and again has all places, and always waits for the next picture."""
    monkeypatch.setattr(connection.Connection, "most", 5)
    with ExitStack() as crowd:
        events = _asks(crowd, address, connection.EVENTS)
        until(lambda: len(served.server_state.tasks) == 1)
        waiting = [_asks(crowd, address, "/held") for _ in range(4)]
        until(lambda: len(served.server_state.tasks) == 5)
        for first in waiting[:3]:
            late = _asks(crowd, address, "/held")
            assert until_the_end(first) == b"", "who has waited longest"
            until(lambda: len(served.server_state.tasks) == 5)
        with socket.create_connection(address) as link:
            link.sendall(b"GET /quick HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
            assert until_the_end(link).endswith(b"quick")
        for kept in (events, late):
            kept.setblocking(False)
            with pytest.raises(BlockingIOError):
                kept.recv(1)


def test_a_crowd_takes_no_place_of_another_address(
    served: uvicorn.Server, address: Address, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connection.Connection, "most", 5)
    with ExitStack() as crowd:
        other = crowd.enter_context(socket.create_connection(address, 10, ("127.0.0.2", 0)))
        other.sendall(b"GET /held HTTP/1.1\r\nHost: x\r\n\r\n")
        until(lambda: len(served.server_state.tasks) == 1)
        for _ in range(12):
            _asks(crowd, address, "/held")
        until(lambda: len(served.server_state.connections) == 5)
        other.setblocking(False)
        with pytest.raises(BlockingIOError):
            other.recv(1)


def _asks(links: ExitStack, address: Address, path: str) -> socket.socket:
    link = links.enter_context(socket.create_connection(address))
    link.sendall(f"GET {path} HTTP/1.1\r\nHost: x\r\n\r\n".encode())
    return link


def test_a_connection_that_asks_without_pause_is_answered_at_the_pace_of_its_address(
    served: uvicorn.Server, address: Address, monkeypatch: pytest.MonkeyPatch
) -> None:
    """20 a second, after 20 at once: 30 take half a second or more, 20 of another address meanwhile need not."""
    monkeypatch.setattr(connection.Connection, "pace", Pace(20.0))
    began_s = time.monotonic()
    with socket.create_connection(address) as link:
        link.sendall(b"GET /quick HTTP/1.1\r\nHost: x\r\n\r\n" * 30)
        with socket.create_connection(address, 10, ("127.0.0.2", 0)) as other:
            other.sendall(b"GET /quick HTTP/1.1\r\nHost: x\r\n\r\n")
            assert other.recv(1)
        said = b""
        while said.count(b"quick") < 30:
            said += link.recv(1 << 16)
    assert time.monotonic() - began_s >= 0.5 - 0.05


def test_an_address_has_its_answers_evenly_spaced_and_some_at_once() -> None:
    pace = Pace(10.0)
    assert [pace.wait_s("a", 100.0) for _ in range(10)] == [0.0] * 10
    assert [round(pace.wait_s("a", 100.0), 6) for _ in range(3)] == [0.1, 0.2, 0.3]
    assert max(pace.wait_s("a", 100.0) for _ in range(5000)) == pytest.approx(0.4), "whoever leaves again adds nothing"
    assert pace.wait_s("b", 100.0) == 0.0
    assert pace.wait_s("a", 100.5) == 0.0
    for number in range(5000):
        pace.wait_s(f"other {number}", 100.0 + number)
    assert len(pace._next_s) <= 1001
