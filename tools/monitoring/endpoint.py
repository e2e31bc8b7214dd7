"""The HTTP side of the metrics: few clients at a time, and none that sleeps keeps another out."""

import contextlib
import platform
import socket
import threading
from collections.abc import Callable, Iterable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Self

from prometheus_client import CONTENT_TYPE_LATEST

from drivers.errors import ConfigurationError
from tools.shared.called_host import called, is_address

_MOST = 16
"""Clients at once, each with a thread. One more ends whoever came first; one that reads is done within ms."""
_SILENT_S = 5.0
"""For which a client may say nothing, or not read. Longer lets a sleeper keep its place; a shorter time drops a reader
behind a bad network. Not measured.
"""


class Endpoint(ThreadingHTTPServer):
    """Serves /metrics at (host, port); port 0 takes a free one. text: makes what is served, once for each request.
    names: other than addresses, by which it may be called, so that no page of another site can read it (DNS rebinding).

    Raises ConfigurationError where nothing can listen there.
    """

    daemon_threads = True
    allow_reuse_address = True
    request_queue_size = 64
    """Clients that wait in the kernel: four times as many as are served."""

    def __init__(self, host: str, port: int, text: Callable[[], bytes], names: Iterable[str] = ()) -> None:
        self.text, self.names = text, {"localhost", platform.node().lower(), *(name.lower() for name in names)}
        self._open: dict[socket.socket, None] = {}
        self._lock = threading.Lock()
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            super().__init__((host, port), _Handler)
        except (OSError, OverflowError) as error:
            where = f"--listen {host}:{port}"
            raise ConfigurationError(f"cannot listen there ({error})", where, "Choose another address") from None

    def __enter__(self) -> Self:
        threading.Thread(target=self.serve_forever, name="metrics", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self.shutdown()
        self.server_close()

    def process_request(self, request: Any, client_address: Any) -> None:
        """Who came first makes room."""
        with self._lock:
            self._open[request] = None
            crowd = len(self._open) > _MOST
            first = next(iter(self._open))
            if crowd:
                del self._open[first]
                _end(first)
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """It has been answered, or ended."""
        with self._lock:
            self._open.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that breaks off is not worth a line of the journal."""


def _end(link: socket.socket) -> None:
    """Its thread sees the end and closes it."""
    with contextlib.suppress(OSError):
        link.shutdown(socket.SHUT_RDWR)


class _Handler(BaseHTTPRequestHandler):
    server: Endpoint
    timeout = _SILENT_S
    server_version, sys_version = "probewatch", ""

    def do_GET(self) -> None:
        """One answer a connection. Who names no host is no browser."""
        host = self.headers.get("Host")
        if host is not None and not (is_address(called(host)) or called(host) in self.server.names):
            self.send_error(403, "this exporter is not called by that name; --host allows another")
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
        """Nothing: each scrape would be a line of the journal."""
