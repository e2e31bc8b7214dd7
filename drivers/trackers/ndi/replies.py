"""Represents replies of TX and BX: lengths in mm, quaternions scalar first, flags of markers in the order A, B, C …"""

import math
from dataclasses import dataclass
from enum import Enum, IntEnum

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.rigid import pose_matrix
from probewatch.drivers.samples import Matrix4
from probewatch.drivers.trackers.pose_bounds import FURTHEST_MM, UNIT_TOLERANCE

Position = tuple[float, float, float]
"""x, y, z in the tracker's frame, mm."""

MOST_MARKERS = 20
"""Marker places of one tool, A to T: as many as states in the tool information and positions in a .rom file."""

STRAY_STATES = (0x00, 0x01, 0x02, 0x08)
"""Combined API, single stray marker of TX and BX: none, valid, missing, out of volume. Others mean a damaged reply."""


class Options(IntEnum):
    """Enumerates the reply options of TX and BX; their sum is the request's argument and decides how a reply is
    read.
    """

    POSE = 0x0001
    TOOL_INFORMATION = 0x0002
    ACTIVE_STRAY = 0x0004
    TOOL_MARKERS = 0x0008
    OUT_OF_VOLUME = 0x0800
    PASSIVE_STRAYS = 0x1000
    """Combined API, reply options of TX and BX: bits."""


_ALL_OPTIONS = sum(Options)


class HandleState(Enum):
    """Enumerates the states in which a port handle is listed."""

    VALID = "valid"
    MISSING = "missing"
    DISABLED = "disabled"
    UNOCCUPIED = "unoccupied"


@dataclass(frozen=True, slots=True)
class Transform:
    """Holds a tool's pose. quaternion: (q0, qx, qy, qz), unit, of arbitrary sign. error: marker fit RMS, mm (Polaris),
    or indicator value (Aurora).

    Raises ProtocolError for a quaternion that is not unit, and for values beyond FURTHEST_MM.
    """

    quaternion: tuple[float, float, float, float]
    translation_mm: Position
    error: float

    def __post_init__(self) -> None:
        length = math.hypot(*self.quaternion)
        if not abs(length - 1.0) <= UNIT_TOLERANCE:  # NaN fails every comparison
            raise ProtocolError(f"a pose whose quaternion has length {length:.4g}")
        for value in (*self.translation_mm, self.error):
            if not -FURTHEST_MM <= value <= FURTHEST_MM:
                raise ProtocolError(f"a pose with {value:.4g} mm in it")

    def matrix(self) -> Matrix4:
        """Returns the transform (4, 4) tool → tracker, mm."""
        return pose_matrix(self.quaternion, self.translation_mm)


@dataclass(frozen=True, slots=True)
class Markers:
    """Holds single markers. outside: (n,) whether each is out of the measurement volume. positions_mm: (n,), None where
    not reported.
    """

    outside: tuple[bool, ...]
    positions_mm: tuple[Position | None, ...]


@dataclass(frozen=True, slots=True)
class ToolInformation:
    """Holds the details of one tool. flags: bad fit 1, too few markers 2, infrared interference 4, fell behind 8, face
    0x70, exception 0x80.

    markers: (20,) 0 unused or missing, 1 beyond its angle, 2 beyond its error, 3 used, 4 used and outside, 5 outside.
    """

    flags: int
    markers: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ActiveStray:
    """Holds a single stray marker. status: 0 none, 1 valid, 2 missing, 8 out of volume. position_mm: None if absent."""

    status: int
    position_mm: Position | None = None


@dataclass(frozen=True, slots=True)
class ToolReply:
    """Holds one port handle of a reply; a field is None where the options or the state leave it out."""

    handle: int
    state: HandleState
    transform: Transform | None = None
    port_status: int | None = None
    frame: int | None = None
    information: ToolInformation | None = None
    stray: ActiveStray | None = None
    markers: Markers | None = None


@dataclass(frozen=True, slots=True)
class TrackingReply:
    """Holds one TX or BX reply. system_status: bits as in docs/protocols.md, 0 in health."""

    tools: tuple[ToolReply, ...]
    system_status: int = 0
    strays: Markers | None = None

    def tool(self, handle: int) -> ToolReply | None:
        """Returns the entry of one handle, whatever the order of the reply; None where it is not listed."""
        return next((tool for tool in self.tools if tool.handle == handle), None)


def known_options(options: int) -> int:
    """Returns the options as given. Raises ProtocolError for reply options that this decoder cannot read."""
    if options & ~_ALL_OPTIONS:
        raise ProtocolError(f"reply options {options:04X} are not supported")
    return int(options)


def distinct_handles(tools: tuple[ToolReply, ...]) -> tuple[ToolReply, ...]:
    """Returns the tools as given. Raises ProtocolError when a handle is listed twice."""
    if len({tool.handle for tool in tools}) != len(tools):
        raise ProtocolError("a port handle is listed twice")
    return tools


def outside_flags(count: int, bits: int) -> tuple[bool, ...]:
    """Returns whether each marker is out of the volume; bit i is marker i. Raises ProtocolError for further bits."""
    if bits >> count:
        raise ProtocolError(f"out-of-volume bits {bits:#x} for {count} markers")
    return tuple(bool(bits >> i & 1) for i in range(count))


def marker_nibbles(packed: int) -> tuple[int, ...]:
    """Returns (20,) marker states; marker A is the lowest nibble."""
    return tuple(packed >> 4 * i & 0xF for i in range(MOST_MARKERS))


def packed_nibbles(markers: tuple[int, ...]) -> int:
    """Computes the inverse of marker_nibbles."""
    return sum(state << 4 * i for i, state in enumerate(markers))


def outside_bits(markers: Markers) -> int:
    """Computes the inverse of outside_flags."""
    return sum(1 << i for i, outside in enumerate(markers.outside) if outside)
