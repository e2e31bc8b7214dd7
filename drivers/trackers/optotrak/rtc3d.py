"""Converts packets of RTC3D, the stream of NDI's First Principles server (TCP 3020), to bytes and back.

A packet is u32 size with these 8 bytes, u32 type, both always big-endian, and a payload whose byte order the client
chooses (docs/protocols.md). There is no checksum: the only safeguards of a packet are that three sizes and two counts
agree to the byte, that a quaternion has length one, and that a coordinate lies within a kilometre.
"""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, IntEnum

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.rigid import pose_matrix
from probewatch.drivers.samples import Matrix4
from probewatch.drivers.trackers.pose_bounds import FURTHEST_MM, UNIT_TOLERANCE

HEADER_BYTES = 8
"""RTC3D: u32 size, u32 type."""

MAX_PACKET_BYTES = 50_000
"""Longest packet; NDI's own client rejects a longer one as invalid."""

_HEADER = struct.Struct(">II")
_COMPONENT_BYTES = 24
_MISSING = b"\xff\xff\xff\xff"
_LEAST = -3.0e28
_NO_RELIABILITY = 999.0
"""RTC3D: u32 size, type and frame, u64 microseconds, u32 item count before the items. Missing coordinates are bytes FF
on the wire and -3.697314e28 in NDI's library, whose own limit is -3.0e28; 999 is a reliability that is not known.
"""


class PacketType(IntEnum):
    """Enumerates the kinds of payload; the texts may end in a NUL, which then counts."""

    ERROR = 0
    COMMAND = 1
    XML = 2
    DATA = 3
    NO_DATA = 4
    C3D = 5
    """RTC3D, packet types."""


class ByteOrder(Enum):
    """Enumerates the byte orders of payloads. word: what SetByteOrder takes. The value is the prefix of `struct`."""

    BIG = ">"
    LITTLE = "<"

    @property
    def word(self) -> str:
        """Returns BigEndian or LittleEndian."""
        return "BigEndian" if self is ByteOrder.BIG else "LittleEndian"


class ComponentType(IntEnum):
    """Enumerates the kinds of measurement in a data packet."""

    MARKERS = 1
    ANALOG = 2
    FORCE = 3
    BODIES = 4
    EVENTS = 5
    """RTC3D, component types of a data frame."""


@dataclass(frozen=True, slots=True)
class Text:
    """Represents a command, a reply to one, an error, or the parameters as XML. terminated: whether a NUL ends it."""

    kind: PacketType
    text: str
    terminated: bool = True


@dataclass(frozen=True, slots=True)
class C3dFile:
    """Represents a recorded file; its content is not parsed."""

    content: bytes


@dataclass(frozen=True, slots=True)
class NoData:
    """Reports that the server is alive and has nothing new."""


@dataclass(frozen=True, slots=True)
class Marker:
    """Holds one marker. position_mm: (x, y, z), None for a marker that is not seen. reliability: None where the server
    gives none.
    """

    position_mm: tuple[float, float, float] | None
    reliability: float | None = None


@dataclass(frozen=True, slots=True)
class Body:
    """Holds a rigid body in the tracker's frame. quaternion: (q0, qx, qy, qz), unit. rms_mm: fit of its markers."""

    quaternion: tuple[float, float, float, float]
    translation_mm: tuple[float, float, float]
    rms_mm: float

    def __post_init__(self) -> None:
        length = math.hypot(*self.quaternion)
        if not abs(length - 1.0) <= UNIT_TOLERANCE:
            raise ProtocolError(f"a rigid body whose quaternion has length {length:.4g}")
        if not (0 <= self.rms_mm <= FURTHEST_MM and _is_near(self.translation_mm)):
            raise ProtocolError("a rigid body kilometres away, or a fit that cannot be")

    def matrix(self) -> Matrix4:
        """Returns the transform (4, 4) body → tracker, mm."""
        return pose_matrix(self.quaternion, self.translation_mm)


@dataclass(frozen=True, slots=True)
class Force:
    """Holds one force plate, in the units that the server is set to."""

    force: tuple[float, float, float]
    moment: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Event:
    """Holds one event. number: kind of event. time_us: as of a component. values: three words whose meaning depends on
    the number.
    """

    number: int
    time_us: int
    values: tuple[int, int, int]


Item = Marker | Body | Force | Event | float | None
"""One measured item. None: not measured. float: one analog channel."""


