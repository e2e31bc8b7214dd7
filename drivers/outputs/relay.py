"""Opens `relay:/dev/ttyUSB1?channel=1`: one contact of an LCUS-type serial relay board. Energised means safe.

Several outputs may name channels of the same board.

9600 baud 8N1. Command: A0, channel, 00 off or 01 on, sum of the three modulo 256. Boards with a microcontroller answer
the byte FF with `CHn: ON` or `CHn: OFF` lines; the bare LCUS-1 never answers. To find out which it is, the board is
asked when the port is opened, and once a second until it answers; a board that has answered once must continue to do
so. `confirm=yes` refuses a board that does not answer, `confirm=no` does not ask.

heartbeat=HZ, up to 1, clicks the relay for an external watchdog relay; a mechanical one makes some 100 000 clicks under
load, so at 1 Hz it lasts about a day: a GPIO line or a control line of a serial port does this better.

Release: on every orderly end the contact is opened first. The board holds its contact when the process dies or the data
line breaks, and drops it when it loses power. `probewatch release` (the unit's ExecStopPost) opens it then.
"""

import re
from collections.abc import Callable
from contextlib import suppress

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable
from probewatch.drivers.device_api import Description
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.io.serial_port import BITS_PER_BYTE
from probewatch.drivers.io.shared_port import shared_port
from probewatch.drivers.outputs import RELAY
from probewatch.drivers.outputs.heartbeat import Heartbeat, heartbeat_from

BAUD = 9600
STATUS_QUERY = b"\xff"
START = 0xA0
COMMAND_BYTES = 4
"""Protocol of LCUS boards, as the docstring of this module describes it."""

_COMMAND_S = COMMAND_BYTES * BITS_PER_BYTE / BAUD
"""Time on the line, after which a silent board has its command: 4.2 ms."""

_ANSWER_S = 0.5
"""Seconds for the report, which takes about 40 ms (docs/devices.md). More delays the report of a dead board; less loses
one behind a busy host.
"""

_PAUSE_S = 0.05
"""Silence, in seconds, that ends the first report, whose length is unknown; later reports are awaited until they are
whole. USB adapters hold bytes back for up to 16 ms; less cuts a report in two, more delays the opening.
"""

_ASK_AGAIN_NS = 1_000_000_000
"""Time between questions to a board that has not answered so far, ns. Rarer ones leave a board that woke up unwatched
for longer; each costs one byte on the line (tests/drivers/outputs/test_relay.py counts them).
"""

_CONTACT = re.compile(rb"CH *(\d{1,2}) *: *(ON|OFF)\s")
_CHECK = "Check the relay board's cable"


_have_reported: set[str] = set()
"""Ports at which a board has reported: a board that falls silent there has failed, and is no LCUS-1."""


def relay_command(channel: int, energised: bool) -> bytes:
    """Returns the four bytes that switch one channel."""
    body = bytes((START, channel, int(energised)))
    return body + bytes((sum(body) & 0xFF,))


def open_output(target: str, options: dict[str, str], clock: HostClock) -> "RelayOutput":
    """Opens the board's port; see drivers.registry for what is raised. The contact does not change before the first
    write.
    """
    return RelayOutput(target, *checked(target, options), clock)


def checked(target: str, options: dict[str, str]) -> tuple[int, str, Heartbeat]:
    """Returns (channel, confirm, heartbeat). Raises ConfigurationError that names the option."""
    given = RELAY.given(options, f"relay:{target}")
    return given.integer("channel"), given.word("confirm"), heartbeat_from(given)


