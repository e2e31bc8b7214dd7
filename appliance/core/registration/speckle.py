"""Filters a picture with a high-pass that leaves its speckle.

Where speckle changes, the residuals of neighbouring pixels are correlated. Least squares assumes that they are not, and
in the filtered picture they are less so.
"""

import cv2
import numpy as np

from probewatch.appliance.core.registration.pyramid import Array32, Bits, Level, Pyramid, mask_at

_COARSEST_WIDTHS, _FINEST_SIGMAS = 4, 95
"""Height of the picture ÷ the width, or ÷ sigma, of the average that counts as smooth."""
_SMOOTH = 2
"""Index of the level that is averaged; between its pixels the smooth part is interpolated linearly."""
_LEAST_SHARE = 0.01
"""Least share of the neighbourhood that the mask leaves visible. It only prevents 0 ÷ 0 in the mean of almost nothing:
no point is taken from there, because the mask hides it.
"""


def coarse_speckle(level: Level) -> Array32:
    """Returns the speckle of the coarsest level, without shadows and gain."""
    width = level.shape[0] // _COARSEST_WIDTHS | 1
    return np.asarray(cv2.subtract(level, cv2.blur(level, (width, width)), dtype=cv2.CV_32F), dtype=np.float32)


class Speckle:
    """Filters the finest level of pictures, and remembers the latest.

    mask: (h, w) bool of the picture, True where tissue may be seen: the smooth part is averaged there alone, or text
    would shade its surroundings.
    """

    def __init__(self, mask: Bits | None) -> None:
        self._mask = mask
        self._seen: Array32 | None = None
        self._weight: Array32 | None = None
        self._latest: tuple[Pyramid, Level] | None = None

    def of(self, levels: Pyramid) -> Level:
        """Returns the speckle of the finest level, (h, w).

        That of the latest picture is remembered: where a registration does not convince, others follow.
        """
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
