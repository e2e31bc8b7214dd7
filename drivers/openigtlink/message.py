"""Encodes and decodes one OpenIGTLink message: header, extended header, content, metadata and checksum, of header
versions 1 to 3.

All numbers are big-endian. Header, 58 bytes: version u16, type 12 characters, device name 20 characters (both padded
with NUL), time as seconds u32 and 2⁻³² s u32 since 1970 UTC, bytes of the body u64, CRC-64 of the body u64. From
version 2 on the body begins with an extended header (its size u16, bytes of the metadata header u16, bytes of the
metadata u32, number of the message u32) and ends with the metadata: a count u16, for each entry the bytes of its key
u16, the encoding of its value u16 and the bytes of its value u32, then all keys and values. Source: the protocol's
published specification and vectors made with its reference library, tests/data/openigtlink-vectors.json.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from fastcrc import crc64

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.printable import printable

HEADER_BYTES = 58
"""Length of every message's header, by the specification."""

VERSIONS = (1, 2, 3)
"""Versions of the header. 3 has the layout of 2, which states its own sizes."""

MOST_BODY_BYTES = 1 << 26
"""Largest body of one message, 64 MiB: a picture of 4096 × 4096 in four channels. A longer body means a damaged or
hostile header, which would make us wait for it.
"""

US_ASCII, UTF_8 = 3, 106
"""Encodings by their numbers at IANA (MIBenum)."""

_HEADER = struct.Struct(">H12s20sIIQQ")
_EXTENDED = struct.Struct(">HHII")
_ENTRY = struct.Struct(">HHI")
_COUNT = struct.Struct(">H")
_FRACTION_BITS = 32
"""Bits of the fraction of the time: its second word counts 2⁻³² s."""

Entry = tuple[str, int, str]
"""Key, encoding of the value as IANA numbers it, value."""


@dataclass(frozen=True, slots=True)
class Header:
    """Represents what precedes a body. time: in units of 2⁻³² s since 1970 UTC; 0 where the sender sends none."""

    version: int
    kind: str
    device: str
    time: int
    body_bytes: int
    crc: int

    @property
    def time_ns(self) -> int:
        """Returns nanoseconds since 1970 UTC, by the sender's clock."""
        return self.time * 1_000_000_000 >> _FRACTION_BITS


@dataclass(frozen=True, slots=True)
class Message:
    """Represents one message. kind: TRANSFORM, IMAGE … device: whose data it is, at most 20 bytes. content: without
    extended header and metadata. time: see Header. number, metadata: those of version 2 and later.
    """

    kind: str
    device: str
    content: bytes
    time: int = 0
    version: int = 1
    number: int = 0
    metadata: tuple[Entry, ...] = ()

    @property
    def time_ns(self) -> int:
        """Returns nanoseconds since 1970 UTC, by the sender's clock; 0 where it sends none."""
        return self.time * 1_000_000_000 >> _FRACTION_BITS

    def said(self, key: str) -> str:
        """Returns a value of the metadata; empty where there is none."""
        return next((value for name, _, value in self.metadata if name == key), "")


