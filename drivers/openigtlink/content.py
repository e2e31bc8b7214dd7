"""Parses and builds the contents of messages other than pictures: transforms, tracking data, status, words and
commands. All numbers are big-endian.

Every `parse_…` takes the content of one message and raises ProtocolError where it is not of its kind; every class has
`content`, the bytes that its parser reads. Source: as for drivers.openigtlink.message.
"""

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.openigtlink.message import UTF_8, fixed, name_of
from probewatch.drivers.samples import Matrix4

_MATRIX = struct.Struct(">12f")
_TRACKED = struct.Struct(">20sBx12f")
_TURNED = struct.Struct(">20sBx7f")
_STATUS = struct.Struct(">Hq20s")
_STRING = struct.Struct(">HH")
_COMMAND = struct.Struct(">I128sHI")
_START = struct.Struct(">i32s")
_MOST_TOOLS = 1000
"""Tools in one message; a tracker has tens. A message of 64 MiB holds 960,000, which take 16 s to read."""
_TYPE_BYTES = 12
"""Length of a message type in CAPABILITY, by the specification."""


@dataclass(frozen=True, slots=True)
class Turn:
    """Holds a position with an orientation. position: mm. quaternion: x, y, z, w, as sent: of any length."""

    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Tool:
    """Holds one element of TDATA. kind: 1 tracker, 2 six degrees of freedom, 3 three, 4 five. matrix: (4, 4), mm."""

    name: str
    kind: int
    matrix: Matrix4


@dataclass(frozen=True, slots=True)
class TurnedTool:
    """Holds one element of QTDATA."""

    name: str
    kind: int
    turn: Turn


@dataclass(frozen=True, slots=True)
class Status:
    """Represents STATUS. code: 1 is OK; see CODES. error: its name, at most 20 bytes."""

    code: int
    subcode: int = 0
    error: str = ""
    text: str = ""

    @property
    def content(self) -> bytes:
        return _STATUS.pack(self.code, self.subcode, fixed(self.error, 20)) + _utf8(self.text) + b"\0"


INVALID, OK, NOT_FOUND, TIMEOUT, CHECK_SUM, CONFIGURATION, UNKNOWN_INSTRUCTION = 0, 1, 4, 7, 9, 10, 12
NOT_READY, DISABLED, NOT_PRESENT, UNKNOWN_VERSION, HARDWARE = 13, 15, 16, 17, 18
"""Codes of STATUS, by the specification."""

CODES = {
    INVALID: "invalid",
    OK: "OK",
    2: "unknown error",
    3: "panic",
    NOT_FOUND: "not found",
    5: "access denied",
    6: "busy",
    TIMEOUT: "time out",
    8: "overflow",
    CHECK_SUM: "check sum error",
    CONFIGURATION: "configuration error",
    11: "not enough resources",
    UNKNOWN_INSTRUCTION: "unknown instruction",
    NOT_READY: "not ready",
    14: "manual mode",
    DISABLED: "disabled",
    NOT_PRESENT: "not present",
    UNKNOWN_VERSION: "unknown version",
    HARDWARE: "hardware failure",
    19: "shutting down",
}
"""Meaning of each code of STATUS, by the specification."""


@dataclass(frozen=True, slots=True)
class Words:
    """Represents STRING. encoding: see drivers.openigtlink.message."""

    text: str
    encoding: int = UTF_8

    @property
    def content(self) -> bytes:
        data = _utf8(self.text)
        return _STRING.pack(self.encoding, len(data)) + data


@dataclass(frozen=True, slots=True)
class Command:
    """Represents COMMAND, and RTS_COMMAND, in which the name is what went wrong. number: that of the command, which its
    reply repeats.
    """

    number: int
    name: str
    text: str
    encoding: int = UTF_8

    @property
    def content(self) -> bytes:
        data = _utf8(self.text)
        return _COMMAND.pack(self.number, fixed(self.name, 128), self.encoding, len(data)) + data


@dataclass(frozen=True, slots=True)
class StartTracking:
    """Represents STT_TDATA, STT_QTDATA. resolution_ms: least time between two messages. coordinates: frame of poses."""

    resolution_ms: int
    coordinates: str = ""

    @property
    def content(self) -> bytes:
        return _START.pack(self.resolution_ms, fixed(self.coordinates, 32))


def parse_transform(content: bytes) -> Matrix4:
    """Returns (4, 4), mm, of TRANSFORM; not checked to be rigid."""
    return _matrix(*_unpacked(_MATRIX, content, "TRANSFORM"))


def transform_content(matrix: Matrix4) -> bytes:
    """Converts (4, 4), mm, to TRANSFORM: column by column."""
    return _MATRIX.pack(*matrix[:3, :].T.ravel())


def parse_tools(content: bytes) -> tuple[Tool, ...]:
    """Parses TDATA."""
    return tuple(
        Tool(name_of(name), kind, _matrix(*numbers))
        for name, kind, *numbers in _TRACKED.iter_unpack(_whole(_TRACKED, content, "TDATA"))
    )


