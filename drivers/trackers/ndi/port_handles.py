"""Manages port handles: frees those that a former program left, loads definitions, initialises and enables tools, and
finds the requested ones.
"""

from collections import Counter
from collections.abc import Callable, Iterator

from probewatch.drivers.errors import DeviceLost, ProtocolError
from probewatch.drivers.trackers.ndi.rom import ToolDefinition, rom_chunks
from probewatch.drivers.trackers.ndi.tools import INFORMATION, RequestedTool, Tool, ToolInformation, parse_information
from probewatch.drivers.trackers.ndi.wire import RefusedError

Ask = Callable[[str, str], str]
"""Function (command, arguments) → text of the reply; raises RefusedError."""

_ANY_WIRELESS = "*********1****"
_ROUNDS = 8
"""Rounds of asking which handles are to be initialised. A dual tool needs two. A device that never answers "none" must
not keep the loop running, and each round may take 6 s for every tool.
"""

_SROM_ERRORS = (0x13, 0x1E)
_CONTEXT_ERRORS = (0x01, 0x0C, 0x32)
"""Combined API, ERRORxx. In answer to PINIT: the tool's memory has failed, or cannot be read. In answer to PHINF:
invalid command, not possible in this mode, not possible on this device.
"""


class PortHandles:
    """Brings the port handles of one device into use. warnings: receives problems that are no reason to give up."""

    def __init__(self, ask: Ask, where: str, warnings: list[str]) -> None:
        self._ask, self._where, self._warnings = ask, where, warnings
        self._loaded: dict[int, ToolDefinition] = {}
        self._silent: dict[int, str] = {}
        """Plug → what is wrong with the tool on it, which is not used."""

    def start(self, requested_tools: tuple[RequestedTool, ...]) -> tuple[Tool, ...]:
        """Enables all tools. Returns the requested ones in their order, then all others.

        Raises DeviceLost where a tool is absent, ProtocolError for replies that make no sense.
        """
        self._free_handles(any(requested.wireless for requested in requested_tools))
        wireless = [self._load(requested) for requested in requested_tools if requested.wireless]
        self._initialise(requested_tools)
        tools = self._enable()
        if not tools and self._silent:
            raise self._unnamed(next(iter(self._silent)))
        if not tools:
            remedy = "Plug the tool in, or name its definition file with probe=FILE.rom"
            raise DeviceLost("no tool is connected to the tracker", self._where, remedy)
        waiting = iter(wireless)
        chosen = [
            self._by_handle(tools, next(waiting)) if w.wireless else self._by_plug(tools, w) for w in requested_tools
        ]
        return (*chosen, *(tool for tool in tools if tool not in chosen))

    def _free_handles(self, unknown: bool) -> None:
        """Frees the handles that the device wants freed, and wireless tools that a former program loaded; plugs stay as
        they are.

        unknown: whether to free also those that the device does not describe.
        """
        for handle in self._handles("01"):
            self._ask("PHF", f"{handle:02X}")
        for handle in self._handles("00"):
            information = self._information(handle)
            if unknown if information is None else information.wireless:
                self._ask("PHF", f"{handle:02X}")

    def _load(self, requested: RequestedTool) -> int:
        text = self._ask("PHRQ", _ANY_WIRELESS)
        try:
            handle = int(text, 16)
        except ValueError:
            raise ProtocolError(f"PHRQ answered {text[:40]!r}") from None
        assert requested.definition is not None
        self._write(handle, requested.definition)
        return handle

    def _write(self, handle: int, definition: ToolDefinition) -> None:
        for address, chunk in rom_chunks(definition.image):
            self._ask("PVWR", f"{handle:02X}{address:04X}{chunk.hex().upper()}")
        self._loaded[handle] = definition

    def _initialise(self, requested_tools: tuple[RequestedTool, ...]) -> None:
        """Initialises handles in rounds until none is left: initialising one half of a dual tool reveals the other."""
        given_up: set[int] = set()
        for _ in range(_ROUNDS):
            waiting = [handle for handle in self._handles("02") if handle not in given_up]
            if not waiting:
                return
            given_up |= {handle for handle in waiting if not self._initialised(handle, requested_tools)}
        raise DeviceLost("tools do not become initialised", self._where, "Unplug the tools and plug them in again")

    def _initialised(self, handle: int, requested_tools: tuple[RequestedTool, ...]) -> bool:
        """Initialises one handle, and returns whether that succeeded. A wired tool whose memory cannot be read is left
        out, unless a definition was named for it.
        """
        information = None if handle in self._loaded else self._information(handle)
        if information is not None:
            for requested in requested_tools:
                if requested.definition is not None and information.fits(requested):
                    self._write(handle, requested.definition)
        try:
            self._ask("PINIT", f"{handle:02X}")
        except RefusedError as refusal:
            if handle in self._loaded or refusal.code not in _SROM_ERRORS:
                raise
            plug = f"plug {information.socket}" if information is not None else f"port {handle:02X}"
            what = f"the tool on {plug} does not say what it is"
            self._warnings.append(f"{what}; name its definition with FILE.rom@PLUG")
            if information is not None:
                self._silent[information.socket] = what
            return False
        return True

    def _enable(self) -> tuple[Tool, ...]:
        """Enables all initialised handles. Plugs that a former program left enabled stay so; the device does not offer
        them for enabling again.
        """
        found = [(handle, self._information(handle)) for handle in self._handles("04")]
        for handle in self._handles("03"):
            information = self._information(handle)
            self._ask("PENA", f"{handle:02X}{information.priority if information is not None else 'D'}")
            found.append((handle, information))
        sensors = Counter(information.socket for _, information in found if information and not information.wireless)
        return tuple(self._tool(handle, information, sensors) for handle, information in found)

    def _tool(self, handle: int, information: ToolInformation | None, sensors: Counter[int]) -> Tool:
        """Returns the tool of a handle. Two sensors behind one plug have five degrees of freedom each."""
        wired = information is not None and not information.wireless
        five_dof = wired and information is not None and sensors[information.socket] > 1
        return Tool(handle, information, self._loaded.get(handle), five_dof)

    def _by_handle(self, tools: tuple[Tool, ...], handle: int) -> Tool:
        tool = next((tool for tool in tools if tool.handle == handle), None)
        if tool is None:
            raise DeviceLost("a loaded tool was not enabled", self._where, "Check its definition file")
        return tool

    def _by_plug(self, tools: tuple[Tool, ...], requested: RequestedTool) -> Tool:
        plugged = (tool for tool in tools if tool.information is not None and tool.information.fits(requested))
        tool = next(plugged, None)
        if tool is None and requested.socket in self._silent:
            raise self._unnamed(requested.socket)
        if tool is None:
            half = f", sensor {'ab'[requested.channel]}," if requested.channel else ""
            raise DeviceLost(
                f"no tool on plug {requested.socket}{half} is ready", self._where, "Plug it in, or correct the number"
            )
        return tool

    def _unnamed(self, plug: int) -> DeviceLost:
        """Returns the error for a tool that is plugged in but cannot be used without a definition file."""
        remedy = f"Name its definition file in the URL: probe=FILE.rom@{plug}, or reference="
        return DeviceLost(self._silent[plug], self._where, remedy)

    def _information(self, handle: int) -> ToolInformation | None:
        """Returns what the device reports about the tool; None where it reports nothing, or nothing readable."""
        try:
            text = self._ask("PHINF", f"{handle:02X}{INFORMATION}")
        except RefusedError as refusal:
            if refusal.code in _CONTEXT_ERRORS:
                return None
            raise
        try:
            return parse_information(text)
        except ProtocolError as error:
            self._warnings.append(error.what)
            return None

    def _handles(self, group: str) -> Iterator[int]:
        """Returns the handles of a group of PHSR: 00 all, 01 to free, 02 to initialise, 03 to enable, 04 enabled."""
        text = self._ask("PHSR", group)
        try:
            count = int(text[:2], 16)
            if len(text) != 2 + 5 * count:
                raise ValueError
            return iter([int(text[at : at + 2], 16) for at in range(2, len(text), 5)])
        except ValueError:
            raise ProtocolError(f"PHSR {group} answered {text[:40]!r}") from None
