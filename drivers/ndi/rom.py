"""Tool definition files (.rom): the 752 bytes that tell a tracker where a passive tool's markers sit.

Layout: `NDI\\0`, u16 sum of all bytes from offset 6 modulo 65536, subtype at 12, main type at 15 (01 reference,
02 probe), markers as f32 x y z from 0x48, manufacturer at 0x244, part number at 0x250; little-endian.
"""

import struct
from collections.abc import Iterator
from pathlib import Path

from drivers.errors import ConfigurationError

ROM_BYTES = 752
CHUNK_BYTES = 64
_LARGEST = 1024
_REMEDY = "Name the .rom file that came with the tool"


def read_rom(path: str) -> bytes:
    """The checked image of one tool. Raises ConfigurationError when the file is absent or damaged."""
    try:
        image = Path(path).read_bytes()
    except OSError as error:
        raise ConfigurationError(f"the tool definition cannot be read ({error.strerror})", path, _REMEDY) from error
    if not image.startswith(b"NDI\0") or not ROM_BYTES <= len(image) <= _LARGEST:
        raise ConfigurationError("this is not an NDI tool definition file", path, _REMEDY)
    if rom_sum(image[:ROM_BYTES]) != struct.unpack_from("<H", image, 4)[0]:
        raise ConfigurationError("the tool definition file is damaged (its check sum is wrong)", path, _REMEDY)
    return image[:ROM_BYTES]


def rom_sum(image: bytes) -> int:
    """What belongs at offset 4."""
    return sum(image[6:]) & 0xFFFF


def rom_chunks(image: bytes) -> Iterator[tuple[int, bytes]]:
    """(address, 64 bytes) for PVWR; the last chunk is padded with zeros."""
    for address in range(0, len(image), CHUNK_BYTES):
        yield address, image[address : address + CHUNK_BYTES].ljust(CHUNK_BYTES, b"\0")