@dataclass(frozen=True, slots=True)
class Component:
    """Holds one kind of measurement of a frame. frame: u32 counter. time_us: u64 microseconds since the server
    started.
    """

    kind: ComponentType
    frame: int
    time_us: int
    items: tuple[Item, ...]


@dataclass(frozen=True, slots=True)
class DataFrame:
    """Holds the components in the order sent; no kind occurs twice."""

    components: tuple[Component, ...]

    def component(self, kind: ComponentType) -> Component | None:
        """Returns the component of that kind; None where it was not sent."""
        return next((component for component in self.components if component.kind is kind), None)


Packet = Text | DataFrame | NoData | C3dFile


def packet_length(data: bytes) -> int | None:
    """Returns the bytes of the packet that starts data; None while its header is incomplete.

    Raises ProtocolError for what cannot be a header: a stream without checksums cannot be followed from there on.
    """
    if len(data) < HEADER_BYTES:
        return None
    size, kind = _HEADER.unpack_from(data)
    if not HEADER_BYTES <= size <= MAX_PACKET_BYTES:
        raise ProtocolError(f"no RTC3D packet has {size} bytes")
    if kind not in frozenset(PacketType):
        raise ProtocolError(f"{kind} is not an RTC3D packet type")
    return int(size)


def decode_packet(data: bytes, order: ByteOrder) -> Packet:
    """Decodes exactly one packet. Raises ProtocolError for anything else, and for measurements that are impossible."""
    if packet_length(data) != len(data):
        raise ProtocolError(f"the packet's size does not fit its {len(data)} bytes")
    kind, payload = PacketType(_HEADER.unpack_from(data)[1]), data[HEADER_BYTES:]
    if kind is PacketType.DATA:
        return _decode_data(payload, order)
    if kind is PacketType.NO_DATA:
        if payload:
            raise ProtocolError("a packet without data carries data")
        return NoData()
    return C3dFile(payload) if kind is PacketType.C3D else _decode_text(kind, payload)


def encode_packet(packet: Packet, order: ByteOrder) -> bytes:
    """Returns the bytes that decode_packet reads. Raises ProtocolError for a packet longer than any reader takes."""
    match packet:
        case Text():
            kind, payload = packet.kind, packet.text.encode() + b"\0" * packet.terminated
        case DataFrame():
            kind, payload = PacketType.DATA, _encode_data(packet, order)
        case NoData():
            kind, payload = PacketType.NO_DATA, b""
        case C3dFile():
            kind, payload = PacketType.C3D, packet.content
    size = HEADER_BYTES + len(payload)
    if size > MAX_PACKET_BYTES:
        raise ProtocolError(f"a packet of {size} bytes is longer than any reader takes")
    return _HEADER.pack(size, kind) + payload


def command(text: str) -> bytes:
    """Returns a command as NDI's own client sends it."""
    return encode_packet(Text(PacketType.COMMAND, text), ByteOrder.BIG)


def _decode_text(kind: PacketType, payload: bytes) -> Text:
    text = payload.removesuffix(b"\0")
    try:
        decoded = text.decode()
    except UnicodeDecodeError:
        raise ProtocolError("a text with bytes that are not characters") from None
    if "\0" in decoded:
        raise ProtocolError("a text with a NUL inside")
    return Text(kind, decoded, len(text) < len(payload))


def _decode_data(payload: bytes, order: ByteOrder) -> DataFrame:
    if len(payload) < 4:
        raise ProtocolError("a data packet without a count of components")
    (count,) = struct.unpack_from(f"{order.value}I", payload)
    if count > len(ComponentType):
        raise ProtocolError(f"a data packet with {count} components; does order= fit the server?")
    components, at = [], 4
    for _ in range(count):
        component, at = _decode_component(payload, at, order)
        components.append(component)
    if at != len(payload):
        raise ProtocolError(f"{len(payload) - at} bytes follow the last component")
    if len({component.kind for component in components}) < count:
        raise ProtocolError("a component that comes twice")
    return DataFrame(tuple(components))