def time_of(utc_ns: int) -> int:
    """Converts nanoseconds since 1970 UTC to units of 2⁻³² s, rounded up, so that time_ns gives the same back."""
    return -((-utc_ns << _FRACTION_BITS) // 1_000_000_000)


def parse_header(data: bytes, where: str = "") -> Header:
    """Parses exactly HEADER_BYTES bytes. Raises ProtocolError for a version or a size that cannot be handled."""
    version, kind, device, seconds, fraction, body_bytes, crc = _HEADER.unpack(data)
    if version not in VERSIONS:
        raise ProtocolError(f"header version {version} is not known", where, _OTHER_END)
    if body_bytes > MOST_BODY_BYTES:
        raise ProtocolError(f"a message announces {body_bytes} bytes", where, _OTHER_END)
    return Header(version, _text(kind), _text(device), seconds << _FRACTION_BITS | fraction, body_bytes, crc)


class CheckSumError(ProtocolError):
    """Reports that the body is not the one that was sent, or that its sender computes the checksum differently."""


_OTHER_END = "Check that an OpenIGTLink server listens there"


def decode_body(header: Header, body: bytes, where: str = "") -> Message:
    """Decodes a body. Raises ProtocolError for one that is damaged or contradicts itself."""
    named = f"{header.kind} '{header.device}'"
    if len(body) != header.body_bytes:
        raise ProtocolError(f"{named} has {len(body)} of {header.body_bytes} bytes", where)
    if crc64.ecma_182(body) != header.crc:
        raise CheckSumError(f"{named} is damaged (its check sum does not fit)", where)
    if header.version == 1:
        return Message(header.kind, header.device, body, header.time)
    try:
        return _extended(header, body)
    except (ValueError, struct.error) as error:
        raise ProtocolError(f"{named} contradicts itself ({error})", where) from None


def encode(message: Message) -> bytes:
    """Returns the bytes that decode_body reads. Raises ValueError for names that are too long."""
    body = message.content if message.version == 1 else _extended_body(message)
    kind, device = (_field(name, size) for name, size in ((message.kind, 12), (message.device, 20)))
    seconds, fraction = divmod(message.time, 1 << _FRACTION_BITS)
    crc = crc64.ecma_182(body)
    return _HEADER.pack(message.version, kind, device, seconds, fraction, len(body), crc) + body


def fixed(text: str, size: int) -> bytes:
    """Returns a name padded with NUL to `size` bytes. What does not fit is cut off."""
    return _bytes(text)[:size].ljust(size, b"\0")


def name_of(data: bytes) -> str:
    """Returns a name up to its first NUL, as it was sent; it is made printable only where it is shown."""
    return _text(data)


def _extended(header: Header, body: bytes) -> Message:
    size, table_bytes, metadata_bytes, number = _EXTENDED.unpack_from(body)
    end = len(body) - table_bytes - metadata_bytes
    if size < _EXTENDED.size or end < size:
        raise ValueError(f"{len(body)} bytes do not hold the parts that it announces")
    metadata = tuple(_entries(body[end : end + table_bytes], body[end + table_bytes :]))
    return Message(header.kind, header.device, body[size:end], header.time, header.version, number, metadata)


def _entries(table: bytes, data: bytes) -> Iterator[Entry]:
    """Yields the entries of the metadata. table: count and sizes. data: keys and values, which must fill it."""
    (count,) = _COUNT.unpack_from(table) if table else (0,)
    if len(table) not in (0, _COUNT.size + count * _ENTRY.size):
        raise ValueError(f"{len(table)} bytes cannot announce {count} entries of metadata")
    place = 0
    for key_bytes, encoding, value_bytes in _ENTRY.iter_unpack(table[_COUNT.size :]):
        key, value = data[place : place + key_bytes], data[place + key_bytes : place + key_bytes + value_bytes]
        place += key_bytes + value_bytes
        yield _decoded(key), encoding, _decoded(value)
    if place != len(data):
        raise ValueError(f"its metadata have {len(data)} bytes, not {place}")


def _extended_body(message: Message) -> bytes:
    entries = [(_bytes(key), encoding, _bytes(value)) for key, encoding, value in message.metadata]
    table = _COUNT.pack(len(entries)) + b"".join(_ENTRY.pack(len(k), code, len(v)) for k, code, v in entries)
    data = b"".join(key + value for key, _, value in entries)
    return _EXTENDED.pack(_EXTENDED.size, len(table), len(data), message.number) + message.content + table + data


def _field(text: str, size: int) -> bytes:
    data = _bytes(text)
    if len(data) > size:
        raise ValueError(f"'{printable(text)}' has more than {size} bytes")
    return data


def _text(data: bytes) -> str:
    return _decoded(data.partition(b"\0")[0])


def _decoded(data: bytes) -> str:
    """Decodes UTF-8, of which ASCII is a part; any other byte survives, so that what is forwarded is what came."""
    return data.decode(errors="surrogateescape")


def _bytes(text: str) -> bytes:
    return text.encode(errors="surrogateescape")
