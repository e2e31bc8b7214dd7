"""Serves the web page: files, events and pictures for everybody who may reach it, requests for those who have redeemed
a token.

It is one process, with one thread for the network; whatever asks the service or the disk does so in another. Nothing is
loaded from elsewhere, and nothing on the page runs but its own files (Content-Security-Policy).
"""

import asyncio
import html
import json
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import Receive, Scope, Send

from probewatch.drivers.errors import ProbewatchError
from probewatch.drivers.printable import printable_value
from probewatch.tools.page.alarm_log_watch import AlarmLogWatch
from probewatch.tools.page.asking import REQUESTS, Asking
from probewatch.tools.page.connection import EVENTS, MOST_LISTENERS
from probewatch.tools.page.guard import Guard
from probewatch.tools.page.pictures import Pictures, jpeg
from probewatch.tools.page.request_body import BODY_HANDLERS, body_of, refused
from probewatch.tools.page.room import room
from probewatch.tools.page.scan_requests import ACTS
from probewatch.tools.page.tokens import Tokens, Visitor
from probewatch.tools.page.wording import worded
from probewatch.tools.recalibration.held_service import Asked
from probewatch.tools.recalibration.session import ScanSession
from probewatch.tools.shared.gesture_drawings import DRAWINGS
from probewatch.tools.shared.status_watch import StatusWatch

