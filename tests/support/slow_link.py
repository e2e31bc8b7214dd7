"""A TCP link whose delay a test sets while bytes pass, as a wireless network at the edge of its reach has."""

import socket
import threading
import time
from contextlib import suppress
from queue import SimpleQueue

_LOOK_S = 0.01
"""Between two looks whether the delay was changed."""


class SlowLink:
    """Listens at `port` of 127.0.0.1 and passes everything on to and from `address` (HOST:PORT).

    What comes from there is handed out in order, `late_s` after it came; the other way is prompt.
    """

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        self._target = (host, int(port))
        self.late_s = 0.0
        self._ended = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self._open = [self._listener]

    def __enter__(self) -> "SlowLink":
        threading.Thread(target=self._accept, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        for one in self._open:
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                browser, _ = self._listener.accept()
                page = socket.create_connection(self._target)
                self._open += [browser, page]
                for source, drain, slow in ((browser, page, False), (page, browser, True)):
                    threading.Thread(target=self._pass_on, args=(source, drain, slow), daemon=True).start()

    def _pass_on(self, source: socket.socket, drain: socket.socket, slow: bool) -> None:
        waiting: SimpleQueue[tuple[float, bytes]] = SimpleQueue()
        threading.Thread(target=self._hand_out, args=(waiting, drain, slow), daemon=True).start()
        with suppress(OSError):
            while data := source.recv(65536):
                waiting.put((time.monotonic(), data))
        waiting.put((time.monotonic(), b""))

    def _hand_out(self, waiting: SimpleQueue[tuple[float, bytes]], drain: socket.socket, slow: bool) -> None:
        with suppress(OSError):
            while data := self._due(*waiting.get(), slow):
                drain.sendall(data)
            drain.shutdown(socket.SHUT_WR)

    def _due(self, came_s: float, data: bytes, slow: bool) -> bytes:
        while slow and time.monotonic() < came_s + self.late_s:
            self._ended.wait(_LOOK_S)
        return data
