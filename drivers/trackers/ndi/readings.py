"""Brings what TX, BX and BX2 report about a tool into one form, so that the rest of the driver need not know which it
was.

TX and BX list every enabled tool in every reply, with old data where there are no new ones. BX2 leaves out what has not
been measured since the last reply.
"""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.samples import PoseStatus
from probewatch.drivers.trackers.marker_geometry import Points
from probewatch.drivers.trackers.ndi import bx2
from probewatch.drivers.trackers.ndi.bx import decode_bx
from probewatch.drivers.trackers.ndi.identity import ReplyKind
from probewatch.drivers.trackers.ndi.pose_status import SYSTEM_PORTS_CHANGED, StatusReason, status_of_6d, status_of_tool
from probewatch.drivers.trackers.ndi.replies import (
    MOST_MARKERS,
    HandleState,
    Markers,
    Options,
    ToolInformation,
    ToolReply,
    Transform,
)
from probewatch.drivers.trackers.ndi.status_text import BX2_PORT_EVENTS, bx2_alert_mask
from probewatch.drivers.trackers.ndi.tx import decode_tx
from probewatch.drivers.trackers.ndi.wire import Command, encode_command

_SHORT = Options.POSE | Options.OUT_OF_VOLUME
_DETAILED = _SHORT | Options.TOOL_INFORMATION | Options.TOOL_MARKERS | Options.PASSIVE_STRAYS
_OUTSIDE_3D = (4, 5, 8)
_STRAYS = 0xFFFF
"""BX2, 3D items. Marker status: outside the volume, outside and used, outside and saturated. Handle of strays."""

_BINARY_TOOL_BYTES, _TEXT_TOOL_BYTES = 110, 250
"""First guess at the bytes of each tool in the longest reply with details: a tool of four markers takes 103 bytes of
BX, one of seven 243 of TX. Too few let the first detailed reply on a slow line come too late, until its length is
known; too many give a silent device on such a line longer.
"""

_MOST_LISTED = 256
"""Largest of BX2's marker indices, which have 16 bits: more than any tool has, and little memory for an index that is
damaged.
"""


@dataclass(frozen=True, slots=True, eq=False)
class MarkerReading:
    """Holds the markers of one tool. positions_mm: (n, 3), in the order of the definition if ordered, else in the order
    in which they were found.

    outside: how many of them are out of the volume.
    """

    positions_mm: Points
    outside: int
    ordered: bool


