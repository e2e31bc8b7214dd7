"""The line to the tracker: whole replies in, whole requests out, and a deadline on every wait."""

import os
import select
import termios
from contextlib import suppress

import serial

from drivers.errors import DeviceLost, ProtocolError
from drivers.hosttime import HostClock
from drivers.ndi.wire import encode_text, reply_length
from drivers.serialport import open_serial

FIRST_BAUD = 9600
"""8N1 at this rate after power-up and after every reset."""

_RESET = encode_text("RESET")
_BREAK_S = 0.25
_BREAK_BAUD = 300
_BITS_PER_BYTE = 10


class SilentError(DeviceLost):
    """No whole reply within the deadline."""


class RebootedError(DeviceLost):
    """The tracker said RESET: handles, tracking and line settings are gone."""


class Link:
    """Half-duplex requests and replies over one serial port. path: the device, also for messages.

    Every method raises DeviceLost when the port fails; read_reply also raises SilentError and ProtocolError.
    """

    def __init__(self, path: str, clock: HostClock) -> None:
        self.path = path
        self._clock = clock
        self._port: serial.Serial = open_serial(path, FIRST_BAUD)
        self._received = bytearray()

    @property
    def baud(self) -> int:
        """Bits per second of the host's side."""
        return int(self._port.baudrate)

    def close(self) -> None:
        """Give the port back."""
        with suppress(OSError, termios.error):
            self._port.close()

    def set_baud(self, baud: int) -> None:
        """Change the host's side; what was received at the old rate is thrown away."""
        try:
            self._port.baudrate = baud
        except (OSError, ValueError, termios.error) as error:
            raise self._lost(error) from error
        self.discard()

    def transfer_ns(self, count: int) -> int:
        """Time on the wire of `count` bytes, ns of the clock."""
        return count * _BITS_PER_BYTE * 1_000_000_000 // self.baud

    def send(self, request: bytes) -> None:
        """Throw away what came late, then write. Raises RebootedError when that was the word RESET."""
        if _RESET in self.discard():
            raise RebootedError("the tracker restarted by itself", self.path, "Check its power supply and cables")
        try:
            self._port.write(request)
        except (OSError, termios.error) as error:
            raise self._lost(error) from error

    def send_break(self) -> None:
        """Hold the line low, so that the device resets, then listen at 9600 baud.

        Some adapters ignore the break request, so a NUL at 300 baud follows: 30 ms low, a break to any faster receiver.
        """
        try:
            self._port.send_break(_BREAK_S)
            self._port.baudrate = _BREAK_BAUD
            self._port.write(b"\0")
            self._port.flush()
        except (OSError, termios.error) as error:
            raise self._lost(error) from error
        self._clock.sleep_until(self._clock.now_ns() + 60_000_000)
        self.set_baud(FIRST_BAUD)

    def read_reply(self, deadline_ns: int) -> bytes:
        """One whole reply, text or binary.

        Raises SilentError at the deadline, ProtocolError as soon as the bytes cannot be a reply.
        """
        while (length := reply_length(bytes(self._received))) is None or len(self._received) < length:
            self._fill(deadline_ns)
        reply = bytes(self._received[:length])
        del self._received[:length]
        return reply

    def wait_quiet(self, gap_ns: int, deadline_ns: int) -> None:
        """Let a broken reply run out: returns after `gap_ns` without a byte. Raises SilentError at the deadline."""
        while True:
            self.discard()
            try:
                self._fill(min(self._clock.now_ns() + gap_ns, deadline_ns))
            except SilentError:
                if self._clock.now_ns() < deadline_ns:
                    return
                raise

    def discard(self) -> bytes:
        """Forget everything received so far, and return it."""
        while self._readable(0):
            self._receive()
        dropped = bytes(self._received)
        self._received.clear()
        return dropped

    def _fill(self, deadline_ns: int) -> None:
        remaining_ns = deadline_ns - self._clock.now_ns()
        if remaining_ns <= 0 or not self._readable(self._clock.real_s(remaining_ns / 1e9)):
            got = f"only {len(self._received)} bytes of a reply" if self._received else "no reply"
            raise SilentError(f"{got} from the tracker", self.path, "Check that it is switched on and plugged in")
        self._receive()

    def _readable(self, real_s: float) -> bool:
        return bool(select.select([self._port.fileno()], [], [], real_s)[0])

    def _receive(self) -> None:
        try:
            data = os.read(self._port.fileno(), 4096)
        except OSError as error:
            raise self._lost(error) from error
        if not data:
            raise self._lost(OSError("end of file"))
        self._received += data

    def _lost(self, error: Exception) -> DeviceLost:
        return DeviceLost(f"the serial port failed ({error})", self.path, "Check that the cable is plugged in")


def refuse_reset(text: str, path: str) -> str:
    """The text as it is. Raises RebootedError for the word RESET."""
    if text == "RESET":
        raise RebootedError("the tracker restarted by itself", path, "Check its power supply and cables")
    return text


def lost_by_protocol(error: ProtocolError, path: str) -> DeviceLost:
    """A reply that ends a session, as the owner of the device shall see it."""
    return DeviceLost(error.what, path, error.remedy or "The connection is made anew")
