"""Refuses requests from foreign pages, and tells the browser what a page may not do."""

from collections.abc import Awaitable, Callable

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from probewatch.drivers.printable import printable
from probewatch.tools.page.request_body import refused
from probewatch.tools.shared.called_host import called

_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_USUAL_PORTS = {"http": "80", "https": "443"}
"""Ports that a browser leaves out of Origin and Host, by scheme."""
_NAMED = 100
"""Characters of a header that a refusal repeats."""


class Guard:
    """Refuses a client that calls the page by a foreign name (so that no other site's page can), and what another
    origin sends; every answer forbids the browser to do what the page does not need.
    """

    def __init__(self, app: ASGIApp, hosts: frozenset[str]) -> None:
        self._app, self._hosts = app, hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        why = self._foreign(Headers(scope=scope), scope["method"])
        if why:
            await refused(why, 403)(scope, receive, send)
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
    """Returns whether a browser that calls the page by that Host is on a page of it; default ports may be left out."""
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
