"""Shares one serial port between several channels of one board: opened once, it carries one exchange at a time."""

import os
import select
import termios
import threading
from contextlib import suppress
from pathlib import Path

import serial

from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.io.serial_port import drain, open_serial

_open: dict[str, "SharedPort"] = {}
_gates: dict[str, threading.Lock] = {}
"""Locks, one for each path, since opening or closing one port may hang and must not hold up the others."""


class SharedPort:
    """Represents a port with several users. Obtain it from `shared_port`, and hold `exchange` from the first byte of a
    question to the last of its answer.

    A port that has failed once is closed for all its users; each of them finds out at its next exchange.
    """

    def __init__(self, path: str, baud: int) -> None:
        self._path = path
        self._port: serial.Serial = open_serial(path, baud)
        self._users = 0
        self.exchange = threading.Lock()

    def send(self, data: bytes) -> None:
        """Sends the bytes. Raises DeviceLost."""
        try:
            self._port.write(data)
            drain(self._port)
        except (OSError, termios.error) as error:
            raise self._failed(error) from error

    def receive(self, real_s: float) -> bytes:
        """Returns what comes within real_s, which may be nothing. Raises DeviceLost."""
        try:
            if not select.select([self._port.fileno()], [], [], real_s)[0]:
                return b""
            data = os.read(self._port.fileno(), 256)
        except (OSError, ValueError) as error:
            raise self._failed(error) from error
        if not data:
            raise self._failed(OSError("end of file"))
        return data

    def give_back(self) -> None:
        """Removes one user; the last one closes the port."""
        with _gate(self._path):
            self._users -= 1
            if self._users == 0:
                self._close()

    def add_user(self) -> None:
        """Adds a user. May be called only while holding the gate of the path."""
        self._users += 1

    def _failed(self, error: Exception) -> DeviceLost:
        with _gate(self._path):
            self._close()
        return DeviceLost(f"the serial port failed ({error})", self._path, "Check its cable")

    def _close(self) -> None:
        if _open.get(self._path) is self:
            del _open[self._path]
        with suppress(OSError, termios.error):
            self._port.close()


def _gate(path: str) -> threading.Lock:
    return _gates.setdefault(path, threading.Lock())


def shared_port(path: str, baud: int) -> SharedPort:
    """Returns the open port of that path, or a new one; each user gives it back. Raises DeviceLost."""
    real = str(Path(path).resolve())
    with _gate(real):
        port = _open.get(real)
        if port is None:
            port = _open[real] = SharedPort(real, baud)
        port.add_user()
        return port