def _decode_component(payload: bytes, at: int, order: ByteOrder) -> tuple[Component, int]:
    """Returns (component, offset of what follows it)."""
    if at + _COMPONENT_BYTES > len(payload):
        raise ProtocolError("a component that breaks off in its header")
    size, kind, frame, time_us, count = struct.unpack_from(f"{order.value}IIIQI", payload, at)
    if kind not in frozenset(ComponentType):
        raise ProtocolError(f"{kind} is not a component type")
    codec = _CODECS[ComponentType(kind)]
    item_bytes = struct.calcsize(f"{order.value}{codec.layout}")
    if size != _COMPONENT_BYTES + count * item_bytes or at + size > len(payload):
        raise ProtocolError(f"a component of {size} bytes with {count} items of {item_bytes}")
    fields = struct.iter_unpack(f"{order.value}{codec.layout}", payload[at + _COMPONENT_BYTES : at + size])
    return Component(ComponentType(kind), frame, time_us, tuple(map(codec.read, fields))), at + size


def _encode_data(frame: DataFrame, order: ByteOrder) -> bytes:
    components = (_encode_component(component, order) for component in frame.components)
    return struct.pack(f"{order.value}I", len(frame.components)) + b"".join(components)


def _encode_component(component: Component, order: ByteOrder) -> bytes:
    codec = _CODECS[component.kind]
    items = b"".join(_encode_item(codec, item, order) for item in component.items)
    size = _COMPONENT_BYTES + len(items)
    head = (size, component.kind, component.frame, component.time_us, len(component.items))
    return struct.pack(f"{order.value}IIIQI", *head) + items


def _encode_item(codec: "_Codec", item: Item, order: ByteOrder) -> bytes:
    """Returns the bytes of one item. NaN is written as bytes: not every machine passes its bit pattern through a float
    unchanged.
    """
    layout = struct.Struct(f"{order.value}{codec.layout}")
    if item is None:
        return _MISSING * (layout.size // len(_MISSING))
    if isinstance(item, Marker) and item.position_mm is None:
        return _MISSING * 3 + struct.pack(f"{order.value}f", _reliability(item))
    return layout.pack(*codec.fields(item))


def _reliability(marker: Marker) -> float:
    return _NO_RELIABILITY if marker.reliability is None else marker.reliability


def _is_missing(*values: float) -> bool:
    """Returns whether any of the values marks one that was not measured; readers differ in which of them they test."""
    return any(not math.isfinite(value) or value < _LEAST for value in values)


def _is_near(place_mm: tuple[float, ...]) -> bool:
    return all(abs(value_mm) <= FURTHEST_MM for value_mm in place_mm)


def _marker(fields: tuple[float, ...]) -> Marker:
    x_mm, y_mm, z_mm, given = fields
    reliability = None if _is_missing(given) or given == _NO_RELIABILITY else given
    if _is_missing(x_mm, y_mm, z_mm):
        return Marker(None, reliability)
    if not _is_near((x_mm, y_mm, z_mm)):
        raise ProtocolError("a marker kilometres away")
    return Marker((x_mm, y_mm, z_mm), reliability)


def _body(fields: tuple[float, ...]) -> Body | None:
    if _is_missing(*fields):
        return None
    q0, qx, qy, qz, x_mm, y_mm, z_mm, rms_mm = fields
    return Body((q0, qx, qy, qz), (x_mm, y_mm, z_mm), rms_mm)


def _force(fields: tuple[float, ...]) -> Force | None:
    fx, fy, fz, mx, my, mz = fields
    return None if _is_missing(*fields) else Force((fx, fy, fz), (mx, my, mz))


def _event(fields: tuple[int, ...]) -> Event:
    number, time_us, first, second, third = fields
    return Event(number, time_us, (first, second, third))


@dataclass(frozen=True, slots=True)
class _Codec:
    """Converts the items of one kind. layout: that of one item, for `struct`, without byte order. read: its fields →
    the item. fields: the item → its fields.
    """

    layout: str
    read: Callable[..., Item]
    fields: Callable[..., tuple[float, ...]]


_CODECS = {
    ComponentType.MARKERS: _Codec("4f", _marker, lambda marker: (*marker.position_mm, _reliability(marker))),
    ComponentType.ANALOG: _Codec("f", lambda fields: None if _is_missing(*fields) else fields[0], lambda v: (v,)),
    ComponentType.FORCE: _Codec("6f", _force, lambda plate: (*plate.force, *plate.moment)),
    ComponentType.BODIES: _Codec("8f", _body, lambda body: (*body.quaternion, *body.translation_mm, body.rms_mm)),
    ComponentType.EVENTS: _Codec("IQ3I", _event, lambda event: (event.number, event.time_us, *event.values)),
}
