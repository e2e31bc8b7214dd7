"""Plays the device of a byte log, which answers as it did when it was recorded.

A request is answered with what followed the same request in the log, chunk by chunk and after the same delays. Tracking
requests are answered in the order of the log; the first that the log does not hold finds the device unplugged. Any
other request that the log does not hold gets no answer.
"""

from collections import defaultdict, deque
from dataclasses import dataclass, field
from threading import Event

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.io.byte_log import Direction, Entry
from probewatch.drivers.twins.pty_line import IDLE_S, TwinLine

_FAST_BAUD = 10_000_000
"""Bits per second at which chunks go out: a microsecond a byte, so that only the delays of the log determine their
times."""

_TRACKING = (b"BX", b"TX")


@dataclass(slots=True)
class Exchange:
    """Holds a request and its reply. chunks: (nanoseconds since the request, bytes)."""

    request: bytes
    chunks: list[tuple[int, bytes]] = field(default_factory=list)


def exchanges(entries: tuple[Entry, ...]) -> list[Exchange]:
    """Returns the requests with what came after each of them; what came before the first belongs to an empty
    request.
    """
    found = [Exchange(b"")]
    sent_ns = entries[0].t_ns if entries else 0
    for entry in entries:
        if entry.direction is Direction.SENT:
            found.append(Exchange(entry.data))
            sent_ns = entry.t_ns
        elif entry.direction is Direction.RECEIVED:
            found[-1].chunks.append((entry.t_ns - sent_ns, entry.data))
    return found


class LogTwin:
    """Plays the device on its line. unanswered: requests that the log does not hold, up to the end of the run."""

    def __init__(self, line: TwinLine, clock: HostClock, entries: tuple[Entry, ...]) -> None:
        self.unanswered: list[bytes] = []
        self._line, self._clock = line, clock
        self._tracking: deque[Exchange] = deque()
        self._other: defaultdict[bytes, deque[Exchange]] = defaultdict(deque)
        for exchange in exchanges(entries):
            if exchange.request.startswith(_TRACKING):
                self._tracking.append(exchange)
            else:
                self._other[exchange.request].append(exchange)
        self._received = bytearray()
        self._over = False

    def run(self, stop: Event) -> None:
        """Serves the line until the log has been played or stop is set."""
        while not self._over and not stop.is_set():
            self._received += self._line.read(IDLE_S).replace(b"\0", b"")
            while (end := self._received.find(b"\r")) >= 0:
                request = bytes(self._received[: end + 1])
                del self._received[: end + 1]
                self._answer(request)
        self._line.unplug()

    def _answer(self, request: bytes) -> None:
        sent_ns = self._clock.now_ns()
        exchange = self._next(request)
        if exchange is None:
            self.unanswered.append(request)
            return
        for delay_ns, data in exchange.chunks:
            self._line.write(data, _FAST_BAUD, sent_ns + delay_ns)

    def _next(self, request: bytes) -> Exchange | None:
        if not request.startswith(_TRACKING):
            waiting = self._other[request]
            return waiting.popleft() if waiting else None
        while self._tracking:
            exchange = self._tracking.popleft()
            if exchange.request == request:
                return exchange
        self._over = True
        return None
