"""Implements a client of an RTC3D server: one TCP connection that yields whole packets and takes commands."""

import socket
from contextlib import suppress
from pathlib import Path

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import DeviceLost, ProtocolError
from probewatch.drivers.io.byte_log import ByteLog
from probewatch.drivers.io.tcp_line import SEND_S, connect_tcp
from probewatch.drivers.printable import printable
from probewatch.drivers.trackers.optotrak.rtc3d import (
    HEADER_BYTES,
    ByteOrder,
    Packet,
    PacketType,
    Text,
    command,
    decode_packet,
    packet_length,
)

SERVER_REMEDY = "Check that First Principles is running and its real-time server is switched on"

_CHUNK_BYTES = 1 << 16
"""Bytes read at a time: more than the longest packet (50 000 bytes), so one call takes a frame. More takes only
memory.
"""

_LONGEST_WORDS = 200
"""Characters of the server's words in a message; the wording is not ours, and must fit into one line of a log."""

_REMADE = "The connection is made again"


class Rtc3dClient:
    """Receives whole packets and sends commands, with a deadline on every wait. arrival_ns: when the last bytes came.

    shortest_ns: shortest time from a command to its reply. Part of it is the time that a frame takes to arrive, which
    no statistics of arrivals can show.
    """

    def __init__(
        self, host: str, port: int, order: ByteOrder, clock: HostClock, timeout_s: float, log: Path | None = None
    ) -> None:
        """Connects to the server. order: byte order of the payloads to come. timeout_s: seconds of the clock to
        connect. log: where to write a byte log.

        Raises DeviceLost, and ConfigurationError for a log that cannot be written.
        """
        self._where, self._order, self._clock = f"optotrak://{host}:{port}", order, clock
        self._line: socket.socket = connect_tcp(host, port, clock.real_s(timeout_s))
        try:
            self._byte_log = ByteLog(log, self._where, clock) if log is not None else None
        except BaseException:
            self._line.close()
            raise
        self._received = bytearray()
        self.arrival_ns = clock.now_ns()
        self.shortest_ns = round(timeout_s * 1e9)

    def close(self, last_words: tuple[str, ...]) -> None:
        """Sends last_words if the server still listens, and closes the connection. Never raises."""
        with suppress(DeviceLost):
            for words in last_words:
                self.send(words)
        self._line.close()
        if self._byte_log is not None:
            self._byte_log.close()

    def send(self, text: str) -> None:
        """Sends a command. Raises DeviceLost."""
        data = command(text)
        try:
            self._line.settimeout(SEND_S)
            if self._byte_log is not None:
                self._byte_log.sent(data)
            self._line.sendall(data)
        except OSError as error:
            raise self.lost(f"the connection broke off ({_words_of(error)})", SERVER_REMEDY) from error

    def ask(self, text: str, deadline_ns: int) -> str:
        """Returns the server's reply to a command; measurements that come in between are dropped. Raises DeviceLost,
        also for a refusal.
        """
        self.send(text)
        began_ns = self._clock.now_ns()
        while True:
            packet = self._good_packet(deadline_ns)
            if isinstance(packet, Text) and packet.kind is PacketType.COMMAND:
                self.shortest_ns = min(self.shortest_ns, self.arrival_ns - began_ns)
                return printable(packet.text.strip())
            if isinstance(packet, Text) and packet.kind is PacketType.ERROR:
                words = error_words(packet.text)
                raise self.lost(f"the server refuses '{text}': {words}", "Start a collection in First Principles")
            if self._clock.now_ns() >= deadline_ns:
                raise self.lost(f"no reply to '{text}'", SERVER_REMEDY)

    def _good_packet(self, deadline_ns: int) -> Packet | None:
        try:
            return self.receive(deadline_ns)
        except ProtocolError:
            return None

    def receive(self, deadline_ns: int) -> Packet | None:
        """Returns the next packet, None when none was whole by the deadline; what had come until then is always read.

        Raises DeviceLost when the connection ends or no packets can be found in it any more, ProtocolError for one
        packet that must be refused.
        """
        while (data := self._whole()) is None:
            if not self._fill(deadline_ns):
                return None
        return decode_packet(data, self._order)

    def lost(self, what: str, remedy: str) -> DeviceLost:
        return DeviceLost(what, self._where, remedy)

    def _whole(self) -> bytes | None:
        try:
            length = packet_length(bytes(self._received[:HEADER_BYTES]))
        except ProtocolError as error:
            raise self.lost(f"the stream cannot be followed ({error.what})", _REMADE) from error
        if length is None or len(self._received) < length:
            return None
        data = bytes(self._received[:length])
        del self._received[:length]
        return data

    def _fill(self, deadline_ns: int) -> bool:
        remaining_s = self._clock.real_s((deadline_ns - self._clock.now_ns()) / 1e9)
        try:
            self._line.settimeout(max(remaining_s, 0))
            data = self._line.recv(_CHUNK_BYTES)
        except (TimeoutError, BlockingIOError):
            return False
        except OSError as error:
            raise self.lost(f"the connection broke off ({_words_of(error)})", SERVER_REMEDY) from error
        self.arrival_ns = self._clock.now_ns()
        if self._byte_log is not None:
            self._byte_log.received(data)
        if not data:
            raise self.lost("the server closed the connection", SERVER_REMEDY)
        self._received += data
        return True


def error_words(text: str) -> str:
    """Returns the text of an error packet, for a message."""
    words = text.strip().removeprefix("Error-").removeprefix("error-").strip() or "an error without words"
    return f"the server reports: {printable(words, _LONGEST_WORDS)}"


def _words_of(error: OSError) -> str:
    return (error.strerror or "no answer").lower()
