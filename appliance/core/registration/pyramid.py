"""Reduces a picture to several sizes, the coarse ones to find a motion and the fine ones to measure it."""

from ctypes import c_int32, c_void_p
from dataclasses import dataclass
from itertools import accumulate

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.acquisition.input_validation import refused_picture
from probewatch.appliance.core.registration.compiled import declared
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import GreyImage

Array32 = NDArray[np.float32]
Bits = NDArray[np.bool_]
Level = NDArray[np.int16]
"""Greys in ninths."""

_HALVINGS = 3
"""Times that a picture is halved, for four levels: steps of 40 px are found
(tests/appliance/core/registration/test_registration.py). More find longer leaps, on levels with little left to see;
fewer lose a quick hand. Not varied by itself."""
_LEAST_SIDE, _MOST_SIDE = 32, 800
"""Shorter side, px, below which a level is not halved again, because too few points would be left; and above which a
picture is halved first: its speckle is several px wide, and a quarter of the work measures as well
(tests/appliance/core/registration/test_registration.py, 1440 × 1080).
"""
_WHOLE = 252
"""Mean of a mask's pixels, out of 255, above which all of them count as set; one in a hundred may be missing."""


@dataclass(frozen=True, slots=True, eq=False)
class Pyramid:
    """Holds a picture at several sizes.

    shape: rows, columns of the picture as it came. factor: px of it per px of the finest level, more than one where it
    is larger than any speckle requires. picture: (h, w) uint8 of the size of the finest level. levels: the finest
    first, each half the size of the one before; pixel i of a level is the mean of 2i and 2i + 1 of the finer one.
    """

    shape: tuple[int, int]
    factor: float
    picture: GreyImage
    levels: tuple[Level, ...]

    @property
    def finest(self) -> Level:
        """Returns the finest level, (h, w)."""
        return self.levels[0]

    @property
    def coarsest(self) -> int:
        """Returns the index of the last level."""
        return len(self.levels) - 1


def pyramid(picture: GreyImage) -> Pyramid:
    """Returns the levels of a picture, (h, w) uint8. Raises ValueError where it is not such a picture.

    The finest level is the sum of the 3 × 3 pixels around each: between the pixels of a sharp picture, linear
    interpolation shifts what it shows, and rounding to greys again would shift it as well.
    """
    if refusal := refused_picture(picture):
        raise ValueError(refusal)
    shape, factor = (picture.shape[0], picture.shape[1]), 1.0
    while min(picture.shape) > _MOST_SIDE:
        picture, factor = half(picture), 2 * factor
    picture = np.ascontiguousarray(picture)
    rows, columns = picture.shape
    halvings = next((k for k in range(_HALVINGS) if min(rows, columns) >> k < _LEAST_SIDE), _HALVINGS)
    shapes = [(rows >> k, columns >> k) for k in range(halvings + 1)]
    ends = list(accumulate(height * width for height, width in shapes))
    greys = np.empty(ends[-1], np.int16)
    _levels(picture.ctypes.data, rows, columns, halvings, greys.ctypes.data)
    parts = (
        greys[end - height * width : end].reshape(height, width)
        for (height, width), end in zip(shapes, ends, strict=True)
    )
    return Pyramid(shape, factor, picture, tuple(parts))


def half(image: GreyImage) -> GreyImage:
    """Returns the means of 2 × 2 pixels, (h ÷ 2, w ÷ 2)."""
    height, width = image.shape[0] // 2, image.shape[1] // 2
    even = image[: 2 * height, : 2 * width]
    return np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def mask_at(mask: Bits, shape: tuple[int, ...]) -> Bits:
    """Returns the mask, (h, w), at another size; a coarse pixel is set only where all of its finer ones are."""
    if mask.shape == shape:
        return mask
    share = cv2.resize(mask.view(np.uint8) * np.uint8(255), (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
    return np.asarray(share > _WHOLE)


def centre_px(width: int, height: int) -> Array:
    """Returns the column and row, (2,), of the image centre."""
    return np.array([(width - 1) / 2, (height - 1) / 2])


_levels = declared("levels", c_void_p, c_int32, c_int32, c_int32, c_void_p)
