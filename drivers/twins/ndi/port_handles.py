"""Keeps the port handles of a simulated Polaris, Vega or Aurora, and answers the commands for one tool."""

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

from probewatch.drivers.trackers.ndi.rom import CHUNK_BYTES, ROM_BYTES, definition_of, rom_sum
from probewatch.drivers.twins.ndi.tool_definitions import PROBE as PROBE_TYPE
from probewatch.drivers.twins.ndi.tool_definitions import REFERENCE as REFERENCE_TYPE
from probewatch.drivers.twins.ndi.tool_definitions import make_rom
from probewatch.drivers.twins.tool_motion import PROBE, REFERENCE

WIRED_TOOLS = ("probe", "reference", "dual", "unprogrammed")
"""Kinds of tools that may be on a cable; a dual tool is two sensors of five degrees of freedom behind one plug."""

_ROM_SPACE = 1024
"""Bytes of a tool's memory: some clients write sixteen chunks of 64 where a definition has twelve."""


@dataclass(slots=True)
class Port:
    """Represents one port handle. socket: number of the plug, 0 for a wireless tool. channel: 0 or 1 of a dual tool.

    seen: whether the camera has the tool in view. extra_status: bits added to the port status.
    """

    rom: bytearray = field(default_factory=lambda: bytearray(_ROM_SPACE))
    socket: int = 0
    channel: int = 0
    programmed: bool = True
    initialised: bool = False
    enabled: bool = False
    seen: bool = True
    extra_status: int = 0

    @property
    def status(self) -> int:
        """Returns the port status of PHSR and TX: occupied, initialised, enabled."""
        return 0x01 | 0x10 * self.initialised | 0x20 * self.enabled

    @property
    def main_type(self) -> int:
        """Returns the kind of tool that its definition names."""
        return self.rom[15] or PROBE_TYPE


class RefuseError(Exception):
    """Makes the device answer ERROR and this code."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class PortHandles:
    """Tracks the handles that the device has given out, and answers QUESTIONS and CHANGES about them.

    wired: those of WIRED_TOOLS that INIT finds on the plugs.
    """

    QUESTIONS = ("PHINF", "PHSR")
    CHANGES = ("PDIS", "PENA", "PHF", "PHRQ", "PINIT", "PVWR")

    def __init__(self, wired: tuple[str, ...], electromagnetic: bool) -> None:
        self.wired, self._electromagnetic = wired, electromagnetic
        self.ports: dict[int, Port] = {}

    def clear(self) -> None:
        """Takes all handles back."""
        self.ports = {}

    def plug_in(self) -> None:
        """Gives a handle to each plug, and no other, as INIT does after a reset."""
        self.ports = {number: _wired_port(number, kind) for number, kind in enumerate(self.wired, 1)}

    def perform(self, name: str, arguments: str) -> str:
        """Returns the reply to one of QUESTIONS and CHANGES. Raises RefuseError."""
        reply: str = getattr(self, f"_{name.lower()}")(arguments)
        return reply

    def names(self) -> dict[int, str]:
        """Returns the names that the motion has for the tools, by handle: probe, reference, then by number."""
        names: dict[int, str] = {}
        for handle, port in sorted(self.ports.items()):
            wanted = REFERENCE if port.main_type == REFERENCE_TYPE else PROBE
            names[handle] = wanted if wanted not in names.values() else f"tool{len(names) + 1}"
        return names

    def _phsr(self, group: str) -> str:
        chosen: dict[str, Callable[[Port], bool]] = {
            "00": lambda _: True,
            "01": lambda _: False,
            "02": lambda port: not port.initialised,
            "03": lambda port: port.initialised and not port.enabled,
            "04": lambda port: port.enabled,
        }
        if (group or "00") not in chosen:
            raise RefuseError(0x23)
        ports = {handle: port for handle, port in self.ports.items() if chosen[group or "00"](port)}
        return f"{len(ports):02X}" + "".join(f"{handle:02X}{port.status:03X}" for handle, port in ports.items())

    def _phrq(self, arguments: str) -> str:
        if len(arguments) != 14:
            raise RefuseError(0x03 if len(arguments) < 14 else 0x02)
        return f"{self._allocate(Port()):02X}"

    def _allocate(self, port: Port) -> int:
        handle = next((number for number in range(1, 0x100) if number not in self.ports), None)
        if handle is None:
            raise RefuseError(0x2D)
        self.ports[handle] = port
        return handle

    def _pvwr(self, arguments: str) -> str:
        port = self._port(arguments[:2])
        if len(arguments) != 6 + 2 * CHUNK_BYTES:
            raise RefuseError(0x03 if len(arguments) < 6 + 2 * CHUNK_BYTES else 0x02)
        try:
            address, chunk = int(arguments[2:6], 16), bytes.fromhex(arguments[6:])
        except ValueError:
            raise RefuseError(0x23) from None
        if address + CHUNK_BYTES > _ROM_SPACE:
            raise RefuseError(0x23)
        port.rom[address : address + CHUNK_BYTES] = chunk
        port.programmed = True
        return "OKAY"

    def _pinit(self, arguments: str) -> str:
        port = self._port(arguments)
        image = bytes(port.rom[:ROM_BYTES])
        if not port.programmed:
            raise RefuseError(0x1E)
        if image[:4] != b"NDI\0" or struct.unpack_from("<H", image, 4)[0] != rom_sum(image):
            raise RefuseError(0x40)
        port.initialised = True
        self._reveal_other_half(port)
        return "OKAY"

    def _reveal_other_half(self, port: Port) -> None:
        dual = bool(port.socket) and self.wired[port.socket - 1] == "dual"
        if dual and sum(other.socket == port.socket for other in self.ports.values()) == 1:
            self._allocate(Port(bytearray(port.rom), port.socket, channel=1))

    def _pena(self, arguments: str) -> str:
        port = self._port(arguments[:2])
        if arguments[2:] not in ("D", "S", "B"):
            raise RefuseError(0x09)
        if not port.initialised:
            raise RefuseError(0x0E)
        port.enabled = True
        return "OKAY"

    def _pdis(self, arguments: str) -> str:
        self._port(arguments).enabled = False
        return "OKAY"

    def _phf(self, arguments: str) -> str:
        self._port(arguments)
        del self.ports[int(arguments, 16)]
        return "OKAY"

    def _phinf(self, arguments: str) -> str:
        port = self._port(arguments[:2])
        options = int(arguments[2:] or "0001", 16)
        system, wireless = int(self._electromagnetic), int(not port.socket)
        fields = {
            0x0001: f"{port.main_type:02X}000000NDI         00135A7B2C1{port.status:02X}",
            0x0002: "00000000",
            0x0004: definition_of(bytes(port.rom)).part_number.ljust(20),
            0x0008: "00",
            0x0010: "00" if port.socket else "28",
            0x0020: f"{'SCU-0' if port.socket else '':8}{system}{wireless}{port.socket:02d}{port.channel:02d}",
            0x0040: "00",
        }
        return "".join(text for bit, text in fields.items() if options & bit)

    def _port(self, text: str) -> Port:
        try:
            return self.ports[int(text, 16)]
        except (ValueError, KeyError):
            raise RefuseError(0x08) from None


def _wired_port(number: int, kind: str) -> Port:
    """Returns a plug as the device finds it at INIT."""
    rom = make_rom(REFERENCE_TYPE if kind == "reference" else PROBE_TYPE)
    return Port(bytearray(rom.ljust(_ROM_SPACE, b"\0")), number, programmed=kind != "unprogrammed")
