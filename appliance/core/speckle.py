"""What is left of a picture without what is smooth in it.

Where speckle changes, neighbouring pixels change together; least squares do best where they do not, and in the speckle
alone they do less.
"""

import cv2
import numpy as np

from appliance.core.pyramid import Array32, Bits, Level, Pyramid, mask_at

_OF_COARSEST, _OF_FINEST = 4, 32
"""The height of the picture ÷ the width of what counts as smooth."""
_LEAST_SHARE = 0.01


def coarse_speckle(image: Level) -> Array32:
    """Of the coarsest level: without shadows and gain."""
    smooth = cv2.blur(image, _around(image, _OF_COARSEST))
    return np.asarray(cv2.subtract(image, smooth, dtype=cv2.CV_32F), dtype=np.float32)


class Speckle:
    """Of the finest level. mask: (h, w) bool of the picture, True where tissue may be seen: what is smooth is averaged
    from there, or text would shade what is around it. shape: of the finest level."""

    def __init__(self, mask: Bits | None, shape: tuple[int, ...]) -> None:
        self._seen = None if mask is None else mask_at(mask, shape).astype(np.uint8)
        self._weight: Array32 | None = None
        self._latest: tuple[Pyramid, Array32] | None = None

    def of(self, levels: Pyramid) -> Array32:
        """(h, w). Of the latest picture it is remembered: where a registration does not convince, others follow."""
        if self._latest is None or self._latest[0] is not levels:
            self._latest = levels, self._taken(levels)
        return self._latest[1]

    def _taken(self, levels: Pyramid) -> Array32:
        around = _around(levels.picture, _OF_FINEST)
        if self._seen is None:
            return np.asarray(levels.finest - cv2.boxFilter(levels.picture, cv2.CV_32F, around), dtype=np.float32)
        if self._weight is None:
            share = cv2.boxFilter(self._seen, cv2.CV_32F, around)
            self._weight = np.divide(1, np.maximum(share, _LEAST_SHARE), dtype=np.float32)
        smooth = cv2.boxFilter(cv2.multiply(levels.picture, self._seen), cv2.CV_32F, around)
        return np.asarray(levels.finest - cv2.multiply(smooth, self._weight), dtype=np.float32)


def _around(image: Level, share: int) -> tuple[int, int]:
    side = image.shape[0] // share | 1
    return side, side
