"""Provides what a twin with any number of TCP clients needs: listen, accept, act for each, drop, unplug and reset."""

import selectors
import socket
import struct
from collections.abc import Callable, Collection
from contextlib import suppress
from typing import Generic, Protocol, TypeVar

from probewatch.drivers.closable import Closable
from probewatch.drivers.errors import ProtocolError, cannot_listen

_ABORT = struct.pack("ii", 1, 0)
"""SO_LINGER: closing sends RST and not FIN, as a server that dies does."""


class Client(Protocol):
    """Represents one connection."""

    line: socket.socket


C = TypeVar("C", bound=Client)


class TcpServer(Generic[C]):
    """Listens from construction on. address: (host, port), the port chosen if 0 was given. clients: those connected.

    made: makes a client of an accepted connection. note: is called with their number whenever that changes. Raises
    ConfigurationError where the port is taken.
    """

    def __init__(
        self, address: tuple[str, int], made: Callable[[socket.socket], C], note: Callable[[str, object], None]
    ) -> None:
        self.address = address
        self.clients: list[C] = []
        self._made, self._note = made, note
        self._listener: socket.socket | None = None
        self.listen()

    def listen(self) -> None:
        """Listens again after unplug; otherwise does nothing."""
        if self._listener is not None:
            return
        try:
            self._listener = socket.create_server(self.address)
        except (OSError, OverflowError, UnicodeError) as error:
            raise cannot_listen(error, "{}:{}".format(*self.address), "Choose another port, or 0 for any") from None
        self._listener.setblocking(False)
        self.address = self._listener.getsockname()[:2]

    def unplug(self) -> None:
        """Ends every connection and stops listening."""
        if self._listener is not None:
            self._listener.close()
        self._listener = None
        for client in tuple(self.clients):
            self.drop(client)

    def reset(self) -> None:
        """Ends every connection with RST."""
        for client in tuple(self.clients):
            client.line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _ABORT)
            self.drop(client)

    def drop(self, client: C) -> None:
        """Ends one connection."""
        client.line.close()
        self.clients.remove(client)
        self._note("clients", len(self.clients))

    def wait(self, wait_s: float, heard: Collection[C], to_write: Callable[[C], bool] = lambda _: False) -> list[C]:
        """Returns those of `heard` that have sent something, or that can be written to where to_write asks for it.

        Accepts a connection that waits. Only select() does not round the wait to milliseconds.
        """
        with selectors.SelectSelector() as ready:
            if self._listener is not None:
                ready.register(self._listener, selectors.EVENT_READ)
            for client in heard:
                events = selectors.EVENT_READ | (selectors.EVENT_WRITE if to_write(client) else 0)
                ready.register(client.line, events, client)
            found = [key.data for key, _ in ready.select(wait_s)]
        if None in found:
            self._accept()
        return [client for client in found if client is not None]

    def act(self, client: C, work: Callable[[C], object]) -> None:
        """Does work for a client; one that is gone, or breaks the protocol, is dropped."""
        try:
            work(client)
        except BlockingIOError:
            return
        except (OSError, ProtocolError):
            self.drop(client)

    def act_for_all(self, work: Callable[[C], object]) -> None:
        """Does work for each client that is connected now."""
        for client in tuple(self.clients):
            self.act(client, work)

    def _accept(self) -> None:
        assert self._listener is not None
        with suppress(OSError):
            line, _ = self._listener.accept()
            line.setblocking(False)
            line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self.clients.append(self._made(line))
            self._note("clients", len(self.clients))


class ListeningTwin(Closable, Generic[C]):
    """Listens from construction until the context is left."""

    def __init__(self, server: TcpServer[C]) -> None:
        self._server = server

    @property
    def address(self) -> tuple[str, int]:
        """Returns (host, port) where it listens."""
        return self._server.address

    def close(self) -> None:
        """See Closable."""
        self._server.unplug()
