"""Who says nothing to the page, or takes nothing from it, keeps no place: a crowd over real sockets."""

import asyncio
import signal
import socket
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack

import pytest
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route

from tests.support.polling import until
from tests.support.web_page import WebPage
from tests.tools.page.test_page import answering, asked, web
from tools.commands.page import _MOST_AT_ONCE
from tools.page import connection, server

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


async def _body(request: Request) -> Response:
    return PlainTextResponse(str(await server._body(request)))


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
    """With less patience than the page has."""
    for module, name in ((connection, "_SILENT_S"), (connection, "_ASLEEP_S"), (server, "_BODY_S")):
        monkeypatch.setattr(module, name, 0.25)
    routes = [Route("/", _slow), Route("/endless", _endless), Route("/body", _body, methods=["POST"])]
    app, kind = Starlette(routes=routes), connection.Connection
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


def test_a_body_that_does_not_come_is_none(address: Address) -> None:
    with socket.create_connection(address) as link:
        link.sendall(POST)
        assert until_the_end(link).endswith(b"{}")


def test_who_takes_nothing_loses_the_place(served: uvicorn.Server, address: Address) -> None:
    with socket.create_connection(address) as link:
        link.sendall(b"GET /endless HTTP/1.1\r\nHost: x\r\n\r\n")
        assert link.recv(1)
        until(lambda: not served.server_state.connections, 10)


def test_a_crowd_that_says_nothing_keeps_nobody_from_the_page(web: WebPage) -> None:
    host, port = web.address.split(":")
    with ExitStack() as crowd:
        for _ in range(_MOST_AT_ONCE + 6):
            crowd.enter_context(socket.create_connection((host, int(port)), 5))
        assert asked(web, "GET", "/").status == 200


def test_a_crowd_that_sends_heads_without_bodies_keeps_nobody_from_it(
    served: uvicorn.Server, address: Address, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bodies may take longer than this test."""
    monkeypatch.setattr(server, "_BODY_S", 60.0)
    served.config.limit_concurrency = 4
    with ExitStack() as crowd:
        for _ in range(3):
            crowd.enter_context(socket.create_connection(address)).sendall(POST)
        until(lambda: len(served.server_state.tasks) == 3)
        with socket.create_connection(address) as link:
            link.sendall(GET + b"Connection: close\r\n\r\n")
            assert until_the_end(link).endswith(b"slow")
