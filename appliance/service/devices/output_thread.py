"""Drives each alarm output in a thread of its own, so that one that hangs delays neither the tick nor the others."""

import threading
from collections.abc import Callable
from dataclasses import dataclass

from probewatch.appliance.service.devices.device_thread import DeviceThread
from probewatch.appliance.service.host.delay_histogram import DelayHistogram
from probewatch.appliance.supervision.annunciator import Role
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.device_api import AlarmOutput

_COMMAND_LIFE_S = 0.25
"""s, how long a command holds an output: five ticks. More keeps the contact closed after a tick that hangs; less opens
it for a tick that is late (docs/failures.md).
"""
_BOUNDS_MS = (1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 50.0, 75.0, 100.0, 150.0, 250.0, 500.0, 1000.0)
"""ms, bounds of the histogram of delays: a relay on a serial port needs some ms, a late tick some ten, and 250 is the
lifetime of a command.
"""


@dataclass(frozen=True, slots=True)
class _Command:
    """Holds a command. given_ns: when its cause became known. commanded_ns: when it was given, CLOCK_MONOTONIC."""

    energised: bool
    given_ns: int
    commanded_ns: int


class OutputThread(DeviceThread):
    """Writes the last command of the tick; without a fresh one, as when the tick hangs, it writes de-energised.

    signal: the signal that the output shows. written_ns: time of the last completed write. writes: number of writes.
    energised: what was written last, None before the first write and after a loss. slowest_ms, delays: longest time
    from what caused a change to the completed write, and the histogram of all of them.
    """

    def __init__(
        self, signal: Role, url: str, open_output: Callable[[str, HostClock], AlarmOutput], clock: HostClock
    ) -> None:
        super().__init__("output", url, clock)
        self.signal = signal
        self._open = open_output
        self._life_s = max(_COMMAND_LIFE_S, clock.real_s(_COMMAND_LIFE_S))  # ticks of a slower clock come later
        self._wake = threading.Event()
        self._command: _Command | None = None
        self.written_ns: int | None = None
        self.writes = 0
        self.energised: bool | None = None
        self.slowest_ms = 0.0
        self.delays = DelayHistogram(_BOUNDS_MS)

    def command(self, energised: bool, given_ns: int) -> None:
        """Sets the command; never blocks. given_ns: when its cause became known, from which the delay counts."""
        self._command = _Command(energised, given_ns, self._clock.real_ns())
        self._wake.set()

    def stop(self) -> None:
        super().stop()
        self._wake.set()

    def work(self) -> None:
        try:
            with self._open(self.url, self._clock) as output:
                while not self._stopping.is_set():
                    self._write(output, self._next())
        finally:
            self.energised = False if self._stopping.is_set() else None  # what a lost output shows is not known

    def _next(self) -> _Command:
        """Returns the command just given, or de-energised when none was given in time."""
        given = self._clock.wait(self._wake, self._life_s)
        self._wake.clear()
        command, now_ns = self._command, self._clock.real_ns()
        if given and command is not None and now_ns - command.commanded_ns < self._life_s * 1e9:
            return command
        return _Command(False, self._clock.now_ns(), now_ns)

    def _write(self, output: AlarmOutput, command: _Command) -> None:
        if self._stopping.is_set():
            return
        output.write(command.energised)
        now_ns = self._clock.now_ns()
        if command.energised != self.energised:
            self._note_switch(command.energised, (now_ns - command.given_ns) / 1e6)
        self.energised, self.written_ns = command.energised, now_ns
        self.writes += 1
        self.note_success()

    def _note_switch(self, energised: bool, delay_ms: float) -> None:
        self.slowest_ms = max(self.slowest_ms, delay_ms)
        self.delays.note(delay_ms)
        loud = self.signal is Role.CONTACT and self.overload_ns is None
        log = self._log.info if loud else self._log.debug
        log("contact", signal=self.signal.value, energised=energised, delay_ms=round(delay_ms, 3))