def tools_content(tools: tuple[Tool, ...]) -> bytes:
    """Builds TDATA."""
    return b"".join(_TRACKED.pack(fixed(tool.name, 20), tool.kind, *tool.matrix[:3, :].T.ravel()) for tool in tools)


def parse_turned_tools(content: bytes) -> tuple[TurnedTool, ...]:
    """Parses QTDATA."""
    return tuple(
        TurnedTool(name_of(name), kind, Turn((x, y, z), (i, j, k, w)))
        for name, kind, x, y, z, i, j, k, w in _TURNED.iter_unpack(_whole(_TURNED, content, "QTDATA"))
    )


def turned_tools_content(tools: tuple[TurnedTool, ...]) -> bytes:
    """Builds QTDATA."""
    return b"".join(
        _TURNED.pack(fixed(tool.name, 20), tool.kind, *tool.turn.position, *tool.turn.quaternion) for tool in tools
    )


def parse_position(content: bytes) -> Turn:
    """Parses POSITION. An absent quaternion is the unit one; an absent w is the positive root."""
    if len(content) not in (12, 24, 28):
        raise ProtocolError(f"POSITION has 12, 24 or 28 bytes, not {len(content)}")
    x, y, z, *turn = struct.unpack(f">{len(content) // 4}f", content)
    if not turn:
        return Turn((x, y, z), (0.0, 0.0, 0.0, 1.0))
    if len(turn) == 3:
        turn.append(max(0.0, 1.0 - sum(part * part for part in turn)) ** 0.5)
    i, j, k, w = turn
    return Turn((x, y, z), (i, j, k, w))


def position_content(turn: Turn, parts: int = 4) -> bytes:
    """Builds POSITION with `parts` parts of the quaternion: 0, 3 or 4."""
    return struct.pack(f">{3 + parts}f", *turn.position, *turn.quaternion[:parts])


def parse_status(content: bytes) -> Status:
    """Parses STATUS."""
    if len(content) < _STATUS.size:
        raise ProtocolError(f"STATUS has {_STATUS.size} bytes or more, not {len(content)}")
    code, subcode, error = _STATUS.unpack_from(content)
    return Status(code, subcode, name_of(error), name_of(content[_STATUS.size :]))


def parse_words(content: bytes) -> Words:
    """Parses STRING."""
    encoding, size = _unpacked(_STRING, content[: _STRING.size], "STRING")
    return Words(_counted(content[_STRING.size :], size, "STRING"), encoding)


def parse_command(content: bytes) -> Command:
    """Parses COMMAND, RTS_COMMAND."""
    number, name, encoding, size = _unpacked(_COMMAND, content[: _COMMAND.size], "COMMAND")
    return Command(number, name_of(name), _counted(content[_COMMAND.size :], size, "COMMAND"), encoding)


def parse_start(content: bytes) -> StartTracking:
    """Parses STT_TDATA, STT_QTDATA."""
    resolution_ms, coordinates = _unpacked(_START, content, "STT_TDATA")
    return StartTracking(resolution_ms, name_of(coordinates))


def parse_types(content: bytes) -> tuple[str, ...]:
    """Parses CAPABILITY: the message types that the sender knows."""
    if len(content) % _TYPE_BYTES:
        raise ProtocolError(f"CAPABILITY has a multiple of {_TYPE_BYTES} bytes, not {len(content)}")
    places = range(0, len(content), _TYPE_BYTES)
    return tuple(name_of(content[place : place + _TYPE_BYTES]) for place in places)


def types_content(types: tuple[str, ...]) -> bytes:
    """Builds CAPABILITY."""
    return b"".join(fixed(kind, _TYPE_BYTES) for kind in types)


def _matrix(*numbers: float) -> Matrix4:
    matrix: Matrix4 = np.eye(4)
    matrix[:3, :] = np.array(numbers).reshape(4, 3).T
    return matrix


def _unpacked(layout: struct.Struct, content: bytes, kind: str) -> tuple[Any, ...]:
    if len(content) != layout.size:
        raise ProtocolError(f"{kind} has {layout.size} bytes, not {len(content)}")
    return layout.unpack(content)


def _whole(layout: struct.Struct, content: bytes, kind: str) -> bytes:
    if len(content) % layout.size:
        raise ProtocolError(f"{kind} has a multiple of {layout.size} bytes, not {len(content)}")
    if len(content) > _MOST_TOOLS * layout.size:
        raise ProtocolError(f"{kind} has {len(content) // layout.size} tools, more than {_MOST_TOOLS}")
    return content


def _counted(data: bytes, size: int, kind: str) -> str:
    if len(data) != size:
        raise ProtocolError(f"{kind} announces {size} bytes and has {len(data)}")
    return data.decode(errors="surrogateescape")


def _utf8(text: str) -> bytes:
    return text.encode(errors="surrogateescape")
