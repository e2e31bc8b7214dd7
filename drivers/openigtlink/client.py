"""Implements a client of one OpenIGTLink server: it receives whole messages and sends questions, with a deadline on
every wait.
"""

import socket
from collections.abc import Callable

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import DeviceLost, ProtocolError
from probewatch.drivers.io.tcp_line import SEND_S, connect_tcp, round_trip_ns
from probewatch.drivers.openigtlink.message import Header, Message, encode
from probewatch.drivers.openigtlink.stream import Arrived, MessageStream
from probewatch.drivers.printable import printable

SERVER_REMEDY = "Check that the OpenIGTLink server runs and sends"

_SLOW_REMEDY = f"{SERVER_REMEDY}; where it is as slow as that by itself, give a longer deadline_ms= in the URL"
"""Remedy for a server that is silent. A tracker of 3 Hz is silent between two measurements, and also before the first
that is seen.
"""

FOLLOW_REMEDY = "Have the sender follow the protocol: content, lengths, and the CRC-64 (ECMA-182) of each body"
"""Remedy where all messages that are wanted come damaged."""

_CONNECT_S = 2.0
"""Seconds for the name and the connection. More delays the report that no server is there."""

_CHUNK_BYTES = 1 << 18
"""Bytes read at a time: most of a picture of 640 × 480. Less takes more calls, more only memory."""

_ASK_AFTER = 0.5
"""Share of the deadline after which a silent server is asked for its status; it has the other half to answer. PLUS
sends nothing at all while the tracker sees no tool.
"""

_MOST_MESSAGES, _MOST_BYTES = 5_000, 1 << 28
"""Messages and bytes of any kind in a second of the clock: ten messages for each measurement of the fastest tracker
(400 Hz), or 40 pictures of 1920 × 1080 in colour, fit. A server that sends more takes the interpreter from the tick of
the service, which was then 6 to 10 ms late, in the median, on a busy machine of two cores; the server is lost, and
opened again after a pause.
"""

_SECOND_NS = 1_000_000_000  # the time over which they are counted

_MOST_NAMES = 32
"""Names of what a server sends that are kept to report them. A hostile server could invent names without end."""


_MOST_LISTED = 8
"""Largest number of these names in a sentence. Nobody would read more."""


class IgtlClient:
    """Receives messages from one server. wanted: decides which messages are kept. deadline_ns: silence after which the
    server is lost. version: that of our headers.

    received: names of the kinds and devices that were sent, the first of them, for messages.
    """

    def __init__(
        self,
        address: tuple[str, int],
        wanted: Callable[[Header], bool],
        deadline_ns: int,
        version: int,
        clock: HostClock,
    ) -> None:
        """Connects to the server. Raises DeviceLost."""
        self.where = f"igtl://{address[0]}:{address[1]}"
        self._clock, self._deadline_ns, self._version = clock, deadline_ns, version
        self._wanted = wanted
        self.received: dict[str, None] = {}
        self._stream = MessageStream(self._noted, self.where)
        self._line: socket.socket = connect_tcp(*address, clock.real_s(_CONNECT_S))
        self.round_trip_ns = round_trip_ns(self._line)
        self._heard_ns = clock.now_ns()
        self._asked = False
        self._second = (self._heard_ns, 0, 0)

    @property
    def others(self) -> str:
        """Returns what the server sends, in words."""
        return ", ".join(printable(name) for name in sorted(self.received)[:_MOST_LISTED]) or "nothing"

    def close(self) -> None:
        self._line.close()

    @property
    def skipped(self) -> int:
        """Returns the number of messages of kinds or devices that were not wanted."""
        return self._stream.skipped

    def send(self, kind: str, device: str = "", content: bytes = b"") -> None:
        """Sends a message. Raises DeviceLost."""
        try:
            self._line.settimeout(SEND_S)
            self._line.sendall(encode(Message(kind, device, content, version=self._version)))
        except OSError as error:
            raise self.lost(f"the connection broke off ({_words_of(error)})") from error

    def receive(self, until_ns: int) -> Arrived | None:
        """Returns the next wanted message, None when none was whole by until_ns; what had come until then is always
        read.

        Raises ProtocolError for one that is damaged; DeviceLost when the connection ends, no messages can be found in
        it any more, or no message of any kind was whole within the deadline.
        """
        while (arrived := self._stream.take()) is None:
            self._require_sound()
            if not self._fill(until_ns):
                self._require_life()
                if self._clock.now_ns() >= until_ns:
                    return None
        return arrived

    def lost(self, what: str, remedy: str = SERVER_REMEDY) -> DeviceLost:
        return DeviceLost(what, self.where, remedy)

    def _noted(self, header: Header) -> bool:
        if len(self.received) < _MOST_NAMES:
            self.received[f"{header.kind} '{header.device}'"] = None
        return self._wanted(header)

    def _require_sound(self) -> None:
        try:
            self._stream.require_sound()
        except ProtocolError as error:
            raise self.lost(f"the stream cannot be followed ({error.what})", "The connection is made again") from error

    def _require_life(self) -> None:
        """Raises DeviceLost for a server that stays silent after it was asked: a peer that is gone without notice, or
        in the middle of a message, does not answer; one that answers is alive.
        """
        silent_ns = self._clock.now_ns() - self._heard_ns
        if silent_ns >= self._deadline_ns:
            raise self.lost(f"the server has been silent for {silent_ns / 1e6:.0f} ms", _SLOW_REMEDY)
        if silent_ns >= _ASK_AFTER * self._deadline_ns and not self._asked:
            self._asked = True
            self.send("GET_STATUS")

    def _fill(self, until_ns: int) -> bool:
        """Receives what arrives next. Returns False where nothing came by until_ns, or by the time at which the server
        is to be asked or is lost.
        """
        now_ns = self._clock.now_ns()
        timeout_ns = self._deadline_ns * (1.0 if self._asked else _ASK_AFTER)
        wake_ns = min(until_ns, self._heard_ns + round(timeout_ns))
        try:
            self._line.settimeout(max(self._clock.real_s((wake_ns - now_ns) / 1e9), 0))
            data = self._line.recv(_CHUNK_BYTES)
        except (TimeoutError, BlockingIOError):
            return False
        except OSError as error:
            raise self.lost(f"the connection broke off ({_words_of(error)})") from error
        if not data:
            raise self.lost("the server closed the connection")
        self._take_in(data)
        return self._clock.now_ns() < self._heard_ns + self._deadline_ns

    def _take_in(self, data: bytes) -> None:
        arrival_ns, whole = self._clock.now_ns(), self._stream.whole
        self._stream.add(data, arrival_ns)
        if self._stream.whole > whole:
            self._heard_ns, self._asked = arrival_ns, False
        self._refuse_flood(arrival_ns, self._stream.whole - whole, len(data))

    def _refuse_flood(self, now_ns: int, messages: int, size: int) -> None:
        since_ns, count, total = self._second
        if now_ns - since_ns > _SECOND_NS:
            since_ns, count, total = now_ns, 0, 0
        self._second = (since_ns, count + messages, total + size)
        if count + messages > _MOST_MESSAGES or total + size > _MOST_BYTES:
            sent = f"{count + messages} messages, {(total + size) / 1e6:.0f} MB"
            what = f"the server sends too much: {sent} in a second"
            raise self.lost(what, "Have it send less: only what image=, probe= and reference= name")


def _words_of(error: OSError) -> str:
    return (error.strerror or "no answer").lower()
