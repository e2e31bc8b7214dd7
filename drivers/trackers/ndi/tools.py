"""Represents the tools: those that the configuration requests, and what the device reports about those it has."""

import re
from dataclasses import dataclass

from probewatch.drivers.errors import ConfigurationError, ProtocolError
from probewatch.drivers.printable import printable
from probewatch.drivers.trackers.ndi.rom import ToolDefinition, read_rom

INFORMATION = "0025"
"""Options of PHINF that parse_information reads: type and state, part number, location."""

_LENGTH = 33 + 20 + 14
_REFERENCE_TYPE, _BUTTON_TYPE = 0x01, 0x03
"""Combined API, PHINF: characters of its options 0001, 0004 and 0020; main types of tools."""

_WISH = re.compile(r"(?P<file>[^@]*)(?:@(?P<socket>\d{1,2})(?P<half>[ab]?))?")
_WISH_REMEDY = "Give FILE.rom for a wireless tool, @2 for the one on plug 2, @2b for its second sensor"


@dataclass(frozen=True, slots=True)
class RequestedTool:
    """Represents a tool as a URL names it: by a definition file, by a plug (from 1; channel 1 is the second sensor of a
    dual tool), or by both for a wired tool without a memory of its own.
    """

    definition: ToolDefinition | None = None
    socket: int | None = None
    channel: int = 0

    @property
    def wireless(self) -> bool:
        return self.socket is None


def parse_requested_tool(text: str, where: str) -> RequestedTool:
    """Parses `FILE.rom`, `@2`, `@2b` or `FILE.rom@2`. Raises ConfigurationError."""
    match = _WISH.fullmatch(text)
    if match is None or not text:
        raise ConfigurationError(f"'{text}' names no tool", where, _WISH_REMEDY)
    definition = read_rom(match["file"]) if match["file"] else None
    socket = int(match["socket"]) if match["socket"] else None
    if definition is None and not socket:
        raise ConfigurationError(f"'{text}' names no tool", where, _WISH_REMEDY)
    return RequestedTool(definition, socket, channel=int(match["half"] == "b"))


@dataclass(frozen=True, slots=True)
class ToolInformation:
    """Holds what PHINF reports about one port handle. socket: plug, counted from 1; 0 for a wireless tool. channel: 1
    for a second sensor.
    """

    main_type: int
    manufacturer: str
    serial_number: str
    part_number: str
    wireless: bool
    socket: int
    channel: int

    @property
    def is_reference(self) -> bool:
        return self.main_type == _REFERENCE_TYPE

    @property
    def priority(self) -> str:
        """Returns how PENA shall enable it: static, button box or dynamic."""
        if self.is_reference:
            return "S"
        return "B" if self.main_type == _BUTTON_TYPE else "D"

    def fits(self, requested: RequestedTool) -> bool:
        """Returns whether this is the requested wired tool."""
        return not self.wireless and (self.socket, self.channel) == (requested.socket, requested.channel)


@dataclass(frozen=True, slots=True)
class Tool:
    """Represents one enabled port handle. definition: as loaded from a file. five_dof: whether it does not measure the
    rotation about its own axis.
    """

    handle: int
    information: ToolInformation | None
    definition: ToolDefinition | None
    five_dof: bool

    @property
    def name(self) -> str:
        """Returns the name for messages."""
        if self.information is None or self.information.wireless:
            return f"tool {self.handle:02X}"
        half = "ab"[self.information.channel] if self.five_dof else ""
        return f"tool on plug {self.information.socket}{half}"


def choose_probe(tools: tuple[Tool, ...], named: bool, where: str) -> Tool:
    """Returns the probe: the first tool if the configuration names it, else the first of six degrees of freedom that is
    no reference.

    Raises ConfigurationError where no tool has six.
    """
    candidates = [
        tool for tool in tools if not tool.five_dof and not (tool.information and tool.information.is_reference)
    ]
    probe = tools[0] if named else (candidates or tools)[0]
    if probe.five_dof:
        what = f"the {probe.name} has sensors of five degrees of freedom: they do not measure the turn about their axis"
        raise ConfigurationError(what, where, "Use a probe with a sensor of six degrees of freedom")
    return probe


def parse_information(text: str) -> ToolInformation | None:
    """Parses a reply to PHINF 0025; None for an empty port. Raises ProtocolError."""
    if text == "UNOCCUPIED":
        return None
    place = text[33 + 20 :]
    try:
        if len(text) != _LENGTH:
            raise ValueError
        return ToolInformation(
            main_type=int(text[0:2], 16),
            manufacturer=printable(text[8:20].strip()),
            serial_number=printable(text[23:31].strip()),
            part_number=printable(text[33:53].strip()),
            wireless=place[9] == "1",
            socket=int(place[10:12].strip() or "0"),
            channel=int(place[12:14].strip() or "0"),
        )
    except ValueError:
        raise ProtocolError(f"PHINF answered {text[:80]!r}") from None
