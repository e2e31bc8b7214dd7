"""Opens `gpio:/dev/gpiochip0?line=17&active=low`: one line of a GPIO chip that drives a relay. Energised means safe.

Its options are the rows of GPIO, in the `__init__.py` of this folder.

Release: on every orderly end the line is driven to its inactive level first. When the process dies, the kernel takes
the line back, and the chip's driver decides: some return it to its pull, others hold the last level, which would be
"safe". `probewatch release` (the unit's ExecStopPost) then drives it inactive; where that is too slow, use heartbeat=.
"""

import errno
from collections.abc import Iterable
from pathlib import Path

import gpiod
from gpiod.line import Direction, Value

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable
from probewatch.drivers.device_api import Description
from probewatch.drivers.errors import CORRECT_PATH, ConfigurationError, DeviceLost
from probewatch.drivers.outputs import GPIO
from probewatch.drivers.outputs.contact_feedback import follows
from probewatch.drivers.outputs.heartbeat import Heartbeat, heartbeat_from
from probewatch.drivers.printable import printable

_CONSUMER = "probewatch"
_NO_CHIP = (errno.ENODEV, errno.ENOTTY)
"""Error numbers of the kernel for opening a file that is no GPIO chip as one."""

Line = int | str
Settings = dict[Iterable[Line] | Line, gpiod.LineSettings | None]


def open_output(target: str, options: dict[str, str], clock: HostClock) -> "GpioOutput":
    """Opens the line; see drivers.registry for what is raised. It is inactive from the moment it is taken."""
    return GpioOutput(target, *checked(target, options), clock)


def checked(target: str, options: dict[str, str]) -> "tuple[Line, Line | None, Settings, Heartbeat]":
    """Returns (line, sense, settings, heartbeat). Raises ConfigurationError that names the option."""
    where = f"gpio:{target}"
    given = GPIO.given(options, where)
    line, sensed = _line(given.text("line"), where), given.text("sense")
    sense = None if sensed is None else _line(sensed, where)
    if sense == line:
        raise ConfigurationError("line= and sense= are the same line", where, "Read the contact back on another line")
    low, sense_low = (given.word(name) == "low" for name in ("active", "sense_active"))
    settings: Settings = {line: _settings(Direction.OUTPUT, low)}
    if sense is not None:
        settings[sense] = _settings(Direction.INPUT, sense_low)
    return line, sense, settings, heartbeat_from(given)


def _line(text: str | None, where: str) -> Line:
    if not text:
        raise ConfigurationError("names no line", where, "Add ?line= and a number or a name, see `gpioinfo`")
    return int(text) if text.isdecimal() else text


def _settings(direction: Direction, low: bool) -> gpiod.LineSettings:
    return gpiod.LineSettings(direction=direction, active_low=low, output_value=Value.INACTIVE)


class GpioOutput(Closable):
    """Drives one line; sense, where there is one, reports whether the contact followed."""

    def __init__(
        self,
        path: str,
        line: Line,
        sense: Line | None,
        settings: Settings,
        heartbeat: Heartbeat,
        clock: HostClock,
    ) -> None:
        self._path, self._line, self._sense = path, line, sense
        self._heartbeat, self._clock = heartbeat, clock
        self.where = f"gpio:{path} line {line}"
        try:
            self._label = _label(path)
        except OSError as error:
            # ENOENT for a file that is there: the kernel lists no such device, or /sys is not mounted.
            if error.errno in _NO_CHIP or (error.errno == errno.ENOENT and Path(path).exists()):
                raise DeviceLost("is no GPIO chip", self.where, CORRECT_PATH) from error
            raise self._refusal(error) from error
        try:
            self._request = gpiod.request_lines(path, consumer=_CONSUMER, config=settings)
        except (OSError, ValueError) as error:
            raise self._refusal(error) from error

    def close(self) -> None:
        """See Closable."""
        try:
            self._request.set_value(self._line, Value.INACTIVE)
        except OSError:
            return
        finally:
            self._request.release()

    def describe(self) -> Description:
        """See drivers.device_api.Identified."""
        beat = "a square wave for a watchdog relay" if self._heartbeat.half_period_ns else "a steady level"
        back = "the line's own level is read back" if self._sense is None else f"the contact is read on {self._sense}"
        return Description(f"{self._label}, line {self._line}", remarks=(beat, back))

    def write(self, energised: bool) -> None:
        """Drives the line. Returns after it, or the contact where that is wired back, has followed.

        Raises DeviceLost when the chip is gone or does not follow within 0.1 s.
        """
        level = self._heartbeat.level(energised, self._clock.now_ns())
        try:
            self._request.set_value(self._line, Value(int(level)))
            followed = follows(self._is_active, level, self._clock)
        except OSError as error:
            raise self._refusal(error) from error
        if not followed:
            what = "the contact" if self._sense is not None else "the line"
            raise DeviceLost(f"{what} did not follow, it stays {_other(level)}", self.where, "Check relay and wiring")

    def read_back(self) -> bool | None:
        """See drivers.device_api.AlarmOutput."""
        try:
            return self._is_active()
        except OSError as error:
            raise self._refusal(error) from error

    def _is_active(self) -> bool:
        looked_at = self._line if self._sense is None else self._sense
        return bool(self._request.get_value(looked_at) is Value.ACTIVE)

    def _refusal(self, error: OSError | ValueError) -> DeviceLost:
        if isinstance(error, ValueError) or (error.errno == errno.ENOENT and Path(self._path).exists()):
            return DeviceLost("no such line", self.where, "See `gpioinfo` for the lines of this chip")
        if error.errno == errno.EBUSY:
            return DeviceLost("the line is in use by another program", self.where, "See `gpioinfo` for its user")
        if error.errno in (errno.EACCES, errno.EPERM):
            return DeviceLost("no permission to use the chip", self.where, "Add this user to the group 'gpio'")
        if error.errno == errno.ENOENT:
            return DeviceLost("no such GPIO chip", self.where, "`probewatch devices` lists what is there")
        return DeviceLost(f"the GPIO chip failed ({error.strerror})", self.where, "Check its cable or driver")


def _label(path: str) -> str:
    with gpiod.Chip(path) as chip:
        info = chip.get_info()
    return f"{printable(info.label)} ({info.num_lines} lines)"


def _other(wanted: bool) -> str:
    return "inactive" if wanted else "active"
