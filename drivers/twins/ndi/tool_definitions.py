"""Makes generic tool definitions for the simulated trackers."""

import struct

from probewatch.drivers.trackers.ndi.rom import ROM_BYTES, rom_sum

REFERENCE, PROBE = 0x01, 0x02
"""Combined API: main types of tools."""

MARKERS_MM = ((0.0, 0.0, 0.0), (46.5, 28.3, 0.0), (38.2, -33.9, 0.0), (98.0, -4.6, 0.0))
"""Markers of a made-up body of common size; its six distances are 51 to 98 mm, and differ by 1.6 mm and more."""


_SECOND = 1.4
"""Size of a second body on a probe, relative to the first: its six distances differ from those of the first by 4.8 mm
and more, so that a tracker distinguishes the two."""


def make_rom(main_type: int = PROBE, markers: bool = True, second: bool = False) -> bytes:
    """Returns the 752 bytes of a tool. main_type: REFERENCE or PROBE. markers: whether it has four of them, or none as
    an Aurora sensor. second: whether it is a body of its own size, to sit on a probe beside another.
    """
    image = bytearray(ROM_BYTES)
    image[:4] = b"NDI\0"
    image[12], image[15] = 0x01, main_type
    placed = MARKERS_MM if markers else ()
    struct.pack_into("<IIIIf", image, 20, 0x00C0FFEE, 90, len(placed), 3 if placed else 0, 0.5)
    for i, marker in enumerate(placed):
        struct.pack_into("<3f", image, 0x48 + 12 * i, *((_SECOND if second else 1.0) * part for part in marker))
        struct.pack_into("<3f", image, 0x138 + 12 * i, 0.0, 0.0, 1.0)
    image[0x244 : 0x244 + 12] = b"PROBEWATCH".ljust(12)
    image[0x250 : 0x250 + 20] = f"{'SECOND' if second else 'GENERIC'}-{main_type:02d}".encode().ljust(20)
    struct.pack_into("<H", image, 4, rom_sum(bytes(image)))
    return bytes(image)
