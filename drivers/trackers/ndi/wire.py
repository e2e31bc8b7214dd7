"""Implements the bytes of the NDI Combined API: CRC-16, command framing, text replies, binary containers.

A command is `NAME:` arguments CRC CR, or `NAME ` arguments CR without CRC; the separator decides which. A text reply is
DATA CRC CR. A binary reply is a container: start word A5C4, u16 length, u16 header CRC, body, u16 body CRC; or start
word A5C8, u32 length, body, without any CRC. Everything here is pure; every function raises ProtocolError only.
"""

import re
import struct
from dataclasses import dataclass
from functools import cache
from typing import Any

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.trackers.ndi.status_text import error_text

CR = b"\r"
PLAIN_START = b"\xc4\xa5"
EXTENDED_START = b"\xc8\xa5"
STREAM_START = b"\xd4\xb5"

MAX_TEXT_BYTES = 8192
"""Bytes without CR above which they are noise and no text: TX with details of fifteen tools of twenty markers fits, and
nothing longer is requested. More waits longer on a line that carries noise.
"""

MAX_EXTENDED_BYTES = 1 << 24
"""Length in the long container above which it is damage: the container has no checksum, and poses with markers take
some kilobytes. More would wait, and hold memory, for what never comes.
"""

_COMMAND = re.compile(rb"([A-Z0-9]{2,8})([: ])([^\r]*)\r", re.DOTALL)
_START_BYTES = (b"", PLAIN_START[:1], EXTENDED_START[:1])
_NO_TEXT = re.compile(rb"[^\t\n\x20-\x7e]")
_CRC_TEXT = re.compile(rb"[0-9A-F]{4}")
_ERROR = re.compile(r"ERROR([0-9A-F]{2})")


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        register = byte
        for _ in range(8):
            register = (register >> 1) ^ (0xA001 if register & 1 else 0)
        table.append(register)
    return tuple(table)


_TABLE = _crc_table()


def crc16(data: bytes) -> int:
    """Computes CRC-16/ARC (x¹⁶+x¹⁵+x²+1, reflected, from 0); crc16(b"123456789") is 0xBB3D."""
    register = 0
    for byte in data:
        register = (register >> 8) ^ _TABLE[(register ^ byte) & 0xFF]
    return register


class RefusedError(ProtocolError):
    """Reports that the device answered ERRORxx. code: the two hexadecimal digits as a number."""

    def __init__(self, code: int, where: str = "") -> None:
        super().__init__(f"the tracker answered ERROR{code:02X} ({error_text(code)})", where)
        self.code = code


@dataclass(frozen=True, slots=True)
class Command:
    """Represents a request of the host. checked: whether it is sent with its CRC."""

    name: str
    arguments: str = ""
    checked: bool = True


def encode_command(command: Command) -> bytes:
    """Returns the bytes of a request, CR included."""
    separator = ":" if command.checked else " "
    body = f"{command.name}{separator}{command.arguments}".encode("latin-1")
    return body + (_crc_digits(body) if command.checked else b"") + CR


def decode_command(line: bytes) -> Command:
    """Decodes one request with its CR. Raises ProtocolError for bad framing or CRC."""
    match = _COMMAND.fullmatch(line)
    if match is None:
        raise ProtocolError(f"not a command of the Combined API: {_shown(line)}")
    name, separator, rest = match[1].decode(), match[2], match[3]
    if separator == b":":
        rest = _without_crc(line[:-1], "command")[len(name) + 1 :]
    return Command(name, rest.decode("latin-1"), separator == b":")


def encode_text(text: str) -> bytes:
    """Returns the bytes of a text reply, CRC and CR included."""
    body = text.encode("latin-1")
    return body + _crc_digits(body) + CR


def decode_text(reply: bytes) -> str:
    """Returns the text of one whole reply. Raises RefusedError for ERRORxx, ProtocolError for bad framing or CRC."""
    if reply.count(CR) != 1 or not reply.endswith(CR):
        raise ProtocolError(f"not one whole text reply: {_shown(reply)}")
    text = _without_crc(reply[:-1], "text reply").decode("latin-1")
    if refusal := _ERROR.fullmatch(text):
        raise RefusedError(int(refusal[1], 16))
    return text


def encode_container(body: bytes, extended: bool = False) -> bytes:
    """Wraps the body of a binary reply; `extended` gives the A5C8 form."""
    if extended:
        return EXTENDED_START + struct.pack("<I", len(body)) + body
    header = PLAIN_START + struct.pack("<H", len(body))
    return header + struct.pack("<H", crc16(header)) + body + struct.pack("<H", crc16(body))


