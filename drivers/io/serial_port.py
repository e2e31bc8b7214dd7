"""Opens a serial port for one owner, and reports in plain words why it cannot."""

import errno
import termios
from pathlib import Path

import serial

from probewatch.drivers.errors import CORRECT_PATH, DeviceLost

BITS_PER_BYTE = 10
"""Bits on the line for one byte, 8N1: a start bit, eight data bits, a stop bit."""

_WRITE_S = 1.0
"""Seconds for the port to take bytes. The kernel's buffer holds thousands, so a port that does not take them is stuck.
More holds up the thread of the device; at 9600 baud 960 bytes leave meanwhile.
"""


def open_serial(path: str, baud: int, raise_lines: bool = True) -> serial.Serial:
    """Opens an 8N1 port that no other program can open at the same time; reads do not block.

    raise_lines: leave RTS and DTR raised, as the kernel does on opening; else they are dropped right after that. Raises
    DeviceLost when the port is absent, in use, or not permitted to this user.
    """
    try:
        port = serial.Serial(None, baud, timeout=0, write_timeout=_WRITE_S, exclusive=True)
        port.rts = port.dtr = raise_lines
        port.port = path
        port.open()
    except (OSError, serial.SerialException) as error:
        raise _refusal(path, error) from error
    return port


def drain(port: serial.Serial) -> None:
    """Waits until the last byte has left. A signal, as of a reload or after a stop, ends tcdrain(3) too early, so it is
    called again.

    Raises OSError, termios.error when the port fails.
    """
    while True:
        try:
            return port.flush()
        except termios.error as error:
            if error.args[0] != errno.EINTR:
                raise


def _refusal(path: str, error: OSError) -> DeviceLost:
    """Returns the fitting error. pyserial reports a lock only in its message, so the kernel's number comes first."""
    busy = error.errno in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(error)
    if busy:
        return DeviceLost("the serial port is in use by another program", path, "Close that program, then try again")
    if error.errno in (errno.EACCES, errno.EPERM):
        remedy = "Add this user to the group 'dialout' (sudo usermod -aG dialout $USER), then log in again"
        return DeviceLost("no permission to open the serial port", path, remedy)
    if not Path(path).exists():
        return DeviceLost("no such serial port", path, "Plug the cable in, or correct the path in the configuration")
    if f"({errno.ENOTTY}," in str(error) or error.errno == errno.EISDIR:
        return DeviceLost("is no serial port", path, CORRECT_PATH)
    return DeviceLost(f"the serial port cannot be opened ({error})", path, "Check cable and adapter")
