"""Models what a scanner and a grabber do to pictures before anyone sees them: averaging, smoothing, a slower rate,
JPEG.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from probewatch.drivers.samples import GreyImage
from probewatch.drivers.twins.scene.tissue import Floats

_SMOOTH_PX, _SMOOTH_GREYS, _SMOOTH_SIGMA_PX = 5, 30.0, 1.5
"""Parameters of the bilateral filter: width, how different in grey a neighbour may be to count in full, and reach. A
speckle cell stays and its grain goes, as scanners do it by default. Wider ones blur borders as well. Set by eye."""


@dataclass(frozen=True, slots=True)
class Processing:
    """Describes the processing. persistence: share of the last picture that stays. smoothed: whether speckle is
    smoothed while borders are kept. repeats: how often the grabber sees each picture of the scanner. jpeg: quality of
    the grabber's coding, 0 for none.
    """

    persistence: float = 0.0
    smoothed: bool = False
    repeats: int = 1
    jpeg: int = 0


class ProcessingScanner:
    """Processes pictures in order. After off() there is nothing on the screen, and the next picture starts anew."""

    def __init__(self, processing: Processing) -> None:
        self._processing = processing
        self._mean: Floats | None = None

    def off(self) -> None:
        """Forgets the last picture."""
        self._mean = None

    def processed(self, grey: GreyImage) -> GreyImage:
        """Returns what the scanner shows, before it draws words over it."""
        now = self._processing
        if now.smoothed:
            grey = np.asarray(cv2.bilateralFilter(grey, _SMOOTH_PX, _SMOOTH_GREYS, _SMOOTH_SIGMA_PX), np.uint8)
        if not now.persistence:
            return grey
        fresh = grey.astype(np.float32)
        stays = np.float32(now.persistence)
        # Not in whole greys: rounding after each picture would hold a difference of one or two for ever.
        self._mean = fresh if self._mean is None else stays * self._mean + (1 - stays) * fresh
        return np.rint(self._mean).astype(np.uint8)

    def grabbed(self, grey: GreyImage) -> GreyImage:
        """Returns what the grabber passes on."""
        if not self._processing.jpeg:
            return grey
        _, coded = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, self._processing.jpeg])
        return np.asarray(cv2.imdecode(coded, cv2.IMREAD_GRAYSCALE), np.uint8)
