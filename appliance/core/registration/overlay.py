"""Learns which pixels never move: text, rulers, sector edge and probe arc would hold a registration at zero motion."""

from collections import deque

import cv2
import numpy as np

from probewatch.appliance.core.registration.pyramid import Array32, Bits, Pyramid, half
from probewatch.drivers.samples import GreyImage

_LEAST_APART, _MOST_APART = 4, 24
"""Fewest and most pictures between the two that are compared: at 30 Hz, .8 s at most. More wait for slower hands and
keep as many pictures in memory; fewer learn tissue as overlay.
"""
_EARLY, _GOOD, _EVERY = 3, 9, 6
"""Comparisons after which there is a first mask; from which the mask includes all still pixels; and between two masks.
Fewer take slow tissue for overlay; more hold registration back for longer.
"""
_FORGET = 0.95
"""Weight of what was learnt before, at each comparison: about 20 are remembered. A higher one keeps an overlay for
longer that the scanner has moved; a lower one makes the mask unsteady. Not measured.
"""
_STATIC_SHARE = 0.4
"""Ratio of change to usual change below which a pixel is static. A higher one masks tissue that moves little; a lower
one leaves text that has the picture's noise in it. Not measured.
"""
_FLOOR_GREY = 3.0
"""Gradient, greys, from which a pixel counts: flatter ones change by noise alone."""
_MOVED, _MOVED_AT_ALL = 0.3, 0.05
"""Least shares of the structure that must have changed by half of its gradient, the second for the most pictures
between the two; another place altogether would change .6."""
_AROUND = np.ones((3, 3), np.uint8)
"""Kernel of the gradient, the largest grey difference within ±1 px: what a shift by one pixel would change."""


class OverlayMask:
    """Learns the mask of what is static: a strong gradient that changes much less than such gradients do elsewhere.

    It works at half resolution. Each picture is compared with one far enough back for most of the tissue to have
    changed, because in a slow sweep it looks the same for long; four such pairs are compared in that time. There is a
    first mask after three comparisons, which takes only the stillest pixels, and a good one after nine.
    """

    def __init__(self) -> None:
        self._history: deque[GreyImage] = deque(maxlen=_MOST_APART + 1)
        self._apart = _LEAST_APART
        self._wait = 0
        self._change: Array32 | None = None
        self._expected: Array32 | None = None
        self._shape: tuple[int, ...] = (0, 0)
        self._seen = 0
        self._mask: Bits | None = None

    @property
    def mask(self) -> Bits | None:
        """Returns the mask, (h, w) bool, True where tissue may be seen; None until enough motion was seen."""
        return self._mask

    @property
    def settled(self) -> bool:
        """Returns whether static overlay has been distinguished from tissue."""
        return self._mask is not None

    def step(self, levels: Pyramid) -> bool:
        """Takes the next picture; returns whether the mask changed."""
        if not levels.coarsest:
            return False
        self._shape = levels.shape
        self._history.append(half(levels.picture))
        self._wait -= 1
        if self._wait > 0 or len(self._history) <= self._apart:
            return False
        if not self._learn(self._history[-1], self._history[-1 - self._apart]):
            self._apart = min(self._apart + 1, _MOST_APART)
            return False
        self._wait = self._apart // _LEAST_APART
        self._apart = max(self._apart - 1, _LEAST_APART)
        self._seen += 1
        if self._seen != _EARLY and self._seen % _EVERY:
            return False
        self._mask = self._judge()
        return True

    def _learn(self, now: GreyImage, earlier: GreyImage) -> bool:
        gradient = np.asarray(cv2.morphologyEx(now, cv2.MORPH_GRADIENT, _AROUND), dtype=np.uint8)
        change = np.asarray(cv2.absdiff(now, earlier), dtype=np.uint8)
        strong = gradient > _FLOOR_GREY
        enough = _MOVED if self._apart < _MOST_APART else _MOVED_AT_ALL
        moved = np.count_nonzero((cv2.add(change, change) > gradient) & strong)
        if moved < enough * max(int(np.count_nonzero(strong)), 1):
            return False
        if self._change is None or self._expected is None:
            self._change, self._expected = np.zeros(now.shape, np.float32), np.zeros(now.shape, np.float32)
        self._change *= np.float32(_FORGET)
        self._expected *= np.float32(_FORGET)
        cv2.accumulate(change, self._change)
        # The change expected of a pixel is its gradient times the ratio of change to gradient in the whole picture.
        usual = float(change[strong].sum()) / float(gradient[strong].sum())
        cv2.scaleAdd(gradient.astype(np.float32), usual, self._expected, self._expected)
        return True

    def _judge(self) -> Bits:
        assert self._change is not None
        assert self._expected is not None
        floor = np.float32(_FLOOR_GREY * float(np.clip(self._seen, 0, 10)))
        share = np.float32(_STATIC_SHARE * min(self._seen / _GOOD, 1.0))
        static = np.less(self._change, share * self._expected) & np.greater(self._expected, floor)
        grown = cv2.dilate(static.astype(np.uint8), _AROUND)
        full = cv2.resize(grown, (self._shape[1], self._shape[0]), interpolation=cv2.INTER_NEAREST)
        return np.asarray(full == 0)
