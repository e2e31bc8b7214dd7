"""Serves the metrics by HTTP: to few clients at a time, none of which keeps another out by sleeping."""

import contextlib
import platform
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self

from prometheus_client import CONTENT_TYPE_LATEST

from probewatch.drivers.errors import cannot_listen
from probewatch.drivers.printable import printable
from probewatch.tools.shared.called_host import called, is_address

_MOST = 16
"""Clients at once, each with a thread. A further one ends a client that has asked nothing: the one that came first from
the address from which most such clients came. Where all have asked, or have just come, it waits for one that is done,
which takes ms. So a client that asks is answered even behind a crowd that asks without pause."""
_WORD_S, _LOOK_S = 0.25, 0.05
"""Seconds for a client to ask before it makes room, and between two looks whether one has not. Shorter ends one on a
busy computer, longer waits longer behind a crowd that sends nothing: 64 of it a second."""
_ANSWERED_S = 2.0
"""Seconds for one of them to be done: as long as the service may be silent. Then the one that came first is ended."""
_SILENT_S = 5.0
"""Seconds for which a client may send nothing, or not read. Longer lets a sleeper keep its place; a shorter time drops
a reader behind a bad network. Not measured."""


_NAMED = 100
"""Characters of a header that a refusal repeats."""


@dataclass(slots=True, eq=False)
class _Client:
    """Represents a connected client. asked: whether it has sent its whole request."""

    address: str
    came_s: float
    asked: bool = False


class Endpoint(ThreadingHTTPServer):
    """Serves /metrics at (host, port); port 0 takes a free one. text: makes what is served, once for each request.
    names: those besides addresses by which it may be called, so that no page of another site can read it (DNS
    rebinding).

    Raises ConfigurationError where nothing can listen there.
    """

    daemon_threads = True
    allow_reuse_address = True
    request_queue_size = 64
    """Clients that wait in the kernel: four times as many as are served."""

    def __init__(self, host: str, port: int, text: Callable[[], bytes], names: Iterable[str] = ()) -> None:
        self.text, self.names = text, {"localhost", platform.node().lower(), *(name.lower() for name in names)}
        self._open: dict[socket.socket, _Client] = {}
        self._done = threading.Condition()
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            super().__init__((host, port), _Handler)
        except (OSError, OverflowError, UnicodeError) as error:
            raise cannot_listen(error, f"--listen {host}:{port}", "Choose another address") from None

    def __enter__(self) -> Self:
        threading.Thread(target=self.serve_forever, name="metrics", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.shutdown()
        self.server_close()

    def process_request(self, request: Any, client_address: Any) -> None:
        """Takes a client, for which one that has asked nothing, or is done, makes room."""
        with self._done:
            if len(self._open) >= _MOST:
                self._make_room()
            self._open[request] = _Client(str(client_address[0]), time.monotonic())
        super().process_request(request, client_address)

    def _make_room(self) -> None:
        end_s = time.monotonic() + _ANSWERED_S
        while len(self._open) >= _MOST:
            now_s = time.monotonic()
            silent = [client for client in self._open.values() if not client.asked and now_s - client.came_s > _WORD_S]
            if silent or now_s > end_s:
                self._end_first_of(silent or [*self._open.values()])
            else:
                self._done.wait(_LOOK_S)

    def _end_first_of(self, clients: list[_Client]) -> None:
        greedy = Counter(client.address for client in clients).most_common(1)[0][0]
        leaves = next(link for link, one in self._open.items() if one in clients and one.address == greedy)
        del self._open[leaves]
        _end(leaves)

    def note_asked(self, request: socket.socket) -> None:
        """Records that the client has sent its whole request."""
        with self._done:
            if request in self._open:
                self._open[request].asked = True

    def shutdown_request(self, request: Any) -> None:
        """Records that the client has been answered, or ended."""
        with self._done:
            self._open.pop(request, None)
            self._done.notify()
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Logs nothing: a client that breaks off is not worth a line of the journal."""


def _end(link: socket.socket) -> None:
    """Ends a connection; its thread sees the end and closes it."""
    with contextlib.suppress(OSError):
        link.shutdown(socket.SHUT_RDWR)


class _Handler(BaseHTTPRequestHandler):
    server: Endpoint
    timeout = _SILENT_S
    server_version, sys_version = "probewatch", ""

    def do_GET(self) -> None:
        """Answers once per connection. A client that names no host is not a browser."""
        self.server.note_asked(self.connection)
        host = self.headers.get("Host")
        if host is not None and not (is_address(called(host)) or called(host) in self.server.names):
            named = printable(host, _NAMED) or "none"
            self.send_error(403, "this exporter is not called by that name; --host allows another", f"Host {named}")
            return
        if self.path.partition("?")[0] != "/metrics":
            self.send_error(404, "there is only /metrics")
            return
        body = self.server.text()
        self.send_response(200)
        self.send_header("Content-Type", CONTENT_TYPE_LATEST)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *arguments: Any) -> None:
        """Logs nothing: each scrape would be a line of the journal."""
