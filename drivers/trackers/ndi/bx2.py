"""Decodes and encodes BX2, the binary reply of newer units (Vega, Lyra, from APIREV 3): a tree of components in NDI's
general format.

A component states its own size, so one of an unknown type is kept as it is and skipped. Unlike BX, a reply never
repeats data: a tool without new data is left out.
"""

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass

from probewatch.drivers.trackers.ndi.replies import Position, Transform
from probewatch.drivers.trackers.ndi.wire import Cursor, encode_container, open_container

_VERSION = 1
_MISSING_BIT = 0x0100
_HEADER = struct.Struct("<HIHI")
"""BX2: version of the general format; bit 8 of a tool's status; u16 type, u32 size, u16 option, u32 count."""

_DEEPEST = 2
"""Levels of nesting below the top. Real replies use one, a frame with its items; a damaged one must not nest until the
stack is full.
"""


@dataclass(frozen=True, slots=True)
class Tool6D:
    """Holds the pose of one tool. status: bits 0-7 code, bit 8 missing, bits 13-15 face. transform: None if and only if
    missing.
    """

    handle: int
    status: int
    transform: Transform | None

    @property
    def code(self) -> int:
        """Returns the error code: 0 ok, 3 partly out of volume, 9 out of volume; the rest are in
        drivers.trackers.ndi.pose_status.
        """
        return self.status & 0xFF


@dataclass(frozen=True, slots=True)
class Marker3D:
    """Holds one marker. status: 0 ok, 1 missing, 2 angle, 3 bad fit, 4 outside, 5 outside and used, 6 phantom, 7 and 8
    saturated.
    """

    index: int
    status: int
    position_mm: Position | None


@dataclass(frozen=True, slots=True)
class Tool3D:
    """Holds the markers of one handle; 0xFFFF collects the strays."""

    handle: int
    markers: tuple[Marker3D, ...]


@dataclass(frozen=True, slots=True)
class Buttons1D:
    """Holds the states of the buttons of one handle, 0 or 1 each."""

    handle: int
    pressed: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Errors3D:
    """Holds (marker index, error in mm) of the markers of one handle."""

    handle: int
    errors_mm: tuple[tuple[int, float], ...]


@dataclass(frozen=True, slots=True)
class Alert:
    """Holds one alert. kind: 0 fault, 1 alert, 2 event. code: that within the kind."""

    kind: int
    code: int


@dataclass(frozen=True, slots=True)
class Opaque:
    """Holds, byte for byte, a component for which this driver has no use."""

    type: int
    option: int
    count: int
    data: bytes


@dataclass(frozen=True, slots=True)
class FrameItem:
    """Holds one exposure. type: 1 active wireless, 2 passive, 3 active, 7 magnetic. seconds, nanoseconds: by the
    device's clock.
    """

    type: int
    sequence: int
    status: int
    number: int
    seconds: int
    nanoseconds: int
    components: tuple["Component", ...]

    def tools(self) -> Iterator[Tool6D]:
        """Yields every 6D item of the exposure, in whichever component it is."""
        for component in self.components:
            if isinstance(component, SixD):
                yield from component.items


@dataclass(frozen=True, slots=True)
class Frames:
    """Represents component 0x0001, exposures."""

    items: tuple[FrameItem, ...]


@dataclass(frozen=True, slots=True)
class SixD:
    """Represents component 0x0002, poses of tools."""

    items: tuple[Tool6D, ...]


@dataclass(frozen=True, slots=True)
class ThreeD:
    """Represents component 0x0003, markers."""

    items: tuple[Tool3D, ...]


@dataclass(frozen=True, slots=True)
class OneD:
    """Represents component 0x0004, buttons."""

    items: tuple[Buttons1D, ...]


@dataclass(frozen=True, slots=True)
class ErrorLists:
    """Represents component 0x0009, errors of markers."""

    items: tuple[Errors3D, ...]


@dataclass(frozen=True, slots=True)
class Alerts:
    """Represents component 0x0012, alerts."""

    items: tuple[Alert, ...]


Component = Frames | SixD | ThreeD | OneD | ErrorLists | Alerts | Opaque


def decode_bx2(reply: bytes) -> tuple[Component, ...]:
    """Decodes one whole BX2 reply. Raises ProtocolError for anything but a flawless reply."""
    cursor = Cursor(open_container(reply), "BX2 reply")
    components = _components(cursor, 0)
    cursor.finish()
    return components


def encode_bx2(components: tuple[Component, ...], extended: bool = False) -> bytes:
    """Encodes components as a device sends them; `extended` chooses the container without CRC."""
    return encode_container(_components_bytes(components), extended)


def frames(components: tuple[Component, ...]) -> Iterator[FrameItem]:
    """Yields every exposure of a reply, in its order."""
    for component in components:
        if isinstance(component, Frames):
            yield from component.items


def alerts(components: tuple[Component, ...]) -> Iterator[Alert]:
    """Yields every alert of a reply, at the top or within an exposure."""
    for component in components:
        if isinstance(component, Alerts):
            yield from component.items
        elif isinstance(component, Frames):
            for item in component.items:
                yield from alerts(item.components)


def _components(cursor: Cursor, depth: int) -> tuple[Component, ...]:
    version, count = cursor.unpack("HH")
    if version != _VERSION or depth > _DEEPEST:
        raise cursor.refuse(f"format version {version} at depth {depth} is not known")
    return tuple(_component(cursor, depth) for _ in range(count))


