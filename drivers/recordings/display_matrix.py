"""Tells whether an MP4 or QuickTime film asks players to mirror its pictures (ISO/IEC 14496-12, 8.3.2, track
header).
"""

import mmap
import struct
from pathlib import Path

from probewatch.drivers.files.regular_file import reading

_BOX, _TO_MATRIX = b"tkhd", {0: 40, 1: 52}
"""Type of the box, and the number of bytes between it and its matrix, by the version of the box."""
_FIRST = (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip")
"""Types of the box with which such a film begins."""
_HEADER = b"moov"
_ONE, _LAST = 1 << 16, 1 << 30
"""1 as a number of 16.16 and of 2.30 bits."""


def is_mirrored(path: Path) -> bool:
    """Returns whether the matrix of any track mirrors: FFmpeg's decoders give the pictures as they are stored, and
    OpenCV turns them by 180° instead where they are mirrored from left to right.
    """
    with reading(path) as stream:
        if stream.read(8)[4:] not in _FIRST:
            return False
        content = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    with content:
        return any(_mirrored_between(content, start, end) for start, end in _headers(content))


def _headers(content: mmap.mmap) -> list[tuple[int, int]]:
    """Returns where the headers of the film begin and end, found from box to box, so that the pictures are not read. A
    damaged film, in which that leads nowhere, is searched as a whole.
    """
    found, at = list[tuple[int, int]](), 0
    while at + 16 <= len(content):
        size, kind, long_size = struct.unpack_from(">I4sQ", content, at)
        size = {0: len(content) - at, 1: long_size}.get(size, size)
        if size < 8:
            break
        if kind == _HEADER:
            found.append((at, at + size))
        at += size
    return found or [(0, len(content))]


def _mirrored_between(content: mmap.mmap, start: int, end: int) -> bool:
    at = content.find(_BOX, start, end)
    while at >= 0:
        if _mirrors(content, at + len(_BOX)):
            return True
        at = content.find(_BOX, at + 1, end)
    return False


def _mirrors(content: mmap.mmap, start: int) -> bool:
    """Returns whether the display matrix of the track header there mirrors; False where it is not a track header, as
    among the pictures.
    """
    to_matrix = _TO_MATRIX.get(content[start]) if start < len(content) else None
    if to_matrix is None or start + to_matrix + 36 > len(content):
        return False
    a, b, u, c, d, v, _, _, w = struct.unpack_from(">9i", content, start + to_matrix)
    is_matrix = (u, v, w) == (0, 0, _LAST) and max(map(abs, (a, b, c, d))) <= 2 * _ONE
    return is_matrix and a * d - b * c < 0
