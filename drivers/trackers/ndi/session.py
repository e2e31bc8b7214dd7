"""Brings a device in any state to tracking, and back: INIT, line speed, identity, tracking mode."""

from contextlib import suppress

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError, DeviceLost, ProtocolError
from probewatch.drivers.printable import printable
from probewatch.drivers.trackers.ndi.identity import Identity, identity_of
from probewatch.drivers.trackers.ndi.link import Link, RebootedError, SilentError, lost_by_protocol, refuse_reset
from probewatch.drivers.trackers.ndi.port_handles import PortHandles
from probewatch.drivers.trackers.ndi.status_text import BUMPED
from probewatch.drivers.trackers.ndi.tools import RequestedTool, Tool
from probewatch.drivers.trackers.ndi.transport import FIRST_BAUD
from probewatch.drivers.trackers.ndi.wire import Command, RefusedError, decode_text, encode_command

COMM_CODES = {
    9600: "0",
    14400: "1",
    19200: "2",
    38400: "3",
    57600: "4",
    115200: "5",
    921600: "6",
    1228739: "7",
    230400: "A",
}
"""Combined API, COMM: bits per second → first digit."""

_USUAL_BAUDS = (FIRST_BAUD, 115200)
"""Speeds at which trackers are found: that of power-up, and that of clients which never switch back."""

_S = 1_000_000_000
_REPLY_S = 2.0
_SLOW_S = {"INIT": 6.0, "PINIT": 6.0, "TSTART": 6.0, "SET": 8.0, "GET": 8.0}
"""Seconds for a reply. A Vicra publishes (Info.Timeout) 2 for most commands, 6 for PINIT and TSTART, 8 for SET and GET,
and 4 for INIT, of which the first may take 5 according to other clients. More delays the report of a device that has
failed; less gives up on one that is busy.
"""

_REPLY_BYTES = 64
"""Bytes of the reply to a command whose time on the line is granted twice over, in addition to those seconds: 67 ms at
9600 baud. Longer replies use up some of the seconds.
"""

_KNOCK_S = 0.3
"""Seconds for INIT at a speed that may be wrong. ndicapi allows 0.2 s. More delays the search by that much for each of
nine speeds; less misses a device that is busy. All first connections of tests/drivers/trackers/ndi/test_connection.py
succeed with it.
"""

_LISTEN_S = 1.5
_SEARCH_S = 8.0
"""Seconds after a break: for INIT at 9600 baud in each round, and for all rounds. Simulated devices are back after 1 s;
ndicapi waits 7 s for a real one to send RESET. More delays the report that no device is there; less misses a slow
start.
"""

_SWITCH_S = 0.1
"""Seconds between the OKAY to COMM and the first byte at the new speed; other clients wait 0.1 to 0.2 s. Less may find
the device still at the old one; more delays each connection.
"""

_NETWORK_KNOCK_S = 1.0
_NETWORK_SEARCH_S = 12.0
_RECONNECT_S = 0.25
"""Seconds on a network: for INIT, for the whole search after RESET, and between its connections. Clients wait 8 s after
RESET; how soon a Vega listens again is not published. More delays the report that it does not come back.
"""

_QUIET_NS, _RUN_OUT_NS = 50_000_000, 500_000_000
"""Silence that ends a damaged or late reply, and the time after which it is no longer waited for, ns. The silence is
twice that of a tracking reply (drivers.trackers.ndi.exchange), as nothing is urgent here; 0.5 s are 480 bytes at 9600
baud.
"""

_LEAVE_S = 0.5
"""Seconds for each of the two last commands. A device that is gone delays the next connection by them; less may leave a
slow one tracking.
"""

_CONNECT_ATTEMPTS = 3
"""Number of attempts at the start sequence. Where one in five has a damaged reply, as users report of high line speeds,
all three fail once in 125. Each may take seconds, and a line worse than that is to be reported.
"""

_MONITOR = "WARNING06"
_SILENT_REMEDY = "Check that it is switched on and that the cable sits at both ends"


class HeldError(DeviceLost):
    """Reports that another computer commands the tracker, so that this connection may only watch."""