def _component(cursor: Cursor, depth: int) -> Component:
    kind, size, option, count = cursor.unpack("HIHI")
    if size < _HEADER.size:
        raise cursor.refuse(f"a component of {size} bytes is shorter than its header")
    data = cursor.take(size - _HEADER.size)
    if kind not in _KNOWN:
        return Opaque(kind, option, count, data)
    if count > len(data):
        raise cursor.refuse(f"{count} items cannot stand in {len(data)} bytes")
    inner = Cursor(data, "BX2 reply")
    component = _known_component(inner, kind, count, depth)
    inner.finish()
    return component


def _known_component(inner: Cursor, kind: int, count: int, depth: int) -> Component:
    items = range(count)
    match kind:
        case 0x0001:
            return Frames(tuple(_frame(inner, depth) for _ in items))
        case 0x0002:
            return SixD(tuple(_tool_6d(inner) for _ in items))
        case 0x0003:
            return ThreeD(tuple(_tool_3d(inner) for _ in items))
        case 0x0004:
            return OneD(tuple(_buttons(inner) for _ in items))
        case 0x0009:
            return ErrorLists(tuple(_errors(inner) for _ in items))
        case _:
            return Alerts(tuple(_alert(inner) for _ in items))


def _frame(cursor: Cursor, depth: int) -> FrameItem:
    kind, sequence, status, number, seconds, nanoseconds = cursor.unpack("BBHIII")
    return FrameItem(kind, sequence, status, number, seconds, nanoseconds, _components(cursor, depth + 1))


def _tool_6d(cursor: Cursor) -> Tool6D:
    handle, status = cursor.unpack("HH")
    if status & _MISSING_BIT:
        return Tool6D(handle, status, None)
    values = cursor.unpack("8f")
    return Tool6D(handle, status, Transform(values[:4], values[4:7], values[7]))


def _tool_3d(cursor: Cursor) -> Tool3D:
    handle, count = cursor.unpack("HH")
    return Tool3D(handle, tuple(_marker_3d(cursor) for _ in range(count)))


def _marker_3d(cursor: Cursor) -> Marker3D:
    status, _, index = cursor.unpack("BBH")
    position = None if status == 1 else cursor.unpack("3f")
    if position is not None and not all(map(math.isfinite, position)):
        raise cursor.refuse("a marker position that is not finite")
    return Marker3D(index, status, position)


def _buttons(cursor: Cursor) -> Buttons1D:
    handle, count = cursor.unpack("HH")
    return Buttons1D(handle, tuple(cursor.take(count)))


def _errors(cursor: Cursor) -> Errors3D:
    handle, count = cursor.unpack("HH")
    errors: tuple[tuple[int, float], ...] = tuple(cursor.unpack("Hf") for _ in range(count))
    if not all(math.isfinite(error) for _, error in errors):
        raise cursor.refuse("a marker error that is not finite")
    return Errors3D(handle, errors)


def _alert(cursor: Cursor) -> Alert:
    kind, _, code = cursor.unpack("BBH")
    return Alert(kind, code)


_TYPES = {Frames: 0x0001, SixD: 0x0002, ThreeD: 0x0003, OneD: 0x0004, ErrorLists: 0x0009, Alerts: 0x0012}
"""BX2: component types; others are kept as they are (Opaque)."""
_KNOWN = frozenset(_TYPES.values())


def _components_bytes(components: tuple[Component, ...]) -> bytes:
    return struct.pack("<HH", _VERSION, len(components)) + b"".join(map(_component_bytes, components))


def _component_bytes(component: Component) -> bytes:
    if isinstance(component, Opaque):
        size = _HEADER.size + len(component.data)
        return _HEADER.pack(component.type, size, component.option, component.count) + component.data
    data = b"".join(_item_bytes(item) for item in component.items)
    return _HEADER.pack(_TYPES[type(component)], _HEADER.size + len(data), 0, len(component.items)) + data


def _item_bytes(item: FrameItem | Tool6D | Tool3D | Buttons1D | Errors3D | Alert) -> bytes:
    match item:
        case FrameItem():
            head = (item.type, item.sequence, item.status, item.number, item.seconds, item.nanoseconds)
            return struct.pack("<BBHIII", *head) + _components_bytes(item.components)
        case Tool6D():
            return struct.pack("<HH", item.handle, item.status) + _transform_bytes(item.transform)
        case Tool3D():
            head_3d = struct.pack("<HH", item.handle, len(item.markers))
            return head_3d + b"".join(map(_marker_bytes, item.markers))
        case Buttons1D():
            return struct.pack("<HH", item.handle, len(item.pressed)) + bytes(item.pressed)
        case Errors3D():
            pairs = b"".join(struct.pack("<Hf", *pair) for pair in item.errors_mm)
            return struct.pack("<HH", item.handle, len(item.errors_mm)) + pairs
        case Alert():
            return struct.pack("<BBH", item.kind, 0, item.code)


def _transform_bytes(transform: Transform | None) -> bytes:
    if transform is None:
        return b""
    return struct.pack("<8f", *transform.quaternion, *transform.translation_mm, transform.error)


def _marker_bytes(marker: Marker3D) -> bytes:
    head = struct.pack("<BBH", marker.status, 0, marker.index)
    return head if marker.position_mm is None else head + struct.pack("<3f", *marker.position_mm)
