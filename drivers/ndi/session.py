"""From any state of the device to tracking, and back: INIT, line speed, port handles, tool definitions."""

from collections.abc import Iterator
from contextlib import suppress

from drivers.errors import ConfigurationError, DeviceLost, ProtocolError
from drivers.hosttime import HostClock
from drivers.ndi.link import FIRST_BAUD, Link, RebootedError, SilentError, lost_by_protocol, refuse_reset
from drivers.ndi.rom import rom_chunks
from drivers.ndi.wire import Command, RefusedError, decode_text, encode_command

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
_USUAL_BAUDS = (FIRST_BAUD, 115200, 921600)
_S = 1_000_000_000
_REPLY_S = 2.0
_SLOW_S = {"INIT": 6.0, "PINIT": 6.0, "TSTART": 6.0, "COMM": 2.0}
_KNOCK_S = 0.3
_LISTEN_S = 0.8
_SEARCH_S = 8.0
_SWITCH_S = 0.1
_PORT_ROUNDS = 8
_CONNECT_ATTEMPTS = 3


class Session:
    """One tracker behind one link. Methods raise DeviceLost; `command` also ProtocolError."""

    def __init__(self, link: Link, clock: HostClock) -> None:
        self.link = link
        self.warnings: list[str] = []
        self._clock = clock

    def command(self, name: str, arguments: str = "", timeout_s: float | None = None) -> str:
        """The text of the reply. Raises RefusedError for ERRORxx; WARNINGxx counts as done and is kept."""
        wait_s = timeout_s or _SLOW_S.get(name, _REPLY_S)
        request = encode_command(Command(name, arguments))
        self.link.send(request)
        spare_ns = 2 * self.link.transfer_ns(len(request) + 64)
        reply = self.link.read_reply(self._clock.now_ns() + round(wait_s * _S) + spare_ns)
        text = refuse_reset(decode_text(reply), self.link.path)
        if text.startswith("WARNING"):
            self.warnings.append(f"{name}: {text}")
        return text

    def start(self, baud: int, roms: tuple[bytes, ...]) -> tuple[int, ...]:
        """Bring the device to tracking; the port handles of the tools, in the order of `roms`.

        Without any rom the handle of the first wired tool. A damaged reply starts the whole sequence again, which is
        harmless from every state. Raises DeviceLost, or ConfigurationError for a line speed the device does not have.
        """
        for _ in range(_CONNECT_ATTEMPTS):
            try:
                self._find(baud)
                self._switch(baud)
                return self._track(roms)
            except RefusedError as error:
                raise lost_by_protocol(error, self.link.path) from error
            except (ProtocolError, RebootedError) as error:
                last = error
        raise DeviceLost(f"replies stay damaged ({last.what})", self.link.path, "Check the cable, or use a lower baud=")

    def stop(self) -> None:
        """Leave the device as a fresh program expects it: not tracking, at 9600 baud. Never raises."""
        with suppress(DeviceLost, ProtocolError):
            self.command("TSTOP", timeout_s=0.5)
        with suppress(DeviceLost, ProtocolError):
            if self.link.baud != FIRST_BAUD:
                self.command("COMM", "00000", timeout_s=0.5)

    def _find(self, baud: int) -> None:
        """Make the device answer INIT, whatever its line speed and mode."""
        likely = dict.fromkeys((self.link.baud, FIRST_BAUD, baud, *_USUAL_BAUDS))
        if any(self._answers(rate, _KNOCK_S) for rate in likely):
            return
        self.link.send_break()
        deadline_ns = self._clock.now_ns() + round(_SEARCH_S * _S)
        while self._clock.now_ns() < deadline_ns:
            if self._answers(FIRST_BAUD, _LISTEN_S) or self._answers(baud, _KNOCK_S):
                return
        if any(self._answers(rate, _KNOCK_S) for rate in COMM_CODES):
            return
        remedy = "Check that it is switched on and that the cable sits at both ends"
        raise SilentError("the tracker does not answer at any line speed", self.link.path, remedy)

    def _answers(self, baud: int, wait_s: float) -> bool:
        """One INIT at one speed. The second try is for a device with half a command in its buffer, or one that has
        just said RESET: its first INIT may take seconds.
        """
        self.link.set_baud(baud)
        for _ in range(2):
            try:
                self.command("INIT", timeout_s=wait_s)
                return True
            except SilentError:
                return False
            except RebootedError:
                wait_s = _SLOW_S["INIT"]
            except ProtocolError:
                self._let_run_out()
        return False

    def _let_run_out(self) -> None:
        with suppress(SilentError):
            self.link.wait_quiet(_S // 20, self._clock.now_ns() + _S // 2)

    def _switch(self, baud: int) -> None:
        """Both sides to the configured speed; the device answers at the old one, then changes."""
        if self.link.baud == baud:
            return
        try:
            self.command("COMM", f"{COMM_CODES[baud]}0000")
        except RefusedError as error:
            remedy = "Choose another baud=, such as 115200"
            raise ConfigurationError(f"the tracker does not have {baud} baud", self.link.path, remedy) from error
        self._clock.sleep_until(self._clock.now_ns() + round(_SWITCH_S * _S))
        self.link.set_baud(baud)

    def _track(self, roms: tuple[bytes, ...]) -> tuple[int, ...]:
        self._free_handles("00" if roms else "01")
        handles = tuple(self._load(rom) for rom in roms)
        self._initialise_tools()
        enabled = tuple(self._enable_tools())
        if not enabled:
            remedy = "Plug the tool in, or name its definition file with probe=FILE.rom"
            raise DeviceLost("no tool is connected to the tracker", self.link.path, remedy)
        self.command("TSTART")
        return handles or enabled[:1]

    def _handles(self, group: str) -> list[int]:
        """Port handles of one group of PHSR: 00 all, 01 to free, 02 to initialise, 03 to enable."""
        text = self.command("PHSR", group)
        try:
            count = int(text[:2], 16)
            if len(text) != 2 + 5 * count:
                raise ValueError
            return [int(text[at : at + 2], 16) for at in range(2, len(text), 5)]
        except ValueError:
            raise ProtocolError(f"PHSR {group} answered {text[:40]!r}") from None

    def _free_handles(self, group: str) -> None:
        for handle in self._handles(group):
            self.command("PHF", f"{handle:02X}")

    def _load(self, rom: bytes) -> int:
        text = self.command("PHRQ", "*********1****")
        try:
            handle = int(text, 16)
        except ValueError:
            raise ProtocolError(f"PHRQ answered {text[:40]!r}") from None
        for address, chunk in rom_chunks(rom):
            self.command("PVWR", f"{handle:02X}{address:04X}{chunk.hex().upper()}")
        return handle

    def _initialise_tools(self) -> None:
        """Again until none is left: initialising one half of a dual tool brings the other to light."""
        for _ in range(_PORT_ROUNDS):
            waiting = self._handles("02")
            if not waiting:
                return
            for handle in waiting:
                self.command("PINIT", f"{handle:02X}")
        raise DeviceLost("tools do not become initialised", self.link.path, "Unplug the tools and plug them in again")

    def _enable_tools(self) -> Iterator[int]:
        for handle in self._handles("03"):
            self.command("PENA", f"{handle:02X}D")
            yield handle
