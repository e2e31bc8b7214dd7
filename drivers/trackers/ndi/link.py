"""Exchanges whole requests and whole replies with the tracker over its line, with a deadline on every wait."""

import select

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import DeviceLost, ProtocolError
from probewatch.drivers.io.byte_log import ByteLog
from probewatch.drivers.io.serial_port import BITS_PER_BYTE
from probewatch.drivers.trackers.ndi.transport import LINE_ERRORS, ByteLine
from probewatch.drivers.trackers.ndi.wire import encode_text, reply_length

_RESET = encode_text("RESET")


class SilentError(DeviceLost):
    """Reports that no whole reply came within the deadline."""


class RebootedError(DeviceLost):
    """Reports that the tracker sent RESET: handles, tracking and line settings are gone."""


class Link:
    """Sends requests and receives replies over one half-duplex line. where: the device, for messages. byte_log: records
    all bytes.

    Every method raises DeviceLost when the line fails; read_reply also raises SilentError and ProtocolError.
    """

    def __init__(self, line: ByteLine, clock: HostClock, byte_log: ByteLog | None = None) -> None:
        self.where = line.where
        self._line, self._clock, self._byte_log = line, clock, byte_log
        self._received = bytearray()

    @property
    def baud(self) -> int | None:
        """Returns the bits per second of the host's side; None on a network."""
        return self._line.baud

    def close(self) -> None:
        """Releases the line."""
        self._line.close()
        if self._byte_log is not None:
            self._byte_log.close()

    def set_baud(self, baud: int) -> None:
        """Changes the line speed of the host's side; what was received at the old one is discarded."""
        try:
            self._line.set_baud(baud)
        except LINE_ERRORS as error:
            raise self._lost(error) from error
        self._remark(f"{baud} baud")
        self.discard()

    def transfer_ns(self, count: int) -> int:
        """Returns the time on the wire of `count` bytes, ns of the clock."""
        return 0 if self.baud is None else count * BITS_PER_BYTE * 1_000_000_000 // self.baud

    def send(self, request: bytes) -> int:
        """Discards what came late, then writes the request. Returns the time just before the first byte went out, ns of
        the clock.

        Raises RebootedError when what came late was the word RESET.
        """
        if _RESET in self.discard():
            raise RebootedError("the tracker restarted by itself", self.where, "Check its power supply and cables")
        if self._byte_log is not None:
            self._byte_log.sent(request)
        sent_ns = self._clock.now_ns()
        try:
            self._line.write(request)
        except LINE_ERRORS as error:
            raise self._lost(error) from error
        return sent_ns

    def reset(self) -> None:
        """Makes the device restart; what was received is discarded."""
        self._remark("reset")
        self._received.clear()
        try:
            self._line.reset(self._clock)
        except LINE_ERRORS as error:
            raise self._lost(error) from error
        self.discard()

    def read_reply(self, deadline_ns: int) -> bytes:
        """Returns one whole reply, text or binary. What has come by the deadline counts, however late this host looks
        at it.

        Raises SilentError at the deadline, ProtocolError as soon as the bytes cannot be a reply.
        """
        looked_last = False
        while (reply := self._whole_reply()) is None:
            if looked_last:
                raise self._silent()
            looked_last = self._clock.now_ns() >= deadline_ns
            self._fill(deadline_ns)
        return reply

    def _whole_reply(self) -> bytes | None:
        length = reply_length(bytes(self._received))
        if length is None or len(self._received) < length:
            return None
        reply = bytes(self._received[:length])
        del self._received[:length]
        return reply

    def wait_quiet(self, gap_ns: int, deadline_ns: int) -> None:
        """Lets a broken reply run out: returns after `gap_ns` without a byte. Raises SilentError at the deadline."""
        while True:
            self.discard()
            try:
                self._fill(min(self._clock.now_ns() + gap_ns, deadline_ns))
            except SilentError:
                if self._clock.now_ns() < deadline_ns:
                    return
                raise
            if self._clock.now_ns() >= deadline_ns:
                raise self._silent()

    def discard(self) -> bytes:
        """Discards everything received so far, and returns it."""
        while self._readable(0):
            self._receive()
        dropped = bytes(self._received)
        self._received.clear()
        return dropped

    def _fill(self, deadline_ns: int) -> None:
        """Reads what comes next, or is already there. Raises SilentError when nothing comes."""
        remaining_ns = max(0, deadline_ns - self._clock.now_ns())
        if not self._readable(self._clock.real_s(remaining_ns / 1e9)):
            raise self._silent()
        self._receive()

    def _silent(self) -> SilentError:
        got = f"only {len(self._received)} bytes of a reply" if self._received else "no reply"
        return SilentError(f"{got} from the tracker", self.where, "Check that it is switched on and plugged in")

    def _readable(self, real_s: float) -> bool:
        try:
            return bool(select.select([self._line.fileno()], [], [], real_s)[0])
        except LINE_ERRORS as error:
            raise self._lost(error) from error

    def _receive(self) -> None:
        try:
            data = self._line.read()
        except LINE_ERRORS as error:
            raise self._lost(error) from error
        if not data:
            raise self._lost(OSError("the other end closed it"))
        if self._byte_log is not None:
            self._byte_log.received(data)
        self._received += data

    def _remark(self, words: str) -> None:
        if self._byte_log is not None:
            self._byte_log.remark(words)

    def _lost(self, error: Exception) -> DeviceLost:
        kind = "network connection" if self.baud is None else "serial port"
        return DeviceLost(f"the {kind} failed ({error})", self.where, "Check that the cable is plugged in")


def refuse_reset(text: str, where: str) -> str:
    """Returns the text as it is. Raises RebootedError for the word RESET."""
    if text == "RESET":
        raise RebootedError("the tracker restarted by itself", where, "Check its power supply and cables")
    return text


def lost_by_protocol(error: ProtocolError, where: str) -> DeviceLost:
    """Returns the error with which a reply that ends a session is reported to the owner of the device."""
    return DeviceLost(error.what, where, error.remedy or "The connection is made again")
