"""Cuts a stream of bytes into messages; those that are not wanted are counted and never kept."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.openigtlink.message import HEADER_BYTES, Header, Message, decode_body, parse_header


@dataclass(frozen=True, slots=True)
class Arrived:
    """Holds a message with its arrival. arrival_ns: when the first byte was there, which does not depend on the length
    of the message.
    """

    message: Message
    arrival_ns: int


class MessageStream:
    """Assembles messages. It holds the parts of one message at most, and the whole ones from one call of `add`.

    skipped: count of messages that were not wanted. refused: count of wanted ones that were damaged. whole: count of
    messages of any kind that were received to the end. damaged: the header of the last one that was refused.
    """

    def __init__(self, wanted: Callable[[Header], bool], where: str = "") -> None:
        self.skipped = self.refused = self.whole = 0
        self.damaged: Header | None = None
        self._wanted, self._where = wanted, where
        self._head, self._body = bytearray(), bytearray()
        self._header: Header | None = None
        self._keeps = False
        self._missing = 0
        self._began_ns = 0
        self._ready: deque[tuple[Header, bytes, int]] = deque()
        self._broken: ProtocolError | None = None

    def add(self, data: bytes, arrival_ns: int) -> None:
        """Adds the bytes that arrived at arrival_ns."""
        view = memoryview(data)
        while view and self._broken is None:
            view = self._into_header(view, arrival_ns) if self._header is None else self._into_body(view)
            if self._header is not None and self._missing == 0:
                self._end(self._header)

    def take(self) -> Arrived | None:
        """Returns the next wanted message; None when none is whole. Raises ProtocolError for one that is damaged."""
        if not self._ready:
            return None
        header, body, began_ns = self._ready.popleft()
        try:
            return Arrived(decode_body(header, body, self._where), began_ns)
        except ProtocolError:
            self.refused += 1
            self.damaged = header
            raise

    @property
    def waiting(self) -> bool:
        """Returns whether a whole message has not been taken yet."""
        return bool(self._ready)

    def require_sound(self) -> None:
        """Raises ProtocolError once no message that follows can be found."""
        if self._broken is not None and not self._ready:
            raise self._broken

    def _into_header(self, view: memoryview, arrival_ns: int) -> memoryview:
        if not self._head:
            self._began_ns = arrival_ns
        rest = HEADER_BYTES - len(self._head)
        self._head += view[:rest]
        if len(self._head) == HEADER_BYTES:
            try:
                self._header = parse_header(bytes(self._head), self._where)
            except ProtocolError as error:
                self._broken = error
                return view[len(view) :]
            self._keeps, self._missing = self._wanted(self._header), self._header.body_bytes
        return view[rest:]

    def _into_body(self, view: memoryview) -> memoryview:
        part = view[: self._missing]
        if self._keeps:
            self._body += part
        self._missing -= len(part)
        return view[len(part) :]

    def _end(self, header: Header) -> None:
        self.whole += 1
        if self._keeps:
            self._ready.append((header, bytes(self._body), self._began_ns))
        else:
            self.skipped += 1
        self._header, self._head, self._body = None, bytearray(), bytearray()
