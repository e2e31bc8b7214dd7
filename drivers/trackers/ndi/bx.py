"""Decodes and encodes BX, the binary reply with the last pose of every enabled tool (Combined API, little-endian)."""

import math
import struct

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
from probewatch.drivers.trackers.ndi.wire import Cursor, encode_container, open_container

_STATES = {0x01: HandleState.VALID, 0x02: HandleState.MISSING, 0x04: HandleState.DISABLED}
_CODES = {state: code for code, state in _STATES.items()} | {HandleState.UNOCCUPIED: 0x04}
"""Combined API, BX: handle status. It has no code for unoccupied, which is sent as disabled."""


def decode_bx(reply: bytes, options: int) -> TrackingReply:
    """Decodes one whole BX reply, requested with `options`. Raises ProtocolError for anything but a flawless reply."""
    wanted = known_options(options)
    cursor = Cursor(open_container(reply), "BX reply")
    tools = distinct_handles(tuple(_tool(cursor, wanted) for _ in range(cursor.number("B"))))
    strays = _markers(cursor, wanted) if wanted & Options.PASSIVE_STRAYS else None
    status = cursor.number("H")
    cursor.finish()
    return TrackingReply(tools, status, strays)


def encode_bx(reply: TrackingReply, options: int) -> bytes:
    """Encodes `reply` as a device sends it; the fields that `options` name must be present."""
    wanted = known_options(options)
    body = struct.pack("<B", len(reply.tools)) + b"".join(_tool_bytes(tool, wanted) for tool in reply.tools)
    if wanted & Options.PASSIVE_STRAYS and reply.strays is not None:
        body += _marker_bytes(reply.strays)
    return encode_container(body + struct.pack("<H", reply.system_status))


def _tool(cursor: Cursor, wanted: int) -> ToolReply:
    handle, code = cursor.unpack("BB")
    if code not in _STATES:
        raise cursor.refuse(f"handle {handle:02X} has the unknown state {code:02X}")
    state = _STATES[code]
    if state is HandleState.DISABLED:
        return ToolReply(handle, state)
    transform, port_status, frame = None, None, None
    if wanted & Options.POSE and state is HandleState.VALID:
        q0, qx, qy, qz, x, y, z, error, port_status, frame = cursor.unpack("8fII")
        transform = Transform((q0, qx, qy, qz), (x, y, z), error)
    elif wanted & Options.POSE:
        port_status, frame = cursor.unpack("II")
    information = _information(cursor) if wanted & Options.TOOL_INFORMATION else None
    stray = _stray(cursor, wanted) if wanted & Options.ACTIVE_STRAY else None
    markers = _markers(cursor, wanted) if wanted & Options.TOOL_MARKERS else None
    return ToolReply(handle, state, transform, port_status, frame, information, stray, markers)


def _information(cursor: Cursor) -> ToolInformation:
    flags = cursor.number("B")
    return ToolInformation(flags, marker_nibbles(int.from_bytes(cursor.take(10), "big")))


def _stray(cursor: Cursor, wanted: int) -> ActiveStray:
    status = cursor.number("B")
    if status not in STRAY_STATES:
        raise cursor.refuse(f"a single marker has the unknown state {status:02X}")
    located = status == 0x01 or (status == 0x08 and bool(wanted & Options.OUT_OF_VOLUME))
    return ActiveStray(status, _position(cursor) if located else None)


def _markers(cursor: Cursor, wanted: int) -> Markers:
    """Decodes a list of markers. Without the out-of-volume option, markers outside are counted and flagged, but their
    positions are left out.
    """
    count = cursor.number("B")
    outside = outside_flags(count, int.from_bytes(cursor.take((count + 7) // 8), "little"))
    everywhere = bool(wanted & Options.OUT_OF_VOLUME)
    positions = tuple(_position(cursor) if everywhere or not out else None for out in outside)
    return Markers(outside, positions)


def _position(cursor: Cursor) -> Position:
    position: Position = cursor.unpack("3f")
    if not all(map(math.isfinite, position)):
        raise cursor.refuse("a marker position that is not finite")
    return position


def _tool_bytes(tool: ToolReply, wanted: int) -> bytes:
    data = struct.pack("<BB", tool.handle, _CODES[tool.state])
    if tool.state in (HandleState.DISABLED, HandleState.UNOCCUPIED):
        return data
    if wanted & Options.POSE:
        data += _pose_bytes(tool)
    if wanted & Options.TOOL_INFORMATION and tool.information is not None:
        data += struct.pack("<B", tool.information.flags) + packed_nibbles(tool.information.markers).to_bytes(10, "big")
    if wanted & Options.ACTIVE_STRAY and tool.stray is not None:
        data += struct.pack("<B", tool.stray.status) + _position_bytes(tool.stray.position_mm)
    if wanted & Options.TOOL_MARKERS and tool.markers is not None:
        data += _marker_bytes(tool.markers)
    return data


def _pose_bytes(tool: ToolReply) -> bytes:
    if tool.port_status is None or tool.frame is None:
        raise ProtocolError(f"handle {tool.handle:02X} has no port status or frame number to send")
    transform = tool.transform
    data = b""
    if transform is not None:
        data = struct.pack("<8f", *transform.quaternion, *transform.translation_mm, transform.error)
    return data + struct.pack("<II", tool.port_status, tool.frame)


def _marker_bytes(markers: Markers) -> bytes:
    count = len(markers.outside)
    flags = outside_bits(markers).to_bytes((count + 7) // 8, "little")
    return struct.pack("<B", count) + flags + b"".join(map(_position_bytes, markers.positions_mm))


def _position_bytes(position: Position | None) -> bytes:
    return b"" if position is None else struct.pack("<3f", *position)
