"""Carries the bytes of the Combined API over a serial port, or over a TCP connection (Vega)."""

import os
import socket
import termios
from contextlib import suppress
from typing import Protocol

import serial

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.io.serial_port import drain, open_serial
from probewatch.drivers.io.tcp_line import SEND_S, connect_tcp

FIRST_BAUD = 9600
"""Bits per second, 8N1, after power-up and after every reset."""

LINE_ERRORS = (OSError, ValueError, termios.error)
"""Errors that a line may raise besides DeviceLost; ValueError comes from a port that is closed."""

_BREAK_S = 0.25
"""Seconds for which the line is held low, as long as in NDI's own sample program. They are part of the 1.31 s that a
reset costs (tests/live/test_tracker_loss.py); some devices may not take shorter ones for a break.
"""

_BREAK_BAUD = 300
_BREAK_NS = 60_000_000
"""A NUL at 300 baud is low for 30 ms, longer than a character at any of the device's speeds, and takes 33 ms. After
60 ms, what an adapter still held of it has left. More delays every reset. Not measured on adapters.
"""

_CONNECT_S = 1.0
"""Seconds for the name, the addresses and the handshake of one attempt. More delays the report that no device is there;
a lost SYN, which Linux repeats after a second, is left to the next attempt.
"""

_STARTING_NS = 1_750_000_000
"""Time, ns, within which a device that refuses connections may be starting: two seconds with the last pause. The
simulated Vega takes one (tests/live/test_tracker_loss.py); how long a real one takes is not published. More delays the
report of a wrong host.
"""

_PAUSE_NS = 200_000_000
"""Pause between two attempts, ns. A shorter one loads a device that is starting; a longer one finds it later."""

_KEEPALIVE = (
    (socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1),
    (socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, 1),
    (socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, 1),
    (socket.IPPROTO_TCP, socket.TCP_KEEPCNT, 3),
)
"""Ends a connection whose peer died while nothing was sent: Linux probes it after 1 s, then each second. It gives up by
the TCP_USER_TIMEOUT of connect_tcp, which takes precedence over the count (tcp(7)). Requests have deadlines of their
own.
"""


class ByteLine(Protocol):
    """Carries bytes to and from the device. where: the device, for messages. baud: bits per second of the host's side,
    None where there is no line speed.

    Methods raise DeviceLost or one of LINE_ERRORS when the line has failed.
    """

    where: str

    @property
    def baud(self) -> int | None: ...

    def fileno(self) -> int:
        """Returns the descriptor for select()."""

    def read(self) -> bytes:
        """Returns what has come; empty at the end of the line."""

    def write(self, data: bytes) -> None:
        """Sends all of it."""

    def set_baud(self, baud: int) -> None:
        """Changes the line speed of the host's side."""

    def reset(self, clock: HostClock) -> None:
        """Makes the device restart: by a break on a serial line, by a new connection on a network."""

    def close(self) -> None:
        """Releases the line; never raises."""


class SerialLine:
    """Carries bytes over a serial port. where: path of the port. Raises DeviceLost when it cannot be opened."""

    def __init__(self, where: str) -> None:
        self.where = where
        self._port: serial.Serial = open_serial(where, FIRST_BAUD)

    @property
    def baud(self) -> int:
        return int(self._port.baudrate)

    def fileno(self) -> int:
        return int(self._port.fileno())

    def read(self) -> bytes:
        return os.read(self.fileno(), 4096)

    def write(self, data: bytes) -> None:
        self._port.write(data)

    def set_baud(self, baud: int) -> None:
        self._port.baudrate = baud

    def reset(self, clock: HostClock) -> None:
        """Holds the line low, so that the device resets, then listens at 9600 baud.

        Some adapters ignore the break request, so a NUL at 300 baud follows: 30 ms low, a break to any faster receiver.
        """
        self._port.send_break(_BREAK_S)
        self._port.baudrate = _BREAK_BAUD
        self._port.write(b"\0")
        drain(self._port)
        clock.sleep_until(clock.now_ns() + _BREAK_NS)
        self._port.baudrate = FIRST_BAUD

    def close(self) -> None:
        with suppress(*LINE_ERRORS):
            self._port.close()


class NetworkLine:
    """Carries bytes over a TCP connection. where: `host:port`. It waits for a device that is just restarting.

    Raises DeviceLost when nothing answers there within two seconds of the clock.
    """

    baud = None

    def __init__(self, host: str, port: int, clock: HostClock) -> None:
        self.where = f"{host}:{port}"
        self._host, self._port = host, port
        self._socket = self._connect_before_timeout(clock)

    def fileno(self) -> int:
        return self._socket.fileno()

    def read(self) -> bytes:
        return self._socket.recv(65536)

    def write(self, data: bytes) -> None:
        """Sends all of it. Raises TimeoutError where the other side does not take it within a tenth of a second."""
        self._socket.sendall(data)

    def set_baud(self, baud: int) -> None:
        """Does nothing, because a network connection has no line speed."""

    def reset(self, clock: HostClock) -> None:
        """Makes a new connection, since the one to a device that resets is lost."""
        self.close()
        self._socket = self._connect()

    def close(self) -> None:
        self._socket.close()

    def _connect_before_timeout(self, clock: HostClock) -> socket.socket:
        end_ns = clock.now_ns() + _STARTING_NS
        while True:
            try:
                return self._connect()
            except DeviceLost:
                if clock.now_ns() > end_ns:
                    raise
            clock.sleep_until(clock.now_ns() + _PAUSE_NS)

    def _connect(self) -> socket.socket:
        connection = connect_tcp(self._host, self._port, _CONNECT_S)
        connection.settimeout(SEND_S)
        for level, option, value in _KEEPALIVE:
            connection.setsockopt(level, option, value)
        return connection