def open_container(reply: bytes) -> bytes:
    """Returns the body of one whole binary reply.

    Raises RefusedError when the device answered ERRORxx in place of binary data, ProtocolError for any other text, a
    wrong length, or a wrong CRC of header or body.
    """
    if not reply.startswith((PLAIN_START, EXTENDED_START)):
        raise ProtocolError(f"text in place of binary data: {decode_text(reply)[:40]!r}")
    if reply_length(reply) != len(reply):
        raise ProtocolError(f"binary reply of {len(reply)} bytes is not as long as its header says")
    if reply.startswith(EXTENDED_START):
        return reply[6:]
    body, (stated,) = reply[6:-2], struct.unpack("<H", reply[-2:])
    if crc16(body) != stated:
        raise ProtocolError(f"CRC of the binary body is {crc16(body):04X}, stated {stated:04X}")
    return body


def reply_length(received: bytes) -> int | None:
    """Returns the length in bytes of the reply that starts `received`; None while too few bytes have come to know it.

    Raises ProtocolError as soon as the bytes cannot be the start of a reply.
    """
    if received.startswith(PLAIN_START):
        return _plain_length(received)
    if received.startswith(EXTENDED_START):
        return _extended_length(received)
    if received in _START_BYTES:
        return None
    end = received.find(CR)
    text = received if end < 0 else received[:end]
    if _NO_TEXT.search(text) or len(text) > MAX_TEXT_BYTES:
        raise ProtocolError(f"neither text nor binary data: {_shown(received)}")
    return end + 1 if end >= 0 else None


def encode_stream(identity: str, reply: bytes) -> bytes:
    """Returns a packet of the STREAM command: its header before an ordinary reply."""
    name = identity.encode("latin-1")
    header = STREAM_START + struct.pack("<H", len(name)) + name
    return header + struct.pack("<H", crc16(header)) + reply


def decode_stream(packet: bytes) -> tuple[str, bytes]:
    """Returns (stream identity, the ordinary reply after it). Raises ProtocolError."""
    if not packet.startswith(STREAM_START) or len(packet) < 4:
        raise ProtocolError(f"not a stream packet: {_shown(packet)}")
    end = 4 + struct.unpack_from("<H", packet, 2)[0]
    if len(packet) < end + 2 or struct.unpack_from("<H", packet, end)[0] != crc16(packet[:end]):
        raise ProtocolError("stream packet with a truncated or damaged header")
    return packet[4:end].decode("latin-1"), packet[end + 2 :]


@cache
def _layout(layout: str) -> struct.Struct:
    return struct.Struct("<" + layout)


class Cursor:
    """Reads a body from front to back and refuses to pass its end. where: the reply's name, for messages."""

    def __init__(self, data: bytes, where: str) -> None:
        self._data, self._at, self._where = data, 0, where

    def take(self, count: int) -> bytes:
        """Returns the next `count` bytes. Raises ProtocolError at the end."""
        if count < 0 or count > self.left:
            raise ProtocolError(f"ends {count - self.left} bytes too early", self._where)
        self._at += count
        return self._data[self._at - count : self._at]

    def unpack(self, layout: str) -> tuple[Any, ...]:
        """Returns little-endian fields. layout: as in the struct module. Raises ProtocolError at the end."""
        compiled = _layout(layout)
        at, self._at = self._at, self._at + compiled.size
        if self._at > len(self._data):
            raise ProtocolError(f"ends {self._at - len(self._data)} bytes too early", self._where)
        return compiled.unpack_from(self._data, at)

    def number(self, layout: str) -> int:
        """Returns one little-endian integer."""
        return int(self.unpack(layout)[0])

    def starts_with(self, prefix: bytes) -> bool:
        """Returns whether the bytes ahead begin with the prefix."""
        return self._data.startswith(prefix, self._at)

    @property
    def left(self) -> int:
        """Returns the number of bytes not yet read."""
        return len(self._data) - self._at

    def finish(self) -> None:
        """Raises ProtocolError unless everything was read."""
        if self.left:
            raise ProtocolError(f"{self.left} bytes too many", self._where)

    def refuse(self, what: str) -> ProtocolError:
        """Returns the error to raise for what was read at the cursor."""
        return ProtocolError(what, self._where)


def _plain_length(received: bytes) -> int | None:
    if len(received) < 6:
        return None
    length, stated = struct.unpack_from("<HH", received, 2)
    if crc16(received[:4]) != stated:
        raise ProtocolError(f"CRC of the binary header is {crc16(received[:4]):04X}, stated {stated:04X}")
    return int(length) + 8


def _extended_length(received: bytes) -> int | None:
    if len(received) < 6:
        return None
    length = int(struct.unpack_from("<I", received, 2)[0])
    if length > MAX_EXTENDED_BYTES:
        raise ProtocolError(f"extended reply claims {length} bytes")
    return length + 6


def _crc_digits(body: bytes) -> bytes:
    return b"%04X" % crc16(body)


def _without_crc(line: bytes, kind: str) -> bytes:
    body, digits = line[:-4], line[-4:]
    if not _CRC_TEXT.fullmatch(digits) or int(digits, 16) != crc16(body):
        raise ProtocolError(f"CRC of the {kind} {_shown(line)} is wrong")
    return body


def _shown(data: bytes) -> str:
    return repr(data[:40])[1:] + ("…" if len(data) > 40 else "")
