"""Reads tool definition files (.rom): the 752 bytes that define for a tracker where a passive tool's markers are.

Layout: `NDI\\0`, u16 sum of all bytes from offset 6 modulo 65536, subtype at 12, main type at 15 (01 reference,
02 probe), markers as f32 x y z from 0x48, manufacturer at 0x244, part number at 0x250; little-endian.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.regular_file import read_bounded
from probewatch.drivers.printable import printable_bytes
from probewatch.drivers.trackers.marker_geometry import Points
from probewatch.drivers.trackers.ndi.replies import MOST_MARKERS

ROM_BYTES = 752
CHUNK_BYTES = 64
_LARGEST = 1024
"""Combined API: size of a definition (all public ones have it), bytes of one PVWR, and the sixteen PVWR that other
clients fill up to with zeros; a longer file is another kind of file.
"""

_REMEDY = "Name the .rom file that came with the tool"


@dataclass(frozen=True, slots=True, eq=False)
class ToolDefinition:
    """Holds the definition of one tool. image: its 752 bytes. main_type: 1 reference, 2 probe, 3 button box.
    markers_mm: (n, 3) on the body.
    """

    image: bytes
    main_type: int
    markers_mm: Points
    part_number: str


def definition_of(image: bytes) -> ToolDefinition:
    """Parses an image of at least 752 bytes, whether its checksum is right or not."""
    count = min(struct.unpack_from("<I", image, 28)[0], MOST_MARKERS)
    markers_mm = np.array(struct.unpack_from(f"<{3 * count}f", image, 0x48), np.float64).reshape(count, 3)
    part_number = printable_bytes(image[0x250:0x264])
    return ToolDefinition(image, image[15], markers_mm, part_number)


def read_rom(path: str) -> ToolDefinition:
    """Reads and checks the definition of one tool. Raises ConfigurationError when the file is absent or damaged."""
    try:
        image = read_bounded(Path(path), _LARGEST)
    except OSError as error:
        raise ConfigurationError(f"the tool definition cannot be read ({error.strerror})", path, _REMEDY) from error
    if not image.startswith(b"NDI\0") or not ROM_BYTES <= len(image) <= _LARGEST:
        raise ConfigurationError("this is not an NDI tool definition file", path, _REMEDY)
    if rom_sum(image[:ROM_BYTES]) != struct.unpack_from("<H", image, 4)[0]:
        raise ConfigurationError("the tool definition file is damaged (its check sum is wrong)", path, _REMEDY)
    return definition_of(image[:ROM_BYTES])


def rom_sum(image: bytes) -> int:
    """Returns the checksum that belongs at offset 4."""
    return sum(image[6:]) & 0xFFFF


def rom_chunks(image: bytes) -> Iterator[tuple[int, bytes]]:
    """Yields (address, 64 bytes) for PVWR; the last chunk is padded with zeros."""
    for address in range(0, len(image), CHUNK_BYTES):
        yield address, image[address : address + CHUNK_BYTES].ljust(CHUNK_BYTES, b"\0")
