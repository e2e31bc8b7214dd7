"""Provides a serial line of which one end is a pseudo-terminal that the real driver opens by a fixed name.

A pseudo-terminal does not model all of a line: a break is invisible here (drivers send a NUL at a slow rate as well),
control lines are absent, and bytes sent at the wrong speed arrive unharmed unless the twin spoils them.
"""

import fcntl
import os
import select
import struct
import termios
import tty
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable
from probewatch.drivers.io.serial_port import BITS_PER_BYTE

IDLE_S = 0.05
"""Seconds of the clock for which a twin waits on its line before it checks whether to stop, and its faults. More shows
a fault later, less wakes an idle twin more often."""

_SLICE_S = 0.001
"""Seconds: shortest wall time for which writing sleeps; faster bytes go out together. Linux wakes a sleeper some 0.1 ms
late, so shorter slices would not be more accurate."""

_TCGETS2, _TERMIOS2_BYTES, _OSPEED_AT = 0x802C542A, 44, 40
"""Linux, asm-generic/termbits.h: the request, sizeof(struct termios2), and c_ospeed in it. Python's termios knows no
speeds but the usual ones."""


class TwinLine(Protocol):
    """Represents the device's end of a line, whatever carries it.

    source: distinguishes who sent what read() returned. monitor: whether that connection came later than another one
    that is still there.
    """

    @property
    def source(self) -> int: ...
    @property
    def monitor(self) -> bool: ...

    def __enter__(self) -> Self: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None: ...

    def plug(self) -> None:
        """Lets the host open the device."""

    def unplug(self) -> None:
        """Makes the host's reads end in an error from now on, as when the cable is pulled."""

    def hears(self, baud: int) -> bool:
        """Returns whether the host speaks at this line speed."""

    def read(self, timeout_s: float) -> bytes:
        """Returns what the host has sent; empty when nothing came within timeout_s of the clock."""

    def write(self, data: bytes, baud: int, start_ns: int) -> None:
        """Sends to the host from which read() last returned bytes, the first byte from start_ns on; returns after the
        last byte.
        """


class PtyLine(Closable):
    """Represents the device's end. link: path of the symbolic link to the host's end; an older link is replaced."""

    source, monitor = 0, False

    def __init__(self, link: Path, clock: HostClock) -> None:
        self._link, self._clock = link, clock
        self.plug()

    def close(self) -> None:
        """See Closable."""
        self.unplug()

    def plug(self) -> None:
        """Makes a pseudo-terminal and lets the link point to it."""
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave, termios.TCSANOW)
        self._name = os.ttyname(self._slave)
        fresh = self._link.with_name(f".{self._link.name}.{os.getpid()}")
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(self._name)
        fresh.replace(self._link)

    def unplug(self) -> None:
        """Makes the host's reads end in an error from now on, and removes the link, as when the adapter is pulled.

        The link goes first: the kernel gives the number of a closed pseudo-terminal to the next program that asks, and
        the host would open another program's device by it.
        """
        with suppress(OSError):
            if str(self._link.readlink()) == self._name:
                self._link.unlink()
        for end in (self._master, self._slave):
            with suppress(OSError):
                os.close(end)
        self._master = self._slave = -1

    @property
    def host_baud(self) -> int:
        """Returns the bits per second that the host has set."""
        settings = fcntl.ioctl(self._slave, _TCGETS2, bytes(_TERMIOS2_BYTES))
        return int(struct.unpack_from("=I", settings, _OSPEED_AT)[0])

    def hears(self, baud: int) -> bool:
        """Returns whether the host has set this line speed."""
        return self.host_baud == baud

    def read(self, timeout_s: float) -> bytes:
        """Returns what the host has sent; empty when nothing came within timeout_s of the clock."""
        if not select.select([self._master], [], [], self._clock.real_s(timeout_s))[0]:
            return b""
        return os.read(self._master, 4096)

    def write(self, data: bytes, baud: int, start_ns: int) -> None:
        """Sends byte after byte as a line of `baud` would, the first from start_ns on; returns after the last."""
        duration_ns = len(data) * BITS_PER_BYTE * 1_000_000_000 // baud
        slices = max(1, min(len(data), int(self._clock.real_s(duration_ns / 1e9) / _SLICE_S)))
        for i in range(slices):
            begin, end = len(data) * i // slices, len(data) * (i + 1) // slices
            self._clock.sleep_until(start_ns + duration_ns * end // max(len(data), 1))
            os.write(self._master, data[begin:end])
