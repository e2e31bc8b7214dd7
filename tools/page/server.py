"""The web page: files, events and pictures for everybody who may reach it, requests for who has redeemed a token.

One process, one thread for the network; whatever asks the service or the disk does so in another. Nothing is loaded
from elsewhere, and nothing on the page runs but its own files (Content-Security-Policy).
"""

import asyncio
import json
import time
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import Route
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from drivers.errors import ProbewatchError
from drivers.printable import printable, printable_value
from tools.page.alarm_log_watch import AlarmLogWatch
from tools.page.asking import REQUESTS, Asking
from tools.page.connection import EVENTS, MOST_LISTENERS
from tools.page.pictures import Pictures, jpeg
from tools.page.room import room
from tools.page.tokens import Tokens, Visitor
from tools.page.wording import worded
from tools.recalibration.held_service import Asked
from tools.recalibration.paperwork import Begin, Signature
from tools.recalibration.session import ScanSession
from tools.shared.called_host import called
from tools.shared.gesture_drawings import DRAWINGS
from tools.shared.status_watch import StatusWatch

_FILES = (Path(__file__).parent / "files", DRAWINGS)
_KINDS = {".html": "text/html; charset=utf-8", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
_COOKIE = "probewatch"
_EVENTS_S = 0.25
"""Between two events: seen as motion, the pace of `probewatch status --watch`."""
_PICTURE_S = 2.0
"""For which a request for a newer picture waits before it is answered with none. Longer keeps a dead picture looking
alive; shorter asks for nothing."""
_LOOK_S = 0.02
"""Between two looks for a newer picture: a fifth of the time between two at ten a second."""
_BODY_S = 5.0
"""For a request to be sent whole once it has begun, as long as for its head."""
_NO_TOKEN = "a token is needed: probewatch page --token gives one"
_MOST_BODY = 8192
"""Bytes of a request: names and a comment take some 500."""
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


@dataclass(frozen=True, slots=True)
class Parts:
    """What the page is made of. cart: its name. hosts: names and addresses by which a browser may call it, no port."""

    watch: StatusWatch
    pictures: Pictures
    session: ScanSession
    alarms: AlarmLogWatch
    asking: Asking
    tokens: Tokens
    cart: str
    hosts: frozenset[str]


@dataclass(eq=False, slots=True)
class _Listener:
    """A browser that is sent events."""

    address: str
    sent_away: bool = False


class Page:
    """app: for an ASGI server."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        found = [path for folder in _FILES for path in sorted(folder.iterdir()) if path.suffix in _KINDS]
        self._files = {path.name: path.read_bytes() for path in found}
        self._listeners: list[_Listener] = []
        self._language = "en"  # of the room, as the service told it last
        routes = [
            Route("/", self._file),
            Route("/recalibrate", self._file),
            Route("/files/{name}", self._file),
            Route(EVENTS, self._events),
            Route("/picture", self._picture),
            Route("/view/{index:int}", self._view),
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
        """One of an address that has two more than the newcomer's is sent away for it, where there is one."""
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
        """Everything that the page shows but its pictures."""
        parts = self._parts
        if visitor is not None:
            parts.session.look_on()
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
        """One that is newer than number `after`; 204 where none came in time."""
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
        """What was around the crossing of one view."""
        image = self._parts.session.thumbnail(request.path_params["index"])
        if image is None:
            return Response("there is no such view\n", 404, media_type="text/plain")
        return Response(jpeg(image), media_type="image/jpeg", headers={"Cache-Control": "no-store"})

    async def _token(self, request: Request) -> Response:
        """A one-time token becomes a cookie that no script can read and no other site can send."""
        now_s = time.monotonic()
        body = await _body(request)
        address = _address(request)
        if self._parts.tokens.locked(now_s, address):
            return _refused("too many wrong tokens; wait a minute", 429)
        cookie = self._parts.tokens.redeem(str(body.get("token", "")), now_s, address)
        if cookie is None:
            return _refused("the token is wrong, was used, or is too old: probewatch page --token gives another", 403)
        response = JSONResponse({"ok": True})
        response.set_cookie(_COOKIE, cookie, httponly=True, samesite="strict", path="/")
        return response

    async def _request(self, request: Request) -> Response:
        """What the service is asked to do at once."""
        visitor, what = self._visitor(request), request.path_params["what"]
        if visitor is None:
            return _refused(_NO_TOKEN, 403)
        if what not in REQUESTS:
            return _refused("there is no such request", 404)
        return await _done(self._parts.asking.ask, what, visitor.name)

    async def _recalibration(self, request: Request) -> Response:
        """Every request that changes something of a scan."""
        if self._visitor(request) is None:
            return _refused(_NO_TOKEN, 403)
        act = _ACTS.get(request.path_params["what"])
        if act is None:
            return _refused("there is no such request", 404)
        body = await _body(request)
        self._parts.session.touch()
        return await _done(act, self._parts.session, body)

    def _visitor(self, request: Request) -> Visitor | None:
        return self._parts.tokens.visitor(request.cookies.get(_COOKIE), time.monotonic())


async def _done(act: Callable[..., None], *words: object) -> Response:
    """What became of it: done, a question, or why not."""
    try:
        await run_in_threadpool(act, *words)
    except Asked as question:
        return JSONResponse({"ok": False, "ask": question.text}, 409)
    except ProbewatchError as error:
        parts = [text for text in (error.where, error.what, error.remedy) if text]
        return JSONResponse({"ok": False, "error": str(error), "parts": parts}, 409)
    return JSONResponse({"ok": True})


class _Counted(StreamingResponse):
    """ended: called once, also where the client has gone before its stream begins."""

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


_USUAL_PORTS = {"http": "80", "https": "443"}
"""By scheme: those that a browser leaves out of Origin and Host."""
_NAMED = 100
"""Characters of a header that a refusal repeats."""


class Guard:
    """Refuses whoever calls the page by a foreign name (so that no other site's page can), and what another origin
    sends; every answer forbids the browser what the page does not need.
    """

    def __init__(self, app: ASGIApp, hosts: frozenset[str]) -> None:
        self._app, self._hosts = app, hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        why = self._foreign(Headers(scope=scope), scope["method"])
        if why:
            await _refused(why, 403)(scope, receive, send)
            return
        await self._app(scope, receive, _guarded(send))

    def _foreign(self, headers: Headers, method: str) -> str:
        host = headers.get("host", "")
        if called(host) not in self._hosts:
            named = printable(host, _NAMED) or "none"
            return f"this page is not called by that name: Host {named}; --host allows another"
        origin = headers.get("origin")
        if method == "POST" and not _is_own(origin, host):
            if origin is None:
                own = printable(host, _NAMED)
                return f"the request comes from no page: Origin none, Host {own}; a browser sends Origin: http://{own}"
            compared = f"Origin {printable(origin, _NAMED)}, Host {printable(host, _NAMED)}"
            passed_on = "a proxy must pass on Host as the browser sends it (nginx: proxy_set_header Host $http_host)"
            return f"the request comes from another page: {compared}; {passed_on}"
        return ""


def _is_own(origin: str | None, host: str) -> bool:
    """Whether a browser that calls the page by that Host is on a page of it; a port that goes without saying may be
    said.
    """
    scheme, _, place = (origin or "").lower().partition("://")
    port = f":{_USUAL_PORTS.get(scheme, '')}"
    return bool(place) and place.removesuffix(port) == host.lower().removesuffix(port)


def _guarded(send: Send) -> Callable[[Message], Awaitable[None]]:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers["Content-Security-Policy"] = _POLICY
            headers["X-Content-Type-Options"] = "nosniff"
            headers["Cross-Origin-Resource-Policy"] = "same-origin"
            headers["Referrer-Policy"] = "no-referrer"
            headers["Permissions-Policy"] = "camera=(), microphone=(), geolocation=()"
        await send(message)

    return sending


def _address(request: Request) -> str:
    """Address of the client; one for all that come through a proxy."""
    return "" if request.client is None else request.client.host


async def _body(request: Request) -> dict[str, Any]:
    """Empty where there is none. Raises _BodyRefusedError where it is not a JSON object, too long, or not whole in
    time.
    """
    data = b""
    try:
        async with asyncio.timeout(_BODY_S):
            async for part in request.stream():
                data += part
                if len(data) > _MOST_BODY:
                    raise _BodyRefusedError(f"the request has more than {_MOST_BODY} bytes", 413)
        body = json.loads(data or b"{}")
    except TimeoutError:
        raise _BodyRefusedError(f"the request did not come whole within {_BODY_S:g} s", 408) from None
    except (ValueError, RecursionError, ClientDisconnect):
        body = None
    if not isinstance(body, dict):
        raise _BodyRefusedError('the request is no JSON object, such as {"index": 2}', 400)
    return body


class _BodyRefusedError(Exception):
    """What a client sent, and the status of the answer."""

    def __init__(self, why: str, status: int) -> None:
        super().__init__(why)
        self.why, self.status = why, status


async def _body_refused(_: Request, error: Exception) -> Response:
    assert isinstance(error, _BodyRefusedError)
    return _refused(error.why, error.status)


BODY_HANDLERS = {_BodyRefusedError: _body_refused}
"""Of the application whose requests have bodies."""


def _refused(why: str, status: int) -> JSONResponse:
    return JSONResponse({"ok": False, "error": why}, status)


def _text(body: dict[str, Any], name: str) -> str:
    value = body.get(name, "")
    return value if isinstance(value, str) else ""


def _whole(body: dict[str, Any], name: str) -> int:
    value = body.get(name)
    return value if isinstance(value, int) and not isinstance(value, bool) else -1


def _number(body: dict[str, Any], name: str) -> float:
    value = body.get(name)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else float("nan")


def _begin(body: dict[str, Any]) -> Begin:
    """What is left out is not known, or as usual; what is no number is refused with the rest."""
    probe, preset, technician, reason, wanted = (
        _text(body, name) for name in ("probe", "preset", "technician", "reason", "wanted")
    )
    numbers = [field for field in ("water_c", "scanner_m_s") if body.get(field) is not None]
    given: dict[str, Any] = {field: _number(body, field) for field in numbers}
    return Begin(
        probe,
        preset,
        technician,
        reason,
        wanted,
        correct_sound=body.get("correct_sound") is True,
        latency=body.get("latency") is True,
        **given,
    )


def _point(body: dict[str, Any]) -> tuple[float, float, float] | None:
    """Where a pointer found it; NaN, which is refused, where that is no number."""
    if body.get("point") is None:
        return None
    point = body["point"] if isinstance(body["point"], list) else []
    x, y, z = (
        _number({"one": point[index]}, "one") if len(point) == len("xyz") else float("nan") for index in range(3)
    )
    return x, y, z


_ACTS: dict[str, Callable[[ScanSession, dict[str, Any]], None]] = {
    "begin": lambda session, body: session.begin(_begin(body)),
    "latency": lambda session, body: session.take_latency(body.get("measured") is True),
    "check": lambda session, body: session.check(_point(body)),
    "end-check": lambda session, _: session.end_check(),
    "finish": lambda session, _: session.finish(),
    "resume": lambda session, _: session.resume(),
    "strike": lambda session, body: session.strike(_whole(body, "index"), body.get("struck") is not False),
    "correct": lambda session, body: session.correct(
        _whole(body, "index"), (_number(body, "column"), _number(body, "row"))
    ),
    "accept": lambda session, body: session.accept(
        Signature(*(_text(body, name) for name in ("name", "role", "comment", "confirm", "unchecked")))
    ),
    "reject": lambda session, body: session.reject(_text(body, "reason")),
    "dismiss": lambda session, _: session.dismiss(),
}
