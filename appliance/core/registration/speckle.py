"""High-pass filter that leaves the speckle of a picture.

Where speckle changes, the residuals of neighbouring pixels are correlated. Least squares assume that they are not, and
in the filtered picture they are less so.
"""

import cv2
import numpy as np

from probewatch.appliance.core.registration.pyramid import Array32, Bits, Level, Pyramid, mask_at

_COARSEST_WIDTHS, _FINEST_SIGMAS = 4, 95
"""The height of the picture ÷ the width, or ÷ sigma, of what counts as smooth."""
_SMOOTH = 2
"""The level it is averaged on; between its pixels what is smooth is a straight line."""
_LEAST_SHARE = 0.01
"""Share of the neighbourhood that the mask leaves visible. It only keeps the mean of almost nothing from 0 ÷ 0: no
point is taken from there, as the mask hides it.
"""


def coarse_speckle(level: Level) -> Array32:
    """Speckle of the coarsest level, without shadows and gain."""
    width = level.shape[0] // _COARSEST_WIDTHS | 1
    return np.asarray(cv2.subtract(level, cv2.blur(level, (width, width)), dtype=cv2.CV_32F), dtype=np.float32)


class Speckle:
    """Speckle of the finest level. mask: (h, w) bool of the picture, True where tissue may be seen: what is smooth is
    averaged from there, or text would shade what is around it."""

    def __init__(self, mask: Bits | None) -> None:
        self._mask = mask
        self._seen: Array32 | None = None
        self._weight: Array32 | None = None
        self._latest: tuple[Pyramid, Level] | None = None

    def of(self, levels: Pyramid) -> Level:
        """(h, w). Of the latest picture it is remembered: where a registration does not convince, others follow."""
        if self._latest is None or self._latest[0] is not levels:
            height, width = levels.finest.shape
            smooth = cv2.resize(self._smooth(levels), (width, height), interpolation=cv2.INTER_LINEAR)
            self._latest = levels, np.asarray(levels.finest - smooth, dtype=np.int16)
        return self._latest[1]

    def _smooth(self, levels: Pyramid) -> Level:
        level = levels.levels[min(_SMOOTH, levels.coarsest)]
        if self._mask is None:
            return np.asarray(_averaged(level), dtype=np.int16)
        if self._seen is None or self._weight is None:
            self._seen = mask_at(self._mask, level.shape).astype(np.float32)
            self._weight = np.divide(1, np.maximum(_averaged(self._seen), _LEAST_SHARE), dtype=np.float32)
        smooth = _averaged(cv2.multiply(level, self._seen, dtype=cv2.CV_32F))
        return np.asarray(cv2.multiply(smooth, self._weight, dtype=cv2.CV_16S), dtype=np.int16)


def _averaged(level: cv2.typing.MatLike) -> cv2.typing.MatLike:
    return cv2.GaussianBlur(level, (0, 0), level.shape[0] / _FINEST_SIGMAS)
