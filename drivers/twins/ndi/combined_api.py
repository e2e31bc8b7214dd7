"""Simulates a Polaris, Vega or Aurora below the parser: modes, port handles, error codes and tracking replies.

There is no line, no process and no waiting here: `answer(line, t_s)` takes one request and returns the bytes of the
reply.
"""

from collections.abc import Callable, Mapping
from enum import Enum

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.trackers.ndi import bx2
from probewatch.drivers.trackers.ndi.bx import encode_bx
from probewatch.drivers.trackers.ndi.replies import TrackingReply
from probewatch.drivers.trackers.ndi.rom import definition_of
from probewatch.drivers.trackers.ndi.tx import encode_tx
from probewatch.drivers.trackers.ndi.wire import Command, decode_command, encode_text
from probewatch.drivers.twins.ndi.measurement import Measurement, faults_of, measure
from probewatch.drivers.twins.ndi.models import SPECTRA, Model
from probewatch.drivers.twins.ndi.port_handles import Port, PortHandles, RefuseError
from probewatch.drivers.twins.ndi.tracking_replies import Measured, bx2_frame, bx2_options, tracking_reply
from probewatch.drivers.twins.tool_motion import PoseAt

BUMPED, TOO_HOT, PTP_LOST = 0x200000, 0x20000000, 0x80000000
"""Bits of the alert masks. PTP_LOST is not one of them on the wire, where only BX2 has a code for it."""

_ALERTS_PENDING, _TEMPERATURE = 0x0100, 0x0200
_BX2_ALERTS = {0x100000: (1, 1), BUMPED: (1, 2), TOO_HOT: (1, 8), 0x40000000: (1, 9), PTP_LOST: (1, 14)}
"""Combined API, written independently of the driver's numbers: bits of the system status; bit of an alert → (kind,
code) of BX2's alert component."""

_EPOCH_S = 1_750_000_000
"""Unix time at world time 0 on the clock of BX2: a day in 2025, so that seconds are as large as on a real device."""

_STEP_BACK_S = 5.0
"""Seconds by which that clock is behind without its master: far more than a delay, so that it cannot pass for one."""
_QUESTIONS = ("APIREV", "BEEP", "BX", "GET", "GETINFO", "SFLIST", "TX", "VER")
_SETTINGS = ("COMM", "DSTART", "DSTOP", "INIT", "IRATE", "SET", "TSTART", "TSTOP", "VSEL")
_CHANGES = frozenset({*_SETTINGS, *PortHandles.CHANGES}) - {"INIT"}
_ANY_MODE = frozenset({"APIREV", "BEEP", "COMM", "GET", "GETINFO", "INIT", "SET", "VER"})
_TRACKING_ONLY = frozenset({"BX", "BX2", "TX", "TSTOP", "DSTOP"})
_SFLIST = {"00": "00000013", "01": "0", "02": "9", "03": "0", "04": "1", "05": "3"}


class Mode(Enum):
    """Names the modes of the device, which determine the commands that it accepts."""

    SETUP = "Setup"
    INITIALISED = "Initialized"
    TRACKING = "Tracking"
    DIAGNOSTICS = "Diagnostics"


