"""A plain OpenIGTLink client for tests: messages as they come, whole and checked."""

import socket
import time
from types import TracebackType
from typing import Self

from probewatch.drivers.openigtlink.message import Message, encode
from probewatch.drivers.openigtlink.stream import MessageStream


class Listener:
    """One connection. heard: every message so far."""

    def __init__(self, address: tuple[str, int]) -> None:
        self.line = socket.create_connection(address, 5)
        self.heard: list[Message] = []
        self._stream = MessageStream(lambda header: True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.line.close()

    def ask(self, kind: str, device: str = "", content: bytes = b"", version: int = 1) -> None:
        self.line.sendall(encode(Message(kind, device, content, version=version)))

    def listen(self, seconds: float) -> list[Message]:
        """What comes within that time."""
        before, end_s = len(self.heard), time.monotonic() + seconds
        while (left_s := end_s - time.monotonic()) > 0:
            self._receive(left_s)
        return self.heard[before:]

    def until(self, kind: str, device: str | None = None, deadline_s: float = 5.0) -> Message:
        """The next message of that kind and device."""
        end_s, place = time.monotonic() + deadline_s, len(self.heard)
        while True:
            for message in self.heard[place:]:
                place += 1
                if message.kind == kind and device in (None, message.device):
                    return message
            left_s = end_s - time.monotonic()
            assert left_s > 0, f"no {kind} '{device}' within {deadline_s:g} s, only {[m.kind for m in self.heard][-9:]}"
            self._receive(left_s)

    def _receive(self, left_s: float) -> None:
        self.line.settimeout(left_s)
        try:
            data = self.line.recv(1 << 16)
        except TimeoutError:
            return
        assert data, "the server closed the connection"
        self._stream.add(data, 0)
        self._stream.require_sound()
        while (arrived := self._stream.take()) is not None:
            self.heard.append(arrived.message)
