"""Provides a network line: a listening TCP port of this computer to which the real driver connects.

The connection that has been open longest may command, all others may only query; each has its own replies.
"""

import select
import socket
import struct
from contextlib import suppress

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable

_ABORT = struct.pack("ii", 1, 0)
_SEND_S = 1.0
"""Seconds for a host to take a reply. One that does not is dropped, or the others would wait for it."""


class TcpLine(Closable):
    """Represents the device's end. port: 0 takes a free one, which it keeps. source, monitor: see
    drivers.twins.pty_line.TwinLine.
    """

    def __init__(self, port: int, clock: HostClock) -> None:
        self.port = port
        self.source = -1
        self._clock = clock
        self._clients: list[socket.socket] = []
        self._listener: socket.socket | None = None
        self.plug()

    def close(self) -> None:
        """See Closable."""
        self.unplug()

    @property
    def monitor(self) -> bool:
        """Returns whether the connection that spoke last came later than another one that is still there."""
        return bool(self._clients) and self.source != self._clients[0].fileno()

    def plug(self) -> None:
        """Listens, unless it already does."""
        if self._listener is None:
            self._listener = socket.create_server(("127.0.0.1", self.port))
            self.port = self._listener.getsockname()[1]

    def unplug(self) -> None:
        """Resets every connection and stops listening."""
        for client in list(self._clients):
            with suppress(OSError):
                client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _ABORT)
            self._drop(client)
        if self._listener is not None:
            self._listener.close()
            self._listener = None

    def hears(self, baud: int) -> bool:
        """Returns True, because there is no line speed here."""
        return True

    def read(self, timeout_s: float) -> bytes:
        """Returns what one of the hosts has sent; empty when nothing came within timeout_s of the clock."""
        waiting = [*self._clients] + ([self._listener] if self._listener is not None else [])
        ready = select.select(waiting, [], [], self._clock.real_s(timeout_s))[0]
        if self._listener in ready:
            self._accept(self._listener)
        for client in ready:
            if client is not self._listener and (data := self._receive(client)):
                self.source = client.fileno()
                return data
        return b""

    def write(self, data: bytes, baud: int, start_ns: int) -> None:
        """Sends from start_ns on, at once, to the client from which read() last returned bytes; one that does not take
        it is dropped.
        """
        self._clock.sleep_until(start_ns)
        for client in [client for client in self._clients if client.fileno() == self.source]:
            try:
                client.sendall(data)
            except OSError:
                self._drop(client)

    def _accept(self, listener: socket.socket) -> None:
        client, _ = listener.accept()
        client.settimeout(_SEND_S)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._clients.append(client)

    def _receive(self, client: socket.socket) -> bytes:
        try:
            data = client.recv(4096)
        except OSError:
            data = b""
        if not data:
            self._drop(client)
        return data

    def _drop(self, client: socket.socket) -> None:
        self._clients.remove(client)
        client.close()
