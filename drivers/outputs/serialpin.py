"""Opens `serialpin:/dev/ttyUSB1?pin=rts`: a control line of a serial port that drives a relay. Energised means safe.

Its options are the rows of SERIALPIN, in the `__init__.py` of this folder.

Release: the kernel drops both lines when the last user closes the port (HUPCL is set for that), so a process that dies
opens the contact at once, and so does a pulled plug. The kernel also RAISES both lines when the port is opened; they
are dropped right after that, so each opening gives a pulse of some milliseconds, which a lamp may show. It cannot be
avoided from user space; use heartbeat= where it must not energise anything.
"""

import termios
from contextlib import suppress

import serial

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable
from probewatch.drivers.device_api import Description
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.io.serial_port import open_serial
from probewatch.drivers.outputs import SERIALPIN
from probewatch.drivers.outputs.contact_feedback import follows
from probewatch.drivers.outputs.heartbeat import Heartbeat, heartbeat_from

_SENSES = {"cts": "cts", "dsr": "dsr", "dcd": "cd"}
_BAUD, _CFLAG = 9600, 2
"""Speed, which only has to be one that every port has, as nothing is sent; index of the control flags in
termios.tcgetattr.
"""


def open_output(target: str, options: dict[str, str], clock: HostClock) -> "SerialPinOutput":
    """Opens the port; see drivers.registry for what is raised."""
    return SerialPinOutput(target, *checked(target, options), clock)


def checked(target: str, options: dict[str, str]) -> tuple[str, str | None, Heartbeat]:
    """Returns (pin, sense, heartbeat). Raises ConfigurationError that names the option."""
    given = SERIALPIN.given(options, f"serialpin:{target}")
    pin = given.word_or_none("pin")
    if pin is None:
        raise given.refusal("pin", "Add ?pin=rts or ?pin=dtr")
    return pin, given.word_or_none("sense"), heartbeat_from(given)


class SerialPinOutput(Closable):
    """Drives one pin; sense, where there is one, reports whether the contact followed."""

    def __init__(self, path: str, pin: str, sense: str | None, heartbeat: Heartbeat, clock: HostClock) -> None:
        self._pin, self._sense, self._heartbeat, self._clock = pin, sense, heartbeat, clock
        self.where = f"serialpin:{path} {pin}"
        self._port: serial.Serial = open_serial(path, _BAUD, raise_lines=False)
        try:
            self._drop_when_closed()
            self._drive(False)
        except BaseException:
            self._port.close()
            raise

    def close(self) -> None:
        """See Closable."""
        with suppress(DeviceLost):
            self._drive(False)
        with suppress(OSError, termios.error):
            self._port.close()

    def describe(self) -> Description:
        """See drivers.device_api.Identified."""
        beat = "a square wave for a watchdog relay" if self._heartbeat.half_period_ns else "a steady level"
        back = "the contact is not read back" if self._sense is None else f"the contact is read on {self._sense}"
        return Description(f"control line {self._pin} of a serial port", remarks=(beat, back))

    def write(self, energised: bool) -> None:
        """Drives the line. Returns after the port took it, and the contact followed where that is wired back.

        Raises DeviceLost when the port fails or the contact does not follow within 0.1 s.
        """
        level = self._heartbeat.level(energised, self._clock.now_ns())
        self._drive(level)
        if self._sense is not None and not follows(self.read_back, level, self._clock):
            stays = "open" if level else "closed"
            raise DeviceLost(f"the contact did not follow, it stays {stays}", self.where, "Check relay and wiring")

    def read_back(self) -> bool | None:
        """See drivers.device_api.AlarmOutput."""
        if self._sense is None:
            return None
        try:
            return bool(getattr(self._port, _SENSES[self._sense]))
        except (OSError, termios.error) as error:
            raise self._lost(error) from error

    def _drive(self, level: bool) -> None:
        try:
            setattr(self._port, self._pin, level)
        except (OSError, termios.error) as error:
            raise self._lost(error) from error

    def _drop_when_closed(self) -> None:
        try:
            settings = termios.tcgetattr(self._port.fileno())
            settings[_CFLAG] |= termios.HUPCL
            termios.tcsetattr(self._port.fileno(), termios.TCSANOW, settings)
        except (OSError, termios.error) as error:
            raise self._lost(error) from error

    def _lost(self, error: Exception) -> DeviceLost:
        return DeviceLost(f"the port's control line failed ({error})", self.where, "Check the adapter and its plug")