@dataclass(frozen=True, slots=True)
class Reading:
    """Holds what a reply reports about one tool. status_reason: whether its pose may be trusted. transform: None where
    it was not seen.

    tick: value of the device's clock: frame counter (32 bits) for TX and BX, nanoseconds for BX2; None if not stated.
    frame: frame number, as it is logged. markers: None where the reply has no details.
    """

    status_reason: StatusReason
    transform: Transform | None
    tick: int | None
    frame: int | None
    markers: MarkerReading | None = None

    @property
    def usable(self) -> bool:
        """Returns whether its pose may be trusted as far as this reply alone shows."""
        return self.status_reason[0] is PoseStatus.OK and self.transform is not None


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Holds one reply. tools: by port handle. alerts: mask as of Info.Status.Alerts, as far as BX2 reports it.

    strays: number of markers that belong to no tool. ports_changed: whether a tool or a unit was plugged in or
    unplugged.
    """

    tools: dict[int, Reading] = field(default_factory=dict)
    system_status: int = 0
    alerts: int = 0
    strays: int = 0
    ports_changed: bool = False


class Dialect(Protocol):
    """Asks for poses with one tracking command, and reads the answer. repeats: whether old data are sent again.

    tool_bytes: approximate bytes of a tool of four markers in a detailed reply.
    """

    repeats: bool
    tool_bytes: int

    def request(self, detailed: bool) -> bytes:
        """Returns the bytes to send. detailed: whether to ask for marker positions, flags and strays as well."""

    def decode(self, reply: bytes, detailed: bool) -> Snapshot:
        """Decodes one whole reply to that request. Raises ProtocolError."""


def dialect(kind: ReplyKind) -> Dialect:
    """Returns the dialect of a tracking command."""
    return Bx2Dialect() if kind is ReplyKind.BX2 else RepeatingDialect(kind)


class RepeatingDialect:
    """Makes requests and reads replies of TX or BX, which repeat a measurement."""

    repeats = True

    def __init__(self, kind: ReplyKind) -> None:
        self._decode = decode_bx if kind is ReplyKind.BX else decode_tx
        self.tool_bytes = _BINARY_TOOL_BYTES if kind is ReplyKind.BX else _TEXT_TOOL_BYTES
        self._requests = {
            detailed: encode_command(Command(kind.name, f"{int(options):04X}"))
            for detailed, options in ((False, _SHORT), (True, _DETAILED))
        }

    def request(self, detailed: bool) -> bytes:
        return self._requests[detailed]

    def decode(self, reply: bytes, detailed: bool) -> Snapshot:
        said = self._decode(reply, _DETAILED if detailed else _SHORT)
        strays = 0 if said.strays is None else len(said.strays.outside)
        tools = {tool.handle: _reading(tool) for tool in said.tools}
        return Snapshot(tools, said.system_status, 0, strays, bool(said.system_status & SYSTEM_PORTS_CHANGED))


class Bx2Dialect:
    """Makes requests and reads replies of BX2."""

    repeats = False
    tool_bytes = _BINARY_TOOL_BYTES

    def request(self, detailed: bool) -> bytes:
        return _BX2_REQUESTS[detailed]

    def decode(self, reply: bytes, detailed: bool) -> Snapshot:
        """Decodes a reply. Where it has two exposures, the later one counts for a tool that is in both."""
        components = bx2.decode_bx2(reply)
        tools: dict[int, Reading] = {}
        strays = 0
        for frame in bx2.frames(components):
            markers = {tool.handle: tool for tool in _tools_3d(frame)}
            strays += len(markers[_STRAYS].markers) if _STRAYS in markers else 0
            tools |= _readings_6d(frame, markers)
        said = [(alert.kind, alert.code) for alert in bx2.alerts(components)]
        return Snapshot(tools, 0, bx2_alert_mask(said), strays, bool(BX2_PORT_EVENTS.intersection(said)))


_BX2_REQUESTS = {
    False: encode_command(Command("BX2", "--6d=tools")),
    True: encode_command(Command("BX2", "--6d=tools --3d=all")),
}


def _reading(tool: ToolReply) -> Reading:
    listed = tool.state in (HandleState.VALID, HandleState.MISSING)
    markers = None if tool.markers is None else _markers(tool.markers, tool.information)
    return Reading(status_of_tool(tool), tool.transform, tool.frame, tool.frame, markers) if listed else _absent(tool)


def _absent(tool: ToolReply) -> Reading:
    return Reading(status_of_tool(tool), None, None, None)


def _markers(markers: Markers, information: ToolInformation | None) -> MarkerReading:
    """Returns the markers of a tool. They are listed without numbers; the flags show which ones they are, if both agree
    on how many there are.
    """
    positions = _points([place for place in markers.positions_mm if place is not None])
    seen = [i for i, flag in enumerate(information.markers) if flag] if information is not None else []
    if len(seen) != len(positions):
        return MarkerReading(positions, sum(markers.outside), ordered=False)
    ordered = np.full((MOST_MARKERS, 3), np.nan)
    ordered[seen] = positions
    return MarkerReading(ordered, sum(markers.outside), ordered=True)


def _readings_6d(frame: bx2.FrameItem, markers: dict[int, bx2.Tool3D]) -> dict[int, Reading]:
    tools = list(frame.tools())
    if len({tool.handle for tool in tools}) != len(tools):
        raise ProtocolError("a port handle is listed twice", "BX2 reply")
    return {tool.handle: _reading_6d(tool, frame, markers.get(tool.handle)) for tool in tools}


def _reading_6d(tool: bx2.Tool6D, frame: bx2.FrameItem, markers: bx2.Tool3D | None) -> Reading:
    tick = frame.seconds * 1_000_000_000 + frame.nanoseconds
    found = None if markers is None else _markers_3d(markers)
    return Reading(status_of_6d(tool), tool.transform, tick, frame.number, found)


def _markers_3d(tool: bx2.Tool3D) -> MarkerReading:
    size = max((marker.index for marker in tool.markers), default=-1) + 1
    positions = np.full((min(max(size, MOST_MARKERS), _MOST_LISTED), 3), np.nan)
    for marker in tool.markers:
        if marker.position_mm is not None and marker.index < len(positions):
            positions[marker.index] = marker.position_mm
    return MarkerReading(positions, sum(marker.status in _OUTSIDE_3D for marker in tool.markers), ordered=True)


def _tools_3d(frame: bx2.FrameItem) -> list[bx2.Tool3D]:
    return [tool for component in frame.components if isinstance(component, bx2.ThreeD) for tool in component.items]


def _points(places: list[tuple[float, float, float]]) -> Points:
    return np.asarray(places, np.float64).reshape(-1, 3)
