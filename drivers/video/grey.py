"""Makes colour pictures grey, as every source and recording does, by the weights of Rec. 601."""

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.samples import GreyImage

_CONVERSIONS = {3: cv2.COLOR_RGB2GRAY, 4: cv2.COLOR_RGBA2GRAY}
"""Number of channels → OpenCV's conversion."""
CHANNELS = (1, *_CONVERSIONS)
"""Channels of a picture that can be made grey: grey, RGB, RGBA."""


def grey_of(pixels: NDArray[np.uint8]) -> GreyImage:
    """Makes a picture grey, (h, w, channels) uint8 → (h, w) uint8; that of one channel is a view."""
    if pixels.shape[2] == 1:
        return np.asarray(pixels[:, :, 0], np.uint8)
    return np.asarray(cv2.cvtColor(pixels, _CONVERSIONS[pixels.shape[2]]), np.uint8)
