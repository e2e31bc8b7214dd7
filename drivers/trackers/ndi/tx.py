"""Decodes and encodes TX, the text reply with the last pose of every enabled tool (Combined API).

Its numbers are signed decimals of fixed width: quaternion and error in 1e-4, lengths in 0.01 mm.
"""

import re

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.trackers.ndi.replies import (
    STRAY_STATES,
    ActiveStray,
    HandleState,
    Markers,
    Options,
    Position,
    ToolInformation,
    ToolReply,
    TrackingReply,
    Transform,
    distinct_handles,
    known_options,
    marker_nibbles,
    outside_bits,
    outside_flags,
    packed_nibbles,
)
from probewatch.drivers.trackers.ndi.wire import Cursor, decode_text, encode_text

_DECIMAL = re.compile(rb"[+-][0-9]+")
_HEX = re.compile(rb"[0-9A-Fa-f]+")
_WORDS = {
    b"MISSING": HandleState.MISSING,
    b"DISABLED": HandleState.DISABLED,
    b"UNOCCUPIED": HandleState.UNOCCUPIED,
}
_TEXT = {state: word.decode() for word, state in _WORDS.items()}


def decode_tx(reply: bytes, options: int) -> TrackingReply:
    """Decodes one whole TX reply, requested with `options`. Raises ProtocolError for anything but a flawless reply."""
    wanted = known_options(options)
    cursor = Cursor(decode_text(reply).encode("latin-1"), "TX reply")
    tools = distinct_handles(tuple(_tool(cursor, wanted) for _ in range(_hex(cursor, 2))))
    strays = _markers(cursor, wanted) if wanted & Options.PASSIVE_STRAYS else None
    status = _hex(cursor, 4)
    cursor.finish()
    return TrackingReply(tools, status, strays)


def encode_tx(reply: TrackingReply, options: int) -> bytes:
    """Encodes `reply` as a device sends it, rounded as the text form rounds."""
    wanted = known_options(options)
    text = f"{len(reply.tools):02X}" + "".join(_tool_text(tool, wanted) for tool in reply.tools)
    if wanted & Options.PASSIVE_STRAYS and reply.strays is not None:
        text += _marker_text(reply.strays)
    return encode_text(f"{text}{reply.system_status:04X}")


def _tool(cursor: Cursor, wanted: int) -> ToolReply:
    handle, state = _hex(cursor, 2), _state(cursor)
    if state in (HandleState.DISABLED, HandleState.UNOCCUPIED):
        _end_of_line(cursor)
        return ToolReply(handle, state)
    transform, port_status, frame = None, None, None
    if wanted & Options.POSE:
        transform = _transform(cursor) if state is HandleState.VALID else None
        port_status, frame = _hex(cursor, 8), _hex(cursor, 8)
    information = _information(cursor) if wanted & Options.TOOL_INFORMATION else None
    stray = _stray(cursor, wanted) if wanted & Options.ACTIVE_STRAY else None
    markers = _markers(cursor, wanted) if wanted & Options.TOOL_MARKERS else None
    _end_of_line(cursor)
    return ToolReply(handle, state, transform, port_status, frame, information, stray, markers)


def _state(cursor: Cursor) -> HandleState:
    for word, state in _WORDS.items():
        if cursor.starts_with(word):
            cursor.take(len(word))
            return state
    return HandleState.VALID


def _transform(cursor: Cursor) -> Transform:
    q0, qx, qy, qz = (_decimal(cursor, 5, 1e4) for _ in range(4))
    return Transform((q0, qx, qy, qz), _position(cursor), _decimal(cursor, 5, 1e4))


def _information(cursor: Cursor) -> ToolInformation:
    return ToolInformation(_hex(cursor, 2), marker_nibbles(_hex(cursor, 20)))


def _stray(cursor: Cursor, wanted: int) -> ActiveStray:
    status = _hex(cursor, 2)
    if status not in STRAY_STATES:
        raise cursor.refuse(f"a single marker has the unknown state {status:02X}")
    located = status == 0x01 or (status == 0x08 and bool(wanted & Options.OUT_OF_VOLUME))
    return ActiveStray(status, _position(cursor) if located else None)


def _markers(cursor: Cursor, wanted: int) -> Markers:
    """Decodes a list of markers. Without the out-of-volume option, markers outside are counted and flagged, but their
    positions are left out.
    """
    count = _hex(cursor, 2)
    nibbles = [_hex(cursor, 1) for _ in range((count + 3) // 4)]
    outside = outside_flags(count, sum(nibble << 4 * i for i, nibble in enumerate(nibbles)))
    everywhere = bool(wanted & Options.OUT_OF_VOLUME)
    return Markers(outside, tuple(_position(cursor) if everywhere or not out else None for out in outside))


def _position(cursor: Cursor) -> Position:
    x, y, z = (_decimal(cursor, 6, 1e2) for _ in range(3))
    return (x, y, z)


def _decimal(cursor: Cursor, digits: int, divisor: float) -> float:
    field = cursor.take(digits + 1)
    if not _DECIMAL.fullmatch(field):
        raise cursor.refuse(f"{field!r} is not a signed number of {digits} digits")
    return int(field) / divisor


def _hex(cursor: Cursor, digits: int) -> int:
    field = cursor.take(digits)
    if not _HEX.fullmatch(field):
        raise cursor.refuse(f"{field!r} is not a hexadecimal number of {digits} digits")
    return int(field, 16)


def _end_of_line(cursor: Cursor) -> None:
    if cursor.take(1) != b"\n":
        raise cursor.refuse("a tool's line does not end where its fields end")


def _tool_text(tool: ToolReply, wanted: int) -> str:
    text = f"{tool.handle:02X}" + _TEXT.get(tool.state, "")
    if tool.state in (HandleState.DISABLED, HandleState.UNOCCUPIED):
        return text + "\n"
    if wanted & Options.POSE:
        text += _pose_text(tool)
    if wanted & Options.TOOL_INFORMATION and tool.information is not None:
        text += f"{tool.information.flags:02X}{packed_nibbles(tool.information.markers):020X}"
    if wanted & Options.ACTIVE_STRAY and tool.stray is not None:
        text += f"{tool.stray.status:02X}{_position_text(tool.stray.position_mm)}"
    if wanted & Options.TOOL_MARKERS and tool.markers is not None:
        text += _marker_text(tool.markers)
    return text + "\n"


def _pose_text(tool: ToolReply) -> str:
    if tool.port_status is None or tool.frame is None:
        raise ProtocolError(f"handle {tool.handle:02X} has no port status or frame number to send")
    text = ""
    if tool.transform is not None:
        text = "".join(_fixed(q, 5, 1e4) for q in tool.transform.quaternion)
        text += _position_text(tool.transform.translation_mm) + _fixed(tool.transform.error, 5, 1e4)
    return f"{text}{tool.port_status:08X}{tool.frame:08X}"


def _marker_text(markers: Markers) -> str:
    count, bits = len(markers.outside), outside_bits(markers)
    nibbles = "".join(f"{bits >> 4 * i & 0xF:X}" for i in range((count + 3) // 4))
    return f"{count:02X}{nibbles}" + "".join(map(_position_text, markers.positions_mm))


def _position_text(position: Position | None) -> str:
    return "" if position is None else "".join(_fixed(value, 6, 1e2) for value in position)


def _fixed(value: float, digits: int, factor: float) -> str:
    text = f"{round(value * factor):+0{digits + 1}d}"
    if len(text) != digits + 1:
        raise ProtocolError(f"{value} does not fit a TX field")
    return text
