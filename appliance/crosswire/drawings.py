"""Finds text and marks that the scanner draws over its pictures. Pure."""

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.samples import GreyImage

_DRAWN_GREY = 30
_DRAWN_RANGE_GREY = 16
"""Grey levels: what is brighter than the first, and changed by less than the second, in every picture so far is drawn.
Less of the first or more of the second takes a still background for drawn; the reverse leaves letters over. Not
measured."""


class Drawings:
    """Tracks what the scanner draws over the picture: what is bright, and unchanged in every picture so far.

    The wires themselves count as drawn until they have moved, so that nothing is measured on half a spot.
    """

    def __init__(self) -> None:
        self._darkest: GreyImage | None = None
        self._brightest: GreyImage | None = None

    def step(self, image: GreyImage) -> NDArray[np.uint8]:
        """Takes the next picture. Returns (h, w) uint8, non-zero on and next to what never changed."""
        if self._darkest is None or self._brightest is None or self._darkest.shape != image.shape:
            self._darkest, self._brightest = image.copy(), image.copy()
        cv2.min(self._darkest, image, self._darkest)
        cv2.max(self._brightest, image, self._brightest)
        still = cv2.subtract(self._brightest, self._darkest) < _DRAWN_RANGE_GREY
        drawn = (still & (self._darkest > _DRAWN_GREY)).astype(np.uint8)
        return np.asarray(cv2.dilate(drawn, np.ones((5, 5), np.uint8)), np.uint8)