class CombinedApi:
    """Answers requests as the device does. pose_at: where the tools are. track_hz: one of the model's. skew_ppm: that
    of the device's clock. wired: some of WIRED_TOOLS.

    The attributes serve a test bench: handles, new_alerts, system_status, hold_s (world second after which there are no
    more measurements) and faults (name → second since which it has been on, see drivers.twins.ndi.measurement) may be
    set.
    """

    def __init__(
        self,
        pose_at: PoseAt,
        model: Model = SPECTRA,
        track_hz: int | None = None,
        skew_ppm: float = 0.0,
        wired: tuple[str, ...] = (),
    ) -> None:
        track_hz = track_hz or model.track_hz[0]
        self.model = model
        self.counter_hz = track_hz if model.bx2 else model.counter_hz
        self._step = self.counter_hz // track_hz
        self._rate = 1 + skew_ppm * 1e-6
        self._pose_at, self.handles = pose_at, PortHandles(wired, model.electromagnetic)
        self.faults: Mapping[str, float] = {}
        self.bumped = False
        names = (*_QUESTIONS, *_SETTINGS, *("BX2",) * model.bx2)
        self._commands: dict[str, Callable[[str, float], str | bytes]] = {
            name: getattr(self, f"_{name.lower()}") for name in names
        }
        self.reset()

    @property
    def ports(self) -> dict[int, Port]:
        """Returns the ports by their handle."""
        return self.handles.ports

    def reset(self) -> None:
        """Resets the device, as power-up or a break does: no handles, 9600 baud, set-up mode. Only a bump is
        remembered.
        """
        self.mode = Mode.SETUP
        self.baud = 9600
        self.handles.clear()
        self.alerts, self.new_alerts, self.system_status = BUMPED * self.bumped, BUMPED * self.bumped, 0
        self.hold_s: float | None = None
        self._counter_zero = 0
        self._sent_frame: int | None = None

    def answer(self, line: bytes, t_s: float, monitor: bool = False) -> bytes:
        """Returns the reply to one request with its CR, at world time t_s. A new line speed holds only after the reply.

        monitor: whether the request came over a connection that may only query, because another one came first.
        """
        try:
            command = decode_command(line)
        except ProtocolError:
            return encode_text("ERROR04" if b":" in line else "ERROR01")
        if monitor and command.name in _CHANGES:
            return encode_text("ERROR39")
        if monitor and command.name == "INIT":
            return encode_text("WARNING06")
        try:
            reply = self._perform(command, t_s)
        except RefuseError as refusal:
            reply = f"ERROR{refusal.code:02X}"
        return reply if isinstance(reply, bytes) else encode_text(reply)

    def raise_alert(self, mask: int) -> None:
        """Raises an alert, which the device reports from now on."""
        self.alerts |= mask
        self.new_alerts |= mask
        self.bumped = self.bumped or bool(mask & BUMPED)

    def end_alert(self, mask: int) -> None:
        """Ends the condition of an alert; what was reported as new stays so until it is read."""
        self.alerts &= ~mask

    def jump_counter(self, counts: int) -> None:
        """Shifts the frame counter against the time."""
        self._counter_zero -= counts

    def frame(self, t_s: float) -> int:
        """Returns the counter value of the last measurement at world time t_s."""
        measured_s = t_s if self.hold_s is None else min(t_s, self.hold_s)
        counts = int(measured_s * self.counter_hz * self._rate) - self._counter_zero - self.model.counter_phase
        return max(counts, 0) // self._step * self._step + self.model.counter_phase

    def frame_s(self, frame: int) -> float:
        """Returns the world time at which that measurement was true."""
        return (frame + self._counter_zero) / (self.counter_hz * self._rate)

    def _perform(self, command: Command, t_s: float) -> str | bytes:
        of_a_port = command.name in (*PortHandles.QUESTIONS, *PortHandles.CHANGES)
        if command.name not in self._commands and not of_a_port:
            raise RefuseError(0x01)
        if command.name in ("BX", "BX2", "TX") and self.mode is not Mode.TRACKING:
            raise RefuseError(0x0C)
        if command.name not in _ANY_MODE | _TRACKING_ONLY:
            self._require_initialised()
        if of_a_port:
            return self.handles.perform(command.name, command.arguments)
        return self._commands[command.name](command.arguments, t_s)

    def _require_initialised(self) -> None:
        if self.mode is Mode.SETUP:
            raise RefuseError(0x10)
        if self.mode is not Mode.INITIALISED:
            raise RefuseError(0x0C)

    def _init(self, _: str, __: float) -> str:
        if self.mode is Mode.SETUP:
            self.handles.plug_in()
        self.mode = Mode.INITIALISED
        return "OKAY"

    def _comm(self, arguments: str, _: float) -> str:
        if len(arguments) != 5:
            raise RefuseError(0x03 if len(arguments) < 5 else 0x02)
        bauds = dict(self.model.bauds)
        if arguments[0] not in bauds or arguments[1:] != "0000":
            raise RefuseError(0x06)
        self.baud = bauds[arguments[0]]
        return "OKAY"

    def _apirev(self, _: str, __: float) -> str:
        return self.model.api

    def _ver(self, number: str, _: float) -> str:
        if number in ("0", "4"):
            return self.model.version
        if number != "5":
            raise RefuseError(0x23)
        return self.model.revision

    def _beep(self, number: str, _: float) -> str:
        if not number.isdecimal() or not 1 <= int(number) <= 9:
            raise RefuseError(0x23)
        return "1"

    def _parameters(self) -> dict[str, str]:
        return {
            "Features.Firmware.Version": self.model.firmware,
            "Features.Hardware.Model": self.model.title,
            "Features.Hardware.Serial Number": self.model.serial_number,
            "Param.Bump Detector.Bumped": str(int(self.bumped)),
            "Param.Bump Detector.Clear": "0",
            "Param.Simulated Alerts": "0",
            "Param.Tracking.Frame Frequency": str(self.counter_hz),
            "Param.Tracking.Track Frequency": str({1: 2, 2: 1, 3: 0}.get(self._step, 2)),
            "Info.Status.Alerts": str(self.alerts & ~PTP_LOST),
            "Info.Status.Bump Detected": str(int(self.bumped)),
            "Info.Status.New Alerts": str(self.new_alerts & ~PTP_LOST),
            "Info.Status.System Mode": self.mode.value,
            "Info.Timeout.BX": "4",
            "Info.Timeout.INIT": "4",
        }

    def _get(self, name: str, _: float) -> str:
        known = self._parameters()
        wanted = name.rstrip("*")
        found = {
            key: value for key, value in known.items() if key == name or (wanted != name and key.startswith(wanted))
        }
        if not found:
            raise RefuseError(0x34)
        if "Info.Status.New Alerts" in found:
            self.new_alerts = 0
        return "\n".join(f"{key}={value}" for key, value in found.items()) + ("\n" if len(found) > 1 else "")

    def _getinfo(self, name: str, t_s: float) -> str:
        lines = self._get(name, t_s).splitlines()
        return "\n".join(f"{line};4;1;0;0;;A parameter" for line in lines) + ("\n" if len(lines) > 1 else "")

    def _set(self, assignment: str, _: float) -> str:
        name, _equals, value = assignment.partition("=")
        if name not in self._parameters():
            raise RefuseError(0x34)
        if not value.isdecimal():
            raise RefuseError(0x36)
        if name == "Param.Bump Detector.Clear":
            self.bumped = self.bumped and value == "0"
            self.end_alert(BUMPED)
        elif name == "Param.Simulated Alerts":
            self.alerts = 0
            self.raise_alert(int(value))
        elif not name.startswith("Param."):
            raise RefuseError(0x39)
        return "OKAY"

    def _sflist(self, number: str, _: float) -> str:
        if number not in _SFLIST:
            raise RefuseError(0x23)
        return _SFLIST[number]

    def _irate(self, number: str, _: float) -> str:
        if number not in ("0", "1", "2"):
            raise RefuseError(0x23)
        return "OKAY"

    def _vsel(self, number: str, _: float) -> str:
        if number != "1":
            raise RefuseError(0x24)
        return "OKAY"

    def _tstart(self, arguments: str, t_s: float) -> str:
        if arguments not in ("", "80"):
            raise RefuseError(0x23)
        if arguments == "80":
            self._counter_zero = int(t_s * self.counter_hz * self._rate)
        self.mode, self._sent_frame = Mode.TRACKING, None
        return "OKAY"

    def _tstop(self, _: str, __: float) -> str:
        return self._leave(Mode.TRACKING)

    def _dstart(self, _: str, __: float) -> str:
        self.mode = Mode.DIAGNOSTICS
        return "OKAY"

    def _dstop(self, _: str, __: float) -> str:
        return self._leave(Mode.DIAGNOSTICS)

    def _leave(self, mode: Mode) -> str:
        if self.mode is not mode:
            raise RefuseError(0x0C)
        self.mode = Mode.INITIALISED
        return "OKAY"

    def _bx(self, arguments: str, t_s: float) -> bytes:
        return self._tracking(encode_bx, arguments, t_s)

    def _tx(self, arguments: str, t_s: float) -> bytes:
        return self._tracking(encode_tx, arguments, t_s)

    def _tracking(self, encode: Callable[[TrackingReply, int], bytes], arguments: str, t_s: float) -> bytes:
        frame = self.frame(t_s)
        status = (
            self.system_status | _ALERTS_PENDING * bool(self.new_alerts) | _TEMPERATURE * bool(self.alerts & TOO_HOT)
        )
        try:
            options = int(arguments or "0001", 16)
            return encode(tracking_reply(self._measured(frame), frame, status, options), options)
        except (ValueError, ProtocolError):
            raise RefuseError(0x23) from None

    def _bx2(self, arguments: str, t_s: float) -> bytes:
        """Answers BX2: without data unless there is a new measurement, because data are never repeated."""
        try:
            wanted = bx2_options(arguments)
        except ValueError:
            raise RefuseError(0x23) from None
        frame = self.frame(t_s)
        if frame == self._sent_frame:
            return bx2.encode_bx2(())
        self._sent_frame = frame
        alerts = tuple(bx2.Alert(*code) for bit, code in _BX2_ALERTS.items() if self.alerts & bit)
        magnetic = self.model.electromagnetic
        return bx2.encode_bx2(
            (bx2_frame(self._measured(frame), frame, self._device_ns(frame), alerts, wanted, magnetic),)
        )

    def _device_ns(self, frame: int) -> int:
        """Returns the time of a measurement by the device's own clock; without its master the clock loses five
        seconds.
        """
        counts = (frame + self._counter_zero) * 1_000_000_000 // self.counter_hz
        return _EPOCH_S * 1_000_000_000 + counts - round(_STEP_BACK_S * 1e9) * bool(self.alerts & PTP_LOST)

    def _measured(self, frame: int) -> Measured:
        t_s, names = self.frame_s(frame), self.handles.names()
        faults = faults_of(self.faults, frame // self._step)
        measured: Measured = {}
        for handle, port in self.ports.items():
            if port.enabled:
                markers_mm = definition_of(bytes(port.rom)).markers_mm[: 0 if self.model.electromagnetic else None]
                fit_mm = self.model.fit_mm
                seen = measure(self._pose_at, names[handle], markers_mm, fit_mm, t_s, frame, faults)
                measured[handle] = (port.extra_status, seen if port.seen else Measurement(None))
        return measured
