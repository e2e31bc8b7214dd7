"""A Polaris below the parser: modes, port handles, error codes and tracking replies of the Combined API.

No line, no process and no waiting here: `answer(line, t_s)` takes one request and gives the bytes of the reply.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from scipy.spatial.transform import Rotation

from drivers.errors import ProtocolError
from drivers.ndi.bx import encode_bx
from drivers.ndi.replies import HandleState, Markers, ToolReply, TrackingReply, Transform
from drivers.ndi.rom import CHUNK_BYTES, ROM_BYTES, rom_sum
from drivers.ndi.tx import encode_tx
from drivers.ndi.wire import Command, decode_command, encode_text
from drivers.samples import Matrix4
from drivers.twins.rom import PROBE

COUNTER_HZ = 60
BAUDS = {"0": 9600, "1": 14400, "2": 19200, "3": 38400, "4": 57600, "5": 115200, "6": 921600, "A": 230400}

_ALERTS_PENDING = 0x0100
_READY = 0x31
_ROM_SPACE = 1024
_FIT_MM = 0.2
_PARAMETERS = {
    "Features.Firmware.Version": "007.000.012",
    "Features.Hardware.Serial Number": "P6-00000",
    "Param.Tracking.Frame Frequency": "60",
    "Param.Tracking.Track Frequency": "2",
    "Info.Timeout.INIT": "4",
    "Info.Timeout.BX": "4",
}
_VERSION = (
    "Polaris Vicra Control Firmware\nNDI S/N: P6-00000\nCharacterization Date: 06/05/24\n"
    "Freeze Tag: Polaris Vicra Rev 007.000\nFreeze Date: 01/04/10\n(C) Northern Digital Inc.\n"
)

PoseAt = Callable[[int, float, int], Matrix4]
"""(main type of the tool, world seconds, frame number) → (4, 4) tool → tracker as measured, mm."""


class Mode(Enum):
    """What the device is willing to do."""

    SETUP = "set-up"
    INITIALISED = "initialised"
    TRACKING = "tracking"
    DIAGNOSTICS = "diagnostics"


@dataclass(slots=True)
class Port:
    """One port handle. seen: the camera has the tool in view. extra_status: bits added to the port status."""

    rom: bytearray = field(default_factory=lambda: bytearray(_ROM_SPACE))
    wired: bool = False
    initialised: bool = False
    enabled: bool = False
    seen: bool = True
    extra_status: int = 0

    @property
    def status(self) -> int:
        """Port status of PHSR and TX: occupied, initialised, enabled."""
        return 0x01 | 0x10 * self.initialised | 0x20 * self.enabled

    @property
    def main_type(self) -> int:
        """The kind of tool its definition names."""
        return self.rom[15] or PROBE


class _RefuseError(Exception):
    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class CombinedApi:
    """pose_at: where tools are. track_hz: 60, 30 or 20. skew_ppm: of the device's clock. wired: tools on cables.

    The attributes are the test bench: ports, alerts, system_status, hold_s (measure no more since then) may be set.
    """

    def __init__(self, pose_at: PoseAt, track_hz: int = COUNTER_HZ, skew_ppm: float = 0.0, wired: int = 0) -> None:
        self._pose_at = pose_at
        self._step = COUNTER_HZ // track_hz
        self._counter_hz = COUNTER_HZ * (1 + skew_ppm * 1e-6)
        self._wired = wired
        self._commands: dict[str, Callable[[str, float], str | bytes]] = {
            "INIT": self._init,
            "COMM": self._comm,
            "APIREV": lambda _, __: "G.001.006",
            "VER": lambda _, __: _VERSION,
            "BEEP": lambda _, __: "1",
            "GET": self._get,
            "GETINFO": self._get,
            "PHSR": self._phsr,
            "PHRQ": self._phrq,
            "PVWR": self._pvwr,
            "PINIT": self._pinit,
            "PENA": self._pena,
            "PDIS": self._pdis,
            "PHF": self._phf,
            "PHINF": self._phinf,
            "TSTART": self._tstart,
            "TSTOP": self._tstop,
            "TX": self._tx,
            "BX": self._bx,
        }
        self.reset()

    def reset(self) -> None:
        """As after power-up or a break: no handles, 9600 baud, set-up mode."""
        self.mode = Mode.SETUP
        self.baud = 9600
        self.ports: dict[int, Port] = {}
        self.alerts, self.system_status = 0, 0
        self.hold_s: float | None = None
        self._counter_zero = 0

    def answer(self, line: bytes, t_s: float) -> bytes:
        """The reply to one request with its CR, at world time t_s. A new line speed holds only after the reply."""
        try:
            command = decode_command(line)
        except ProtocolError:
            return encode_text("ERROR04" if b":" in line else "ERROR01")
        try:
            reply = self._perform(command, t_s)
        except _RefuseError as refusal:
            reply = f"ERROR{refusal.code:02X}"
        return reply if isinstance(reply, bytes) else encode_text(reply)

    def frame(self, t_s: float) -> int:
        """Counter value of the last measurement at world time t_s."""
        counts = int((t_s if self.hold_s is None else min(t_s, self.hold_s)) * self._counter_hz) - self._counter_zero
        return max(counts, 0) // self._step * self._step

    def frame_s(self, frame: int) -> float:
        """World time at which that measurement was true."""
        return (frame + self._counter_zero) / self._counter_hz

    def _perform(self, command: Command, t_s: float) -> str | bytes:
        if command.name not in self._commands:
            raise _RefuseError(0x01)
        if command.name in ("BX", "TX") and self.mode is not Mode.TRACKING:
            raise _RefuseError(0x0C)
        if command.name.startswith("P") or command.name == "TSTART":
            self._require_initialised()
        return self._commands[command.name](command.arguments, t_s)

    def _require_initialised(self) -> None:
        if self.mode is Mode.SETUP:
            raise _RefuseError(0x10)
        if self.mode is not Mode.INITIALISED:
            raise _RefuseError(0x0C)

    def _init(self, _: str, __: float) -> str:
        if self.mode is Mode.SETUP:
            self.ports = {handle: Port(wired=True) for handle in range(1, self._wired + 1)}
        self.mode = Mode.INITIALISED
        return "OKAY"

    def _comm(self, arguments: str, _: float) -> str:
        if len(arguments) != 5:
            raise _RefuseError(0x03 if len(arguments) < 5 else 0x02)
        if arguments[0] not in BAUDS or arguments[1:] != "0000":
            raise _RefuseError(0x06)
        self.baud = BAUDS[arguments[0]]
        return "OKAY"

    def _get(self, name: str, _: float) -> str:
        if name == "Info.Status.New Alerts":
            alerts, self.alerts = self.alerts, 0
            return f"{name}={alerts}"
        found = {key: value for key, value in _PARAMETERS.items() if key == name or key.startswith(name.rstrip("*"))}
        if not found:
            raise _RefuseError(0x34)
        return "\n".join(f"{key}={value}" for key, value in found.items()) + ("\n" if len(found) > 1 else "")

    def _phsr(self, group: str, _: float) -> str:
        chosen: dict[str, Callable[[Port], bool]] = {
            "00": lambda _: True,
            "01": lambda _: False,
            "02": lambda port: not port.initialised,
            "03": lambda port: port.initialised and not port.enabled,
            "04": lambda port: port.enabled,
        }
        if group not in chosen:
            raise _RefuseError(0x23)
        ports = {handle: port for handle, port in self.ports.items() if chosen[group](port)}
        return f"{len(ports):02X}" + "".join(f"{handle:02X}{port.status:03X}" for handle, port in ports.items())

    def _phrq(self, arguments: str, _: float) -> str:
        if len(arguments) != 14:
            raise _RefuseError(0x03 if len(arguments) < 14 else 0x02)
        handle = next((number for number in range(1, 0x100) if number not in self.ports), None)
        if handle is None:
            raise _RefuseError(0x2D)
        self.ports[handle] = Port()
        return f"{handle:02X}"

    def _pvwr(self, arguments: str, _: float) -> str:
        port = self._port(arguments[:2])
        if len(arguments) != 6 + 2 * CHUNK_BYTES:
            raise _RefuseError(0x03 if len(arguments) < 6 + 2 * CHUNK_BYTES else 0x02)
        try:
            address, chunk = int(arguments[2:6], 16), bytes.fromhex(arguments[6:])
        except ValueError:
            raise _RefuseError(0x23) from None
        if address + CHUNK_BYTES > _ROM_SPACE:
            raise _RefuseError(0x23)
        port.rom[address : address + CHUNK_BYTES] = chunk
        return "OKAY"

    def _pinit(self, arguments: str, _: float) -> str:
        port = self._port(arguments)
        image = bytes(port.rom[:ROM_BYTES])
        if not port.wired and (image[:4] != b"NDI\0" or struct.unpack_from("<H", image, 4)[0] != rom_sum(image)):
            raise _RefuseError(0x40)
        port.initialised = True
        return "OKAY"

    def _pena(self, arguments: str, _: float) -> str:
        port = self._port(arguments[:2])
        if arguments[2:] not in ("D", "S", "B"):
            raise _RefuseError(0x09)
        if not port.initialised:
            raise _RefuseError(0x0E)
        port.enabled = True
        return "OKAY"

    def _pdis(self, arguments: str, _: float) -> str:
        self._port(arguments).enabled = False
        return "OKAY"

    def _phf(self, arguments: str, _: float) -> str:
        self._port(arguments)
        del self.ports[int(arguments, 16)]
        return "OKAY"

    def _phinf(self, arguments: str, _: float) -> str:
        port = self._port(arguments[:2])
        options = int(arguments[2:] or "0001", 16)
        fields = {
            0x0001: f"{port.main_type:02X}000000NDI         00135A7B2C1{port.status:02X}",
            0x0004: "GENERIC".ljust(20),
            0x0020: "00000000010000",
        }
        return "".join(text for bit, text in fields.items() if options & bit)

    def _tstart(self, arguments: str, t_s: float) -> str:
        if arguments not in ("", "80"):
            raise _RefuseError(0x23)
        if arguments == "80":
            self._counter_zero = int(t_s * self._counter_hz)
        self.mode = Mode.TRACKING
        return "OKAY"

    def _tstop(self, _: str, __: float) -> str:
        if self.mode is not Mode.TRACKING:
            raise _RefuseError(0x0C)
        self.mode = Mode.INITIALISED
        return "OKAY"

    def _bx(self, arguments: str, t_s: float) -> bytes:
        return self._tracking(encode_bx, arguments, t_s)

    def _tx(self, arguments: str, t_s: float) -> bytes:
        return self._tracking(encode_tx, arguments, t_s)

    def _tracking(self, encode: Callable[[TrackingReply, int], bytes], arguments: str, t_s: float) -> bytes:
        frame = self.frame(t_s)
        tools = tuple(self._tool(handle, port, frame) for handle, port in self.ports.items() if port.enabled)
        status = self.system_status | (_ALERTS_PENDING if self.alerts else 0)
        try:
            return encode(TrackingReply(tools, status, Markers((), ())), int(arguments or "0001", 16))
        except (ValueError, ProtocolError):
            raise _RefuseError(0x23) from None

    def _tool(self, handle: int, port: Port, frame: int) -> ToolReply:
        status, counter = _READY | port.extra_status, frame % (1 << 32)
        if not port.seen:
            return ToolReply(handle, HandleState.MISSING, None, status, counter)
        matrix = self._pose_at(port.main_type, self.frame_s(frame), frame)
        return ToolReply(handle, HandleState.VALID, _transform(matrix), status, counter)

    def _port(self, text: str) -> Port:
        try:
            return self.ports[int(text, 16)]
        except (ValueError, KeyError):
            raise _RefuseError(0x08) from None


def _transform(matrix: Matrix4) -> Transform:
    x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat().astype(np.float32).tolist()
    tx, ty, tz = matrix[:3, 3].astype(np.float32).tolist()
    return Transform((w, x, y, z), (tx, ty, tz), _FIT_MM)