class RelayOutput(Closable):
    """Switches one contact. confirmed: whether the board reports its contacts, so that a write that it did not take is
    noticed.
    """

    def __init__(self, path: str, channel: int, confirm: str, heartbeat: Heartbeat, clock: HostClock) -> None:
        self._path, self._channel, self._heartbeat, self._clock = path, channel, heartbeat, clock
        self._port = shared_port(path, BAUD)
        self.confirmed, self._asks = False, confirm != "no"
        self._reported = 0
        self._asked_ns = clock.now_ns()
        try:
            self.confirmed = self._asks and self._learn_report()
            self._insist(confirm == "yes" or (confirm == "auto" and path in _have_reported))
        except BaseException:
            self._port.give_back()
            raise

    def _insist(self, must_report: bool) -> None:
        if self.confirmed:
            _have_reported.add(self._path)
        elif must_report:
            remedy = f"{_CHECK}, or use confirm=no for a board that never does"
            raise DeviceLost("the relay board does not report its contacts", self._path, remedy)

    def close(self) -> None:
        """See Closable."""
        with suppress(DeviceLost):
            self.write(False)
        self._port.give_back()

    def describe(self) -> Description:
        """See drivers.device_api.Identified."""
        remark = "it reports its contacts" if self.confirmed else "it does not report its contacts"
        return Description(f"LCUS-type relay board, contact {self._channel}", remarks=(remark,))

    def write(self, energised: bool) -> None:
        """Switches the contact. Returns after the board confirmed it or, for a silent board, after the last byte left.

        Raises DeviceLost when the port fails or the board reports the other state.
        """
        level = self._heartbeat.level(energised, self._clock.now_ns())
        with self._port.exchange:
            self._port.send(relay_command(self._channel, level))
        if self.confirmed:
            self._confirm(level)
        else:
            self._clock.sleep_until(self._clock.now_ns() + round(_COMMAND_S * 1e9))
            self._ask_again()

    def read_back(self) -> bool | None:
        """See drivers.device_api.AlarmOutput."""
        return self._state() if self.confirmed else None

    def _confirm(self, energised: bool) -> None:
        state = self._state()
        if state is None:
            raise DeviceLost("the relay board does not answer", self._path, _CHECK)
        if state is not energised:
            said = "closed" if state else "open"
            raise DeviceLost(f"the relay board did not switch, its contact is {said}", self._path, "Replace the board")

    def _ask_again(self) -> None:
        """Asks a silent board again, without waiting for the answer. Otherwise a board that was starting, or hung, when
        it was first asked would never be missed.
        """
        if not self._asks:
            return
        with self._port.exchange:
            heard = self._port.receive(0)
            if not heard and self._clock.now_ns() - self._asked_ns >= _ASK_AGAIN_NS:
                self._asked_ns = self._clock.now_ns()
                self._port.send(STATUS_QUERY)
        self.confirmed = b"CH" in heard and self._learn_report()
        self._insist(False)

    def _learn_report(self) -> bool:
        """Returns whether the board reports its contacts; a report is whole when the board falls silent after it.

        Raises DeviceLost when this contact is not among them: it can never close.
        """
        with self._port.exchange:
            contacts = _contacts(self._ask(lambda _: False, _PAUSE_S))
        self._reported = len(contacts)
        if contacts and self._channel not in contacts:
            what = f"the relay board has no contact {self._channel}, it reports {', '.join(map(str, sorted(contacts)))}"
            raise DeviceLost(what, self._path, "Correct channel= in the URL, or use confirm=no")
        return bool(contacts)

    def _state(self) -> bool | None:
        """Returns the contact's state as the board reports it; None without an answer."""
        with self._port.exchange:
            received = self._ask(lambda received: len(_CONTACT.findall(received)) >= self._reported, _ANSWER_S)
        return _contacts(received).get(self._channel)

    def _ask(self, whole: Callable[[bytes], bool], pause_s: float) -> bytes:
        """Asks for the report and returns it; it ends when it is whole, after a pause, or at the deadline."""
        self._port.receive(0)
        self._port.send(STATUS_QUERY)
        deadline_ns = self._clock.now_ns() + round(_ANSWER_S * 1e9)
        received = b""
        while not whole(received):
            left_ns = deadline_ns - self._clock.now_ns()
            wait_s = self._clock.real_s(max(0, left_ns) / 1e9)
            heard = self._port.receive(min(wait_s, pause_s) if received else wait_s)
            received += heard
            if left_ns <= 0 or not heard:
                break  # what came while this host was busy has been read by one more receive
        return received


def _contacts(report: bytes) -> dict[int, bool]:
    """Returns channel → closed; one that is reported as both counts as not reported."""
    found = {(int(channel), state == b"ON") for channel, state in _CONTACT.findall(report)}
    return {channel: closed for channel, closed in found if (channel, not closed) not in found}
