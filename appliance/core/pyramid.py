"""A picture at several sizes, coarse to find the way and fine to measure it."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from appliance.core.geometry import Array
from drivers.samples import GreyImage

Array32 = NDArray[np.float32]
Bits = NDArray[np.bool_]
Level = GreyImage | Array32

_HALVINGS = 3
_LEAST_SIDE, _MOST_SIDE = 32, 800
_SMOOTHED_PX = (3, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Pyramid:
    """shape: rows, columns of the picture as it came. factor: px of it per px of the finest level, more than one where
    it is larger than any speckle asks for. picture: (h, w) uint8 of the finest level. finest: the same smoothed a
    little, float32. halved: uint8, each half the size of the one before; pixel i of a level is the mean of 2i and
    2i + 1 of the finer one."""

    shape: tuple[int, int]
    factor: float
    picture: GreyImage
    finest: Array32
    halved: tuple[GreyImage, ...]

    def level(self, index: int) -> Level:
        """0 is the finest."""
        return self.halved[index - 1] if index else self.finest

    @property
    def coarsest(self) -> int:
        """Index of the last level."""
        return len(self.halved)


def pyramid(picture: GreyImage) -> Pyramid:
    """(h, w) uint8 → levels.

    The finest is float32, for OpenCV looks bytes up in steps of a 32nd of a pixel, and smoothed a little, for between
    the pixels of a sharp picture linear interpolation shifts what it shows. The others only steer.
    """
    shape, factor = (picture.shape[0], picture.shape[1]), 1.0
    while min(picture.shape) > _MOST_SIDE:
        picture, factor = _half(picture), 2 * factor
    finest = np.asarray(cv2.boxFilter(picture, cv2.CV_32F, _SMOOTHED_PX), dtype=np.float32)
    halved: list[GreyImage] = []
    image = picture
    while len(halved) < _HALVINGS and min(image.shape) >= _LEAST_SIDE:
        halved.append(_half(image))
        image = np.asarray(cv2.blur(halved[-1], _SMOOTHED_PX), dtype=np.uint8)
    return Pyramid(shape, factor, picture, finest, tuple(halved))


def _half(image: GreyImage) -> GreyImage:
    height, width = image.shape[0] // 2, image.shape[1] // 2
    even = image[: 2 * height, : 2 * width]
    return np.asarray(cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def mask_at(mask: Bits, shape: tuple[int, ...]) -> Bits:
    """(h, w) of another size; a coarse pixel counts only when all of its finer ones do."""
    if mask.shape == shape:
        return mask
    share = cv2.resize(mask.view(np.uint8) * np.uint8(255), (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
    return np.asarray(share > 252)


def centre_px(width: int, height: int) -> Array:
    """(2,) column and row of the image centre."""
    return np.array([(width - 1) / 2, (height - 1) / 2])
