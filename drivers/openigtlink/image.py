"""Parses IMAGE, a picture or volume with its pixel type, and makes the grey picture on which the line works.

Content: version u16, components u8, scalar type u8, byte order u8, coordinates u8, size 3 × u16, matrix 12 × f32, then
offset and size of the part that is sent, 3 × u16 each, all big-endian; then the pixels, columns fastest, components
together, in the byte order that it names. Source: as for drivers.openigtlink.message.
"""

import struct
from dataclasses import dataclass

import numpy as np

from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.samples import GreyImage
from probewatch.drivers.video.grey import CHANNELS, grey_of

_LAYOUT = struct.Struct(">HBBBB3H12f3H3H")
_SCALARS = {2: "i1", 3: "u1", 4: "i2", 5: "u2", 6: "i4", 7: "u4", 10: "f4", 11: "f8"}
"""Scalar type → NumPy's, by the specification."""
_GREY = 3
"""Scalar type of 8 bits without sign, which needs no conversion."""
_SPREAD_AT_ONCE = 1 << 20
"""Values converted at a time; each takes 8 bytes meanwhile, several times over. All of 64 MiB at once took 1.8 GB, more
than the unit may have; fewer take more calls.
"""
_ORDERS = {1: ">", 2: "<"}
"""Byte order of the pixels, by the specification."""

Size = tuple[int, int, int]
Levels = tuple[float, float]
"""Values that become black and white."""


@dataclass(frozen=True, slots=True)
class Image:
    """Holds one IMAGE. size, offset, part: columns, rows, slices. matrix: 12 numbers column by column, axes times
    spacing, mm, and the origin. data: the pixels of the part. order: 1 big-endian, 2 little-endian. coordinates: 1 RAS,
    2 LPS.
    """

    size: Size
    data: bytes
    scalar: int = _GREY
    components: int = 1
    order: int = 2
    coordinates: int = 1
    matrix: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    offset: Size = (0, 0, 0)
    part: Size | None = None
    version: int = 1

    @property
    def content(self) -> bytes:
        head = (self.version, self.components, self.scalar, self.order, self.coordinates, *self.size)
        return _LAYOUT.pack(*head, *self.matrix, *self.offset, *(self.part or self.size)) + self.data


def parse_image(content: bytes) -> Image:
    """Parses IMAGE. Raises ProtocolError for an impossible header, or for pixels that do not fill what it announces."""
    if len(content) < _LAYOUT.size:
        raise ProtocolError(f"IMAGE has {_LAYOUT.size} bytes or more, not {len(content)}")
    version, components, scalar, order, coordinates, *numbers = _LAYOUT.unpack_from(content)
    size, matrix, offset, part = (tuple(numbers[a:b]) for a, b in ((0, 3), (3, 15), (15, 18), (18, 21)))
    if scalar not in _SCALARS or order not in _ORDERS or components < 1:
        raise ProtocolError(f"IMAGE of scalar type {scalar}, byte order {order}, {components} components is not known")
    pixel_bytes = components * np.dtype(_SCALARS[scalar]).itemsize
    announced = part[0] * part[1] * part[2] * pixel_bytes
    if len(content) - _LAYOUT.size != announced:
        raise ProtocolError(f"IMAGE announces {announced} bytes of pixels and has {len(content) - _LAYOUT.size}")
    if any(first + count > whole for first, count, whole in zip(offset, part, size, strict=True)):
        raise ProtocolError(f"IMAGE of {_sides(size)} has no part of {_sides(part)} at {offset}")
    data = content[_LAYOUT.size :]
    return Image(size, data, scalar, components, order, coordinates, matrix, offset, part, version)


def grey_picture(image: Image, levels: Levels | None) -> GreyImage:
    """Returns the picture as (height, width) uint8. levels: the values that become black and white, between which the
    others are spread; needed for all pixels but those of 8 bits, since no sender states it. Raises ValueError that
    names what cannot be converted and what to do.
    """
    columns, rows, slices = image.size
    if slices != 1:
        remedy = "Name a picture of it by image=, or have it send one"
        raise ValueError(f"sends volumes of {_sides(image.size)} instead of pictures. {remedy}")
    if image.part != image.size:
        raise ValueError(f"sends parts of {_sides(image.part or image.size)} px. Have it send whole pictures")
    if image.components not in CHANNELS:
        raise ValueError(f"sends {image.components} components a pixel. Have it send grey, RGB or RGBA")
    if image.scalar != _GREY and levels is None:
        kind = np.dtype(_SCALARS[image.scalar]).name
        raise ValueError(f"sends pixels of {kind}. Say what is black and what is white, such as levels=0,4095")
    pixels = np.frombuffer(image.data, np.dtype(_ORDERS[image.order] + _SCALARS[image.scalar]))
    pixels = pixels.reshape((rows, columns, image.components))
    shown = _spread(pixels, levels) if levels is not None else pixels.astype(np.uint8, copy=False)
    return grey_of(shown)


def _spread(pixels: np.ndarray, levels: Levels) -> GreyImage:
    """Spreads the values between the levels over 0 to 255; NaN becomes black."""
    black, white = levels
    values, shown = pixels.reshape(-1), np.empty(pixels.size, np.uint8)
    for start in range(0, values.size, _SPREAD_AT_ONCE):
        some = slice(start, start + _SPREAD_AT_ONCE)
        shares = np.clip((values[some].astype(np.float64) - black) / (white - black), 0.0, 1.0)
        shown[some] = np.rint(255 * np.nan_to_num(shares, nan=0.0))
    return shown.reshape(pixels.shape)


def _sides(size: tuple[int, ...]) -> str:
    return " x ".join(map(str, size))
