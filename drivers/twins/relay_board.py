"""Simulates an LCUS relay board, which prints every change of a contact."""

from collections.abc import Callable
from threading import Event

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.outputs.relay import BAUD, COMMAND_BYTES, START, STATUS_QUERY
from probewatch.drivers.twins.events import Events
from probewatch.drivers.twins.pty_line import IDLE_S, PtyLine

Change = dict[str, int | bool]
"""{"t_ns": time by the clock, "channel": number, "energised": whether it has closed}."""


class RelayBoard:
    """Switches contacts as commanded. contacts: channel → closed. answers: whether it reports its contacts when asked,
    as boards with a microcontroller do. on_change: is called with every change; without it they are printed.
    """

    def __init__(
        self,
        line: PtyLine,
        clock: HostClock,
        channels: int = 1,
        answers: bool = True,
        on_change: Callable[[Change], None] | None = None,
    ) -> None:
        self.contacts = dict.fromkeys(range(1, channels + 1), False)
        self.stuck = False
        self._line, self._clock, self._answers, self._on_change = line, clock, answers, on_change or Events(clock).tell
        self._received = bytearray()

    def run(self, stop: Event) -> None:
        """Serves the line until stop is set."""
        while not stop.is_set():
            self._received += self._line.read(IDLE_S)
            while self._received:
                if not self._take():
                    break

    def _take(self) -> bool:
        """Consumes one command, or one byte that starts none. Returns False while a command is incomplete."""
        if self._received.startswith(STATUS_QUERY):
            del self._received[:1]
            self._report()
            return True
        if self._received[0] != START:
            del self._received[:1]
            return True
        if len(self._received) < COMMAND_BYTES:
            return False
        command = bytes(self._received[:COMMAND_BYTES])
        valid = sum(command[:3]) & 0xFF == command[3] and command[1] in self.contacts and command[2] <= 1
        del self._received[: COMMAND_BYTES if valid else 1]
        if valid and not self.stuck:
            self._switch(command[1], bool(command[2]))
        return True

    def _switch(self, channel: int, energised: bool) -> None:
        if self.contacts[channel] == energised:
            return
        self.contacts[channel] = energised
        self._on_change({"t_ns": self._clock.now_ns(), "channel": channel, "energised": energised})

    def _report(self) -> None:
        if self._answers:
            lines = (f"CH{channel}: {'ON' if closed else 'OFF'}\r\n" for channel, closed in self.contacts.items())
            self._line.write("".join(lines).encode(), BAUD, self._clock.now_ns())