class Session:
    """Controls one tracker behind one link. Methods raise DeviceLost; `command` and `parameter` also ProtocolError.

    identity, tools: known once start() has returned. warnings: what the device remarked meanwhile.
    """

    def __init__(self, link: Link, clock: HostClock) -> None:
        self.link = link
        self.warnings: list[str] = []
        self.identity = identity_of("", "")
        self.tools: tuple[Tool, ...] = ()
        self._clock = clock

    def command(self, name: str, arguments: str = "", timeout_s: float | None = None) -> str:
        """Sends a command, and returns the text of the reply. Raises RefusedError for ERRORxx; WARNINGxx counts as done
        and is kept.
        """
        wait_s = timeout_s or _SLOW_S.get(name, _REPLY_S)
        request = encode_command(Command(name, arguments))
        self.link.send(request)
        spare_ns = 2 * self.link.transfer_ns(len(request) + _REPLY_BYTES)
        reply = self.link.read_reply(self._clock.now_ns() + round(wait_s * _S) + spare_ns)
        text = refuse_reset(decode_text(reply), self.link.where)
        if text.startswith("WARNING"):
            self.warnings.append(printable(f"{name}: {text}"))
        return text

    def parameter(self, name: str, timeout_s: float | None = None) -> int | None:
        """Returns a number that the device publishes; None where it does not know it."""
        try:
            return int(self.command("GET", name, timeout_s).strip().rpartition("=")[2])
        except (RefusedError, ValueError):
            return None

    def start(self, baud: int, requested_tools: tuple[RequestedTool, ...]) -> None:
        """Brings the device to tracking, with the requested tools first, in their order, then all others it has.

        Where no wireless tool is requested, none is loaded. If a reply is damaged or does not come, the whole sequence
        starts again once the line is quiet, since a late reply must not be taken for the answer to another command;
        that is harmless in any state.

        Raises DeviceLost, or ConfigurationError for a line speed that the device does not have.
        """
        for _ in range(_CONNECT_ATTEMPTS):
            try:
                self._find(baud)
                self._switch(baud)
                self.identity = self._ask_identity()
                self.tools = PortHandles(self.command, self.link.where, self.warnings).start(requested_tools)
                self.command("TSTART")
                return
            except RefusedError as error:
                raise lost_by_protocol(error, self.link.where) from error
            except (ProtocolError, RebootedError, SilentError) as error:
                last = error
                self._let_run_out()
        remedy = "Check the cable, or use a lower baud="
        raise DeviceLost(f"replies stay damaged or away ({last.what})", self.link.where, remedy)

    def stop(self) -> None:
        """Leaves the device as a fresh program expects it: not tracking, at 9600 baud. Never raises."""
        with suppress(DeviceLost, ProtocolError):
            self.command("TSTOP", timeout_s=_LEAVE_S)
        with suppress(DeviceLost, ProtocolError):
            if self.link.baud not in (None, FIRST_BAUD):
                self.command("COMM", "00000", timeout_s=_LEAVE_S)

    def bumped(self) -> int:
        """Returns the bit of a bump that happened before this session and was not cleared, as an alert mask; 0 where
        there is none.
        """
        bumped = self.parameter("Info.Status.Bump Detected") or self.parameter("Param.Bump Detector.Bumped")
        return BUMPED if bumped else 0

    def clear_bump(self) -> None:
        """Informs the device that a person has checked it; devices that remember no bump refuse, which is as good."""
        with suppress(RefusedError):
            self.command("SET", "Param.Bump Detector.Clear=1")

    def _find(self, baud: int) -> None:
        """Makes the device answer INIT, whatever its line speed and mode.

        After a reset it uses 9600 baud. A device that the reset did not reach, as behind a cable that was pulled, keeps
        the speed at which it was left.
        """
        if self.link.baud is None:
            self._find_on_network()
            return
        likely = dict.fromkeys((self.link.baud, FIRST_BAUD, baud, *_USUAL_BAUDS))
        if any(self._answers(rate, _KNOCK_S) for rate in likely):
            return
        self.link.reset()
        reset_ns = self._clock.now_ns()
        while self._clock.now_ns() < reset_ns + _SEARCH_S * _S:
            if self._answers(FIRST_BAUD, _LISTEN_S) or self._answers(baud, _KNOCK_S):
                return
        if any(self._answers(rate, _KNOCK_S) for rate in COMM_CODES):
            return
        raise DeviceLost("the tracker does not answer at any line speed", self.link.where, _SILENT_REMEDY)

    def _find_on_network(self) -> None:
        """Sends INIT; without an answer sends RESET, and makes new connections until the device answers INIT."""
        if self._answers(None, _NETWORK_KNOCK_S):
            return
        with suppress(DeviceLost, ProtocolError):
            self.command("RESET", "0", timeout_s=_NETWORK_KNOCK_S)
        deadline_ns = self._clock.now_ns() + round(_NETWORK_SEARCH_S * _S)
        while self._clock.now_ns() < deadline_ns:
            self._clock.sleep_until(self._clock.now_ns() + round(_RECONNECT_S * _S))
            try:
                self.link.reset()
                if self._answers(None, _NETWORK_KNOCK_S):
                    return
            except HeldError:
                raise
            except DeviceLost:
                continue
        raise DeviceLost("the tracker accepts connections but does not answer", self.link.where, _SILENT_REMEDY)

    def _answers(self, baud: int | None, wait_s: float) -> bool:
        """Returns whether the device answers INIT at one speed. The second attempt is for a device with half a command
        in its buffer, or for one that has just sent RESET: its first INIT may take seconds.
        """
        if baud is not None:
            self.link.set_baud(baud)
        for _ in range(2):
            try:
                self._refuse_to_watch(self.command("INIT", timeout_s=wait_s))
                return True
            except SilentError:
                return False
            except RebootedError:
                wait_s = _SLOW_S["INIT"]
            except ProtocolError:
                self._let_run_out()
        return False

    def _refuse_to_watch(self, text: str) -> None:
        if text == _MONITOR:
            remedy = "End the program on the other computer, then try again"
            raise HeldError("another computer holds the tracker", self.link.where, remedy)

    def _let_run_out(self) -> None:
        with suppress(SilentError):
            self.link.wait_quiet(_QUIET_NS, self._clock.now_ns() + _RUN_OUT_NS)

    def _switch(self, baud: int) -> None:
        """Changes both sides to the configured speed; the device answers at the old one, then changes."""
        if self.link.baud in (None, baud):
            return
        try:
            self.command("COMM", f"{COMM_CODES[baud]}0000")
        except RefusedError as error:
            remedy = "Choose another baud=, such as 115200"
            raise ConfigurationError(f"the tracker does not have {baud} baud", self.link.where, remedy) from error
        self._clock.sleep_until(self._clock.now_ns() + round(_SWITCH_S * _S))
        self.link.set_baud(baud)

    def _ask_identity(self) -> Identity:
        """Asks the device for its identity; what the device does not know remains empty."""
        answers = []
        for name, arguments in (("VER", "4"), ("APIREV", "")):
            try:
                answers.append(self.command(name, arguments))
            except RefusedError:
                answers.append("")
        return identity_of(*answers)
