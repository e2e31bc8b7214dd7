"""Reads pictures one after the other out of a file, stored raw or as one zlib stream."""

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from probewatch.drivers.errors import RecordingError

BLOCK_BYTES = 262_144
"""Bytes copied or unpacked at a time: a little less than a picture of 640 × 480. More takes memory, less takes calls.
Not measured."""
_WRONG_HEADER = "incorrect header check"
"""Text of zlib's error for data that are not in its format."""
_OTHERS = {b"\x1f": "gzip", b"\x78": "zlib"}
"""First byte of compressed data → what has compressed them."""


def raw(stream: BinaryIO, path: Path, count: int, frame_bytes: int) -> Iterator[bytes]:
    """Yields frames that are stored raw."""
    for index in range(count):
        block = stream.read(frame_bytes)
        if len(block) < frame_bytes:
            raise RecordingError(f"picture {index} of {count} is cut short", str(path), "Copy the file again")
        yield block


def inflated(
    inflator: "zlib._Decompress", stream: BinaryIO, path: Path, count: int, frame_bytes: int
) -> Iterator[bytes]:
    """Yields frames out of one zlib stream; the last read goes past the pictures, so that zlib verifies its
    checksum.
    """
    for index in range(count):
        block = _inflate(inflator, stream, path, frame_bytes)
        if len(block) < frame_bytes:
            raise RecordingError(f"picture {index} of {count} is cut short", str(path), "Copy the file again")
        yield block
    if _inflate(inflator, stream, path, 1) or not inflator.eof:
        what = f"holds more or less picture data than the {count} frames of its header"
        raise RecordingError(what, str(path), "Copy the file again")


def _inflate(inflator: "zlib._Decompress", stream: BinaryIO, path: Path, wanted: int) -> bytes:
    """Inflates up to `wanted` bytes; fewer only at the end of the stream or of the file."""
    parts, missing = [], wanted
    try:
        while missing and not inflator.eof:
            source = inflator.unconsumed_tail or stream.read(BLOCK_BYTES)
            part = inflator.decompress(source, missing)
            parts.append(part)
            missing -= len(part)
            if not source and not part:
                break
    except zlib.error as error:
        other = _OTHERS.get(source[:1], "") if _WRONG_HEADER in str(error) else ""
        if other:
            what = f"the pictures are compressed by {other}, not as the header says"
            right = "gzip" if other == "zlib" else "zlib"
            raise RecordingError(what, str(path), f"Compress them by {right}, or store them raw") from None
        raise RecordingError("the compressed pictures are damaged", str(path), "Copy the file again") from None
    return b"".join(parts)
