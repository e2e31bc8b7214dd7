"""`python -m drivers.twins.relay_board --pty LINK`: a simulated LCUS relay board; prints every change of a contact."""

import argparse
import json
import signal
import sys
from pathlib import Path
from threading import Event

from drivers.clock.host_clock import HostClock
from drivers.outputs.relay import BAUD, COMMAND_BYTES, START, STATUS_QUERY
from drivers.twins.pty_line import IDLE_S, PtyLine


class RelayBoard:
    """contacts: channel → closed. answers: reports its contacts when asked, as boards with a microcontroller do."""

    def __init__(self, line: PtyLine, clock: HostClock, channels: int = 1, answers: bool = True) -> None:
        self.contacts = dict.fromkeys(range(1, channels + 1), False)
        self.stuck = False
        self._line, self._clock, self._answers = line, clock, answers
        self._received = bytearray()

    def run(self, stop: Event) -> None:
        """Serve the line until stop is set."""
        while not stop.is_set():
            self._received += self._line.read(IDLE_S)
            while self._received:
                if not self._take():
                    break

    def _take(self) -> bool:
        """Consume one command, or one byte that starts none. False while a command is incomplete."""
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
        json.dump({"t_ns": self._clock.now_ns(), "channel": channel, "energised": energised}, sys.stdout)
        print(flush=True)

    def _report(self) -> None:
        if self._answers:
            lines = (f"CH{channel}: {'ON' if closed else 'OFF'}\r\n" for channel, closed in self.contacts.items())
            self._line.write("".join(lines).encode(), BAUD, self._clock.now_ns())


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="relay twin", description=__doc__)
    parser.add_argument("--pty", type=Path, required=True, metavar="LINK", help="symbolic link to make for the host")
    parser.add_argument("--origin-ns", type=int, required=True, help="CLOCK_MONOTONIC of world time 0")
    parser.add_argument("--rate", type=float, default=1.0, help="world seconds per second")
    parser.add_argument("--seed", type=int, default=1, help="taken for the sake of a common command line; unused")
    parser.add_argument("--channels", type=int, default=1)
    parser.add_argument("--mute", action="store_true", help="never answer, like the bare LCUS-1")
    return parser.parse_args()


def main() -> None:
    """Serve until SIGTERM or SIGINT."""
    arguments = _arguments()
    stop = Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    clock = HostClock(arguments.rate, arguments.origin_ns)
    with PtyLine(arguments.pty, clock) as line:
        board = RelayBoard(line, clock, arguments.channels, not arguments.mute)
        print(json.dumps({"ready": True, "url": f"relay:{arguments.pty}?channel=1"}), flush=True)
        board.run(stop)


if __name__ == "__main__":
    main()
