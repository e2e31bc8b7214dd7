"""Simulates an NDI tracker on its line: timing of the bytes, line speeds, restarts, and faults while it runs."""

from collections.abc import Callable
from contextlib import suppress
from threading import Event

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.io.serial_port import BITS_PER_BYTE
from probewatch.drivers.trackers.ndi.wire import encode_text
from probewatch.drivers.twins.events import Events
from probewatch.drivers.twins.fault_control import FaultControl
from probewatch.drivers.twins.ndi.combined_api import BUMPED, PTP_LOST, TOO_HOT, CombinedApi
from probewatch.drivers.twins.ndi.measurement import TOOL_FAULTS
from probewatch.drivers.twins.pty_line import IDLE_S, TwinLine

BOOT_S = 1.0
"""Seconds for which the device does not listen after a restart. Programs allow real devices 0.5 to 7 s; more makes
tests longer."""

NDI_FAULTS = (
    *TOOL_FAULTS,
    "baud-mismatch",
    "bump",
    "clock-step",
    "corrupt-crc",
    "counter-jump",
    "extra-bytes",
    "hot",
    "lose-tracker",
    "no-reply",
    "reset",
    "slow",
    "stale-counter",
    "stale-tracker",
    "truncate",
    "unplug",
)
"""Names of the tracker's faults. corrupt-crc, extra-bytes and truncate strike every other tracking reply.
baud-mismatch, bump, counter-jump and reset happen once when they come on; the others last as long as they are on.
lose-tracker and no-reply are one and the same, and so are stale-tracker and stale-counter."""

_SLOW_BAUD = 200
"""Bits per second, one byte in 50 ms: something always comes within the driver's timeout, and never a whole reply."""

_OTHER_BAUD = 38400
"""Bits per second: a speed that every model has and no program leaves set, so that finding it needs the whole
search."""

_JUMP_COUNTS = 100_000
"""Counts, 28 minutes at 60 Hz: beyond all delays, and far from half of the counter's range, where forward becomes
backward."""
_JUNK = bytes.fromhex("0ac4a5ff00")

Spoil = Callable[[bytes], bytes]


