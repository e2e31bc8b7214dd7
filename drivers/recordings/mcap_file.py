"""Writes MCAP files of JSON messages, in chunks that can be ended at any time, and reads them up to wherever they were
cut.

Format: https://mcap.dev/spec. Each chunk is compressed by zstd and has a CRC-32 of its own; a whole file has two more,
of its data and of its summary. What is in a chunk is on the disk once `flush` has returned and the file was synced.
"""

import json
import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import zstandard
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Message
from mcap.stream_reader import CRCValidationError, StreamReader, get_chunk_data_stream
from mcap.writer import CompressionType, IndexType, Writer

from probewatch.drivers.errors import RecordingError
from probewatch.drivers.files.regular_file import reading

MAGIC = b"\x89MCAP0\r\n"

_CHUNK_BYTES = 1 << 24
"""Bytes after which a chunk ends by itself: a second of pictures of 640 × 480 takes half. More takes memory of the
program that reads it, less compresses worse."""
_MOST_CHUNK_BYTES = 1 << 26
"""Bytes of memory that one chunk of a file may ask for: one picture beyond a full chunk. A damaged or hostile length
asks for any amount."""
_MOST_RECORDS = 100_000
"""Records in a chunk, which has a second at most, or 16 MB: more than as many poses of the shortest text. An empty
message has 31 bytes, so that two million, which take .6 GB of memory, fit into a chunk of some kB."""
_MOST_MEMBERS = 100_000
"""Members of one message, counted by its commas: a status has some 500. A list or an object takes ten times the memory
of its text."""
_MOST_TOPIC = 200
"""Characters of a topic that are kept, of up to 65,536 topics; ours have nine at most."""
_MOST_DAMAGE = 1000
"""Damages that are reported one by one; then the rest of the file is not read. A cut or a bad block of a disk is one or
two."""
_FOOTER = struct.Struct("<BQQQI8s")
"""Opcode, length, two offsets, CRC-32 of the summary with all of the footer before it, magic; section "Footer"."""
_CHANNEL = struct.Struct("<HHI")
"""Number, that of its schema, length of its topic; section "Channel"."""
_BROKEN = (McapError, struct.error, UnicodeDecodeError, ValueError, KeyError, zstandard.ZstdError, MemoryError)
"""Exceptions that the library raises where bytes are not what they should be."""


class Entry(NamedTuple):
    """Represents one message. t_ns: its log time. fields: those of its JSON object."""

    topic: str
    t_ns: int
    fields: dict[str, Any]