_FILES = (Path(__file__).parent / "files", DRAWINGS)
_KINDS = {".html": "text/html; charset=utf-8", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
_COOKIE = "probewatch"
_EVENTS_S = 0.25
"""Seconds between two events: seen as motion, the pace of `probewatch status --watch`."""
_PICTURE_S = 2.0
"""Seconds for which a request for a newer picture waits before it is answered with none. Longer makes a dead picture
look alive; shorter asks more often for nothing."""
_LOOK_S = 0.02
"""Seconds between two looks for a newer picture: a fifth of the time between two at ten a second."""
TOKEN_COMMAND = "probewatch page --token"
"""Command that gives a token of the page that the package starts. The files of the page contain it."""
_MOST_DIGITS = 9
"""Digits of the number of a view. Python refuses to read more than 4300, which would be an error of this server."""


@dataclass(frozen=True, slots=True)
class Parts:
    """Holds what the page is made of. cart: its name. hosts: names and addresses by which it may be called, no port.
    token_command: what a person types in a terminal of the cart for a token.
    """

    watch: StatusWatch
    pictures: Pictures
    session: ScanSession
    alarms: AlarmLogWatch
    asking: Asking
    tokens: Tokens
    cart: str
    hosts: frozenset[str]
    token_command: str = TOKEN_COMMAND


@dataclass(eq=False, slots=True)
class _Listener:
    """Represents a browser that is sent events."""

    address: str
    sent_away: bool = False


class Page:
    """Answers the requests of browsers. app: the application for an ASGI server."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        found = [path for folder in _FILES for path in sorted(folder.iterdir()) if path.suffix in _KINDS]
        self._files = {path.name: path.read_bytes() for path in found}
        for name in ("status.html", "recalibrate.html"):
            command = html.escape(parts.token_command).encode()
            self._files[name] = self._files[name].replace(TOKEN_COMMAND.encode(), command)
        self._no_token = f"a token is needed: {parts.token_command} gives one"
        self._listeners: list[_Listener] = []
        self._language = "en"  # of the room, as the service last reported it
        routes = [
            Route("/", self._file),
            Route("/recalibrate", self._file),
            Route("/files/{name}", self._file),
            Route(EVENTS, self._events),
            Route("/picture", self._picture),
            Route("/view/{index}", self._view),
            Route("/token", self._token, methods=["POST"]),
            Route("/request/{what}", self._request, methods=["POST"]),
            Route("/recalibration/{what}", self._recalibration, methods=["POST"]),
        ]
        self.app = Guard(Starlette(routes=routes, exception_handlers=BODY_HANDLERS), parts.hosts)

    async def _file(self, request: Request) -> Response:
        names = {"/": "status.html", "/recalibrate": "recalibrate.html"}
        name = names.get(request.url.path, request.path_params.get("name", ""))
        content = self._files.get(name)
        if content is None:
            return Response("there is no such file\n", 404, media_type="text/plain")
        return Response(content, media_type=_KINDS[Path(name).suffix])

    async def _events(self, request: Request) -> Response:
        listener = _Listener(_address(request))
        if not self._has_place(listener):
            return Response("too many look on; close one of them\n", 503, media_type="text/plain")
        self._listeners.append(listener)
        self._parts.watch.want(len(self._listeners))
        headers = {"Cache-Control": "no-store", "X-Accel-Buffering": "no"}
        return _Counted(
            self._event_stream(request, listener), lambda: self._forget(listener), "text/event-stream", headers
        )

    def _has_place(self, listener: _Listener) -> bool:
        """Returns whether there is a place; one of an address that has two more than the newcomer's is disconnected for
        it, where there is one.
        """
        if len(self._listeners) < MOST_LISTENERS:
            return True
        held = Counter(one.address for one in self._listeners)
        greedy, places = held.most_common(1)[0]
        if places < held[listener.address] + 2:
            return False
        leaves = next(one for one in reversed(self._listeners) if one.address == greedy)
        leaves.sent_away = True
        self._forget(leaves)
        return True

    def _forget(self, listener: _Listener) -> None:
        if listener in self._listeners:
            self._listeners.remove(listener)
            self._parts.watch.want(len(self._listeners))

    async def _event_stream(self, request: Request, listener: _Listener) -> AsyncIterator[bytes]:
        while not (listener.sent_away or await request.is_disconnected()):
            event = await run_in_threadpool(self._event, self._visitor(request))
            yield b"data: " + json.dumps(event, ensure_ascii=False).encode() + b"\n\n"
            await asyncio.sleep(_EVENTS_S)

    def _event(self, visitor: Visitor | None) -> dict[str, Any]:
        """Returns everything that the page shows except its pictures."""
        parts = self._parts
        if visitor is not None:
            parts.session.attendance.look_on()
        seen = parts.watch.seen()
        status = seen.status
        state = None if status is None else (status["state"], status["since_s"] < 1.0)
        if status is not None:
            self._language = status.get("language", "en")
        event = {
            "cart": parts.cart,
            "told_s": seen.t_ns / 1e9,
            "clock": datetime.now().astimezone().isoformat(timespec="seconds"),
            "status": status,
            "room": None if status is None else room(status),
            "silence": seen.silence,
            "alarms": parts.alarms.fields(state),
            "recalibration": parts.session.fields(),
            "picture_trouble": parts.pictures.trouble,
            "visitor": None if visitor is None else visitor.name,
        }
        found = printable_value(worded(event, self._language))
        assert isinstance(found, dict)
        return found

    async def _picture(self, request: Request) -> Response:
        """Answers with a picture that is not number `after`; with 204 where none came in time."""
        after = request.query_params.get("after", "0")
        known = int(after) if after.isascii() and after.isdecimal() and len(after) < 16 else 0
        end_s = time.monotonic() + _PICTURE_S
        while (newest := self._parts.pictures.newest(self._parts.session.looked_ns)) is None or newest.number == known:
            if time.monotonic() > end_s or await request.is_disconnected():
                return Response(None, 204)
            await asyncio.sleep(_LOOK_S)
        look = await run_in_threadpool(self._parts.session.look_at, newest.t_ns)
        headers = {
            "Cache-Control": "no-store",
            "X-Number": str(newest.number),
            "X-Taken-S": f"{newest.t_ns / 1e9:.3f}",
            "X-Look": json.dumps(look),
        }
        return Response(newest.jpeg, media_type="image/jpeg", headers=headers)

    async def _view(self, request: Request) -> Response:
        """Answers with what was around the crossing of one view."""
        index = request.path_params["index"]
        known = index.isascii() and index.isdecimal() and len(index) <= _MOST_DIGITS
        image = self._parts.session.thumbnail(int(index)) if known else None
        if image is None:
            return Response("there is no such view\n", 404, media_type="text/plain")
        return Response(jpeg(image), media_type="image/jpeg", headers={"Cache-Control": "no-store"})

    async def _token(self, request: Request) -> Response:
        """Turns a one-time token into a cookie that no script can read and no other site can send."""
        now_s = time.monotonic()
        body = await body_of(request)
        address = _address(request)
        if self._parts.tokens.locked(now_s, address):
            return refused("too many wrong tokens; wait a minute", 429)
        cookie = self._parts.tokens.redeem(str(body.get("token", "")), now_s, address)
        if cookie is None:
            command = self._parts.token_command
            return refused(f"the token is wrong, was used, or is too old: {command} gives another", 403)
        response = JSONResponse({"ok": True})
        response.set_cookie(_COOKIE, cookie, httponly=True, samesite="strict", path="/")
        return response

    async def _request(self, request: Request) -> Response:
        """Answers a request that the service carries out at once."""
        visitor, what = self._visitor(request), request.path_params["what"]
        if visitor is None:
            return refused(self._no_token, 403)
        if what not in REQUESTS:
            return refused("there is no such request", 404)
        return await _done(self._parts.asking.ask, what, visitor.name)

    async def _recalibration(self, request: Request) -> Response:
        """Answers every request that changes something of a scan."""
        if self._visitor(request) is None:
            return refused(self._no_token, 403)
        act = ACTS.get(request.path_params["what"])
        if act is None:
            return refused("there is no such request", 404)
        body = await body_of(request)
        self._parts.session.attendance.touch()
        return await _done(act, self._parts.session, body)

    def _visitor(self, request: Request) -> Visitor | None:
        return self._parts.tokens.visitor(request.cookies.get(_COOKIE), time.monotonic())


async def _done(act: Callable[..., None], *words: object) -> Response:
    """Carries out a request, and answers with its outcome: done, a question, or why not."""
    try:
        await run_in_threadpool(act, *words)
    except Asked as question:
        return JSONResponse({"ok": False, "ask": question.text}, 409)
    except ProbewatchError as error:
        parts = [text for text in (error.where, error.what, error.remedy) if text]
        return JSONResponse({"ok": False, "error": str(error), "parts": parts}, 409)
    return JSONResponse({"ok": True})


class _Counted(StreamingResponse):
    """Streams events. ended: called once, also where the client has gone before its stream begins."""

    def __init__(
        self, told: AsyncIterator[bytes], ended: Callable[[], None], media_type: str, headers: dict[str, str]
    ) -> None:
        super().__init__(told, media_type=media_type, headers=headers)
        self._ended = ended

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._ended()


def _address(request: Request) -> str:
    """Returns the address of the client; it is one for all that come through a proxy."""
    return "" if request.client is None else request.client.host