class NdiTwin:
    """Runs the device on its line. device: the state machine within. spoil: changes tracking replies before they go
    out.
    """

    def __init__(self, line: TwinLine, clock: HostClock, device: CombinedApi, control: FaultControl) -> None:
        self.device, self.control = device, control
        self.spoil: Spoil = bytes
        self._line, self._clock, self._events = line, clock, Events(clock)
        self._received: dict[int, bytearray] = {}
        self._since: dict[str, float] = {}
        self._boot_ns: int | None = None
        self._replies = 0
        self._reset_asked = Event()

    def run(self, stop: Event) -> None:
        """Serves the line until stop is set."""
        while not stop.is_set():
            self._follow(self.control.active(self._now_s()))
            if self._reset_asked.is_set():
                self._reset()
            if "unplug" in self._since:
                self._clock.sleep_until(self._clock.now_ns() + round(IDLE_S * 1e9))
                continue
            data = self._line.read(IDLE_S)
            self._boot()
            if data and self._boot_ns is None and not self._since.keys() & {"lose-tracker", "no-reply"}:
                self._hear(data, stop)

    @property
    def starting(self) -> bool:
        """Returns whether the device does not listen because it was commanded to restart and has not yet done so."""
        return self._reset_asked.is_set() or self._boot_ns is not None

    def reset(self) -> None:
        """Restarts the device, as a power glitch or a break does: no answers for a second, then RESET at 9600 baud."""
        self._reset_asked.set()

    def _reset(self) -> None:
        self._reset_asked.clear()
        self.device.reset()
        self._received.clear()
        self._boot_ns = self._clock.now_ns() + round(BOOT_S * 1e9)
        if self.device.model.network:
            self._line.unplug()

    def _boot(self) -> None:
        if self._boot_ns is None or self._clock.now_ns() < self._boot_ns:
            return
        self._boot_ns = None
        if self.device.model.network:
            self._line.plug()
        else:
            self._line.write(encode_text("RESET"), self.device.baud, self._clock.now_ns())

    def _now_s(self) -> float:
        return (self._clock.now_ns() - self._clock.origin_ns) / 1e9

    def _follow(self, active: frozenset[str]) -> None:
        """Applies what comes on and ends what goes off since the last call."""
        now_s = self._now_s()
        gone, come = self._since.keys() - active, active - self._since.keys()
        self._since = {name: self._since.get(name, now_s) for name in active}
        self.device.faults = self._since
        for name in sorted(gone):
            self._end(name)
        for name in sorted(come):
            self._begin(name, now_s)
        with suppress(BrokenPipeError):  # from a parent that no longer reads
            self._events.faults(active, self.control.new_refusal())

    def _begin(self, name: str, now_s: float) -> None:
        match name:
            case "baud-mismatch":
                self.device.baud = _OTHER_BAUD
            case "bump":
                self.device.raise_alert(BUMPED)
            case "clock-step":
                self.device.raise_alert(PTP_LOST)
            case "counter-jump":
                self.device.jump_counter(_JUMP_COUNTS)
            case "hot":
                self.device.raise_alert(TOO_HOT)
            case "reset":
                self._reset()
            case "stale-counter" | "stale-tracker":
                self.device.hold_s = now_s
            case "unplug":
                self._received.clear()
                self._line.unplug()

    def _end(self, name: str) -> None:
        match name:
            case "clock-step":
                self.device.end_alert(PTP_LOST)
            case "hot":
                self.device.end_alert(TOO_HOT)
            case "stale-counter" | "stale-tracker":
                self.device.hold_s = None
            case "unplug":
                self._line.plug()

    def _hear(self, data: bytes, stop: Event) -> None:
        """Takes bytes from the host: those at another speed than the device's are noise; a NUL stands for a break."""
        if b"\0" in data and not self.device.model.network:
            self._reset()
            return
        received = self._received.setdefault(self._line.source, bytearray())
        received += data if self._line.hears(self.device.baud) else b"\xff" * len(data)
        while (end := received.find(b"\r")) >= 0:
            line = bytes(received[: end + 1])
            del received[: end + 1]
            self._answer(line, stop)

    def _answer(self, line: bytes, stop: Event) -> None:
        """Replies in the time that both directions take on the line; a new line speed holds from the next byte on."""
        if line.startswith((b"RESET:", b"RESET ")):
            self._reset()
            return
        baud = self.device.baud
        if not self.device.model.network:
            transfer_ns = len(line) * BITS_PER_BYTE * 1_000_000_000 // baud
            self._clock.sleep_until(self._clock.now_ns() + transfer_ns)
        start_ns = self._clock.now_ns()
        reply = self.device.answer(line, (start_ns - self._clock.origin_ns) / 1e9, self._line.monitor)
        if line.startswith((b"BX", b"TX")):
            reply = self._spoilt(self.spoil(reply))
        if "slow" in self._since:
            self._trickle(reply, stop)
        else:
            self._line.write(reply, baud, start_ns)

    def _spoilt(self, reply: bytes) -> bytes:
        """Spoils the bytes of every other tracking reply, so that asking again helps."""
        self._replies += 1
        if self._replies % 2:
            return reply
        if "corrupt-crc" in self._since:
            reply = reply[:-2] + bytes([reply[-2] ^ 0x01]) + reply[-1:]
        if "truncate" in self._since:
            reply = reply[: len(reply) // 2]
        return reply + (_JUNK if "extra-bytes" in self._since else b"")

    def _trickle(self, reply: bytes, stop: Event) -> None:
        """Sends byte after byte as at 200 baud, until the fault ends."""
        for i in range(len(reply)):
            if stop.is_set() or "slow" not in self.control.active(self._now_s()):
                return
            self._line.write(reply[i : i + 1], _SLOW_BAUD, self._clock.now_ns())
            if self.device.model.network:
                self._clock.sleep_until(self._clock.now_ns() + BITS_PER_BYTE * 1_000_000_000 // _SLOW_BAUD)