class McapWriter:
    """Writes messages to a stream. schemas: topic → JSON schema of its messages, with a title. Each call raises OSError
    as the stream does.
    """

    def __init__(self, stream: BinaryIO, schemas: Mapping[str, Mapping[str, Any]], library: str) -> None:
        self._writer = Writer(
            stream,
            chunk_size=_CHUNK_BYTES,
            compression=CompressionType.ZSTD,
            index_types=IndexType.ALL,
            enable_data_crcs=True,
        )
        self._writer.start(profile="", library=library)
        self._channels = {topic: self._channel(topic, schema) for topic, schema in schemas.items()}

    def put(self, topic: str, t_ns: int, fields: Mapping[str, Any]) -> None:
        """Writes a message. t_ns: >= 0. Raises ValueError for a number that JSON cannot hold."""
        data = json.dumps(fields, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
        self._writer.add_message(self._channels[topic], t_ns, data.encode(errors="replace"), t_ns)

    def flush(self) -> None:
        """Ends the chunk, if anything is in it, and hands it to the kernel."""
        self._writer.flush()  # type: ignore[no-untyped-call]

    def finish(self) -> None:
        """Writes what makes a whole file: indexes and checksums. The stream stays open."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _channel(self, topic: str, schema: Mapping[str, Any]) -> int:
        named = self._writer.register_schema(str(schema["title"]), "jsonschema", json.dumps(schema).encode())
        return self._writer.register_channel(topic, "json", named)


class McapReader:
    """Reads the messages of a file in the order in which they were written. Raises RecordingError where it is not MCAP.

    damage: what was found wrong so far, in words, with the byte; complete once `entries` has ended, which it does early
    where nearly everything is damaged.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._channels: dict[int, str] = {}
        self.damage: list[str] = []
        try:
            with reading(path) as stream:
                head = stream.read(len(MAGIC))
        except OSError as error:
            remedy = "Check the name and the permissions"
            raise RecordingError(f"cannot be read: {error.strerror}", str(path), remedy) from error
        if head != MAGIC:
            raise RecordingError("is not an MCAP file", str(path), "Give a file that probewatch record has written")

    def entries(self) -> Iterator[Entry]:
        """Yields everything that can be read: a chunk whose checksum does not fit is left out, a file that was cut ends
        early, and `damage` reports it. Raises RecordingError where the disk fails.
        """
        self._channels.clear()
        self.damage.clear()
        try:
            with reading(self._path) as stream:
                yield from self._read(stream)
        except OSError as error:
            remedy = "Check the disk, or copy the file again"
            raise RecordingError(f"cannot be read: {error.strerror}", str(self._path), remedy) from error

    def _read(self, stream: BinaryIO) -> Iterator[Entry]:
        records = StreamReader(
            stream, emit_chunks=True, validate_crcs=True, record_size_limit=_MOST_CHUNK_BYTES
        ).records
        whole = 0
        while True:
            try:
                record = next(records)
            except (EndOfFile, StopIteration):
                self._cut(whole, "it was cut there")
                return
            except CRCValidationError:
                self.damage.append(
                    "the checksum of all its data does not fit: some byte outside the chunks was changed"
                )
                return
            except _BROKEN as error:
                self._cut(whole, f"what follows is damaged or was cut ({type(error).__name__})")
                return
            if isinstance(record, DataEnd):
                self._check_summary(stream)
                return
            if isinstance(record, Chunk):
                yield from self._chunk(record, whole)
            elif isinstance(record, Channel | Message):
                yield from self._taken(record)
            whole = stream.tell()
            if len(self.damage) >= _MOST_DAMAGE:
                self._cut(whole, "so much before it is damaged that the rest is not read")
                return

    def _cut(self, whole: int, how: str) -> None:
        self.damage.append(f"ends at byte {whole}: {how}")

    def _chunk(self, chunk: Chunk, start: int) -> Iterator[Entry]:
        try:
            records = _records(chunk)
        except (*_BROKEN, CRCValidationError):
            span_s = max(chunk.message_end_time - chunk.message_start_time, 0) / 1e9
            self.damage.append(f"the part at byte {start} is damaged: {span_s:.1f} s are left out")
            return
        for record in records:
            yield from self._taken(record)

    def _taken(self, record: object) -> Iterator[Entry]:
        if isinstance(record, Channel | _Named):
            self._channels[record.id] = record.topic[:_MOST_TOPIC]
        elif isinstance(record, Message) and len(self.damage) < _MOST_DAMAGE:
            try:
                fields = json.loads(record.data) if record.data.count(b",") < _MOST_MEMBERS else None
            except (ValueError, RecursionError):
                fields = None
            if isinstance(fields, dict):
                yield Entry(self._channels.get(record.channel_id, ""), record.log_time, fields)
            else:
                self.damage.append(f"a message of {self._channels.get(record.channel_id, '?')} is not a JSON object")

    def _check_summary(self, stream: BinaryIO) -> None:
        """Checks the summary for the sake of other programs; this one does not read it."""
        rest = stream.read(_MOST_CHUNK_BYTES)
        footer = rest[-_FOOTER.size :]
        if len(footer) < _FOOTER.size:
            self.damage.append("its end was cut; all messages are there")
            return
        opcode, _, _, _, crc, magic = _FOOTER.unpack(footer)
        covered = rest[: -len(MAGIC) - 4]
        if (opcode, magic) != (Opcode.FOOTER, MAGIC) or zlib.crc32(covered) != crc:
            self.damage.append("its index is damaged or cut; all messages are there")


class _Named(NamedTuple):
    """Represents a channel without its metadata."""

    id: int
    topic: str


def _named(data: bytes) -> _Named:
    number, _, size = _CHANNEL.unpack_from(data)
    return _Named(number, data[_CHANNEL.size : _CHANNEL.size + min(size, _MOST_TOPIC)].decode())


def _records(chunk: Chunk) -> list[_Named | Message]:
    """Returns the records of a chunk. Raises what _BROKEN names, and CRCValidationError."""
    _refuse_bomb(chunk)
    stream, length = get_chunk_data_stream(chunk, validate_crc=True)
    found: list[_Named | Message] = []
    for _ in range(_MOST_RECORDS):
        if stream.count >= length:
            return found
        opcode, size = stream.read1(), stream.read8()
        if opcode == Opcode.CHANNEL:
            found.append(_named(stream.read(size)))
        elif opcode == Opcode.MESSAGE:
            found.append(Message.read(stream, size))
        else:
            stream.read(size)
    raise ValueError("more than a chunk may hold")


def _refuse_bomb(chunk: Chunk) -> None:
    """Raises ValueError for a chunk that would unpack to more than any that was written here."""
    sizes = [chunk.uncompressed_size]
    if chunk.compression == "zstd":
        sizes.append(zstandard.frame_content_size(chunk.data))
    if not all(0 <= size <= _MOST_CHUNK_BYTES for size in sizes) or chunk.compression not in ("", "zstd"):
        raise ValueError("more than a chunk may hold")
