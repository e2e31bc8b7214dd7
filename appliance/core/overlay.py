"""Learns which pixels never move: text, rulers, sector edge and probe arc would lock a registration to zero motion."""

import cv2
import numpy as np
from numpy.typing import NDArray

from appliance.core.registration import Array32, Pyramid

_STEP_FRAMES = 4
_EARLY = (3, 6)
_EVERY = 12
_FORGET = 0.98
_STATIC_RATIO = 0.25
_FLOOR_GREY = 3.0
_MOVING_SHARE = 0.05


class OverlayMask:
    """Static means: a strong gradient, yet no change while the rest of the picture moved.

    Works at half resolution. A first guess after three moving frames, a good one after twelve.
    """

    def __init__(self) -> None:
        self._history: list[Array32] = []
        self._change: Array32 | None = None
        self._gradient: Array32 | None = None
        self._shape: tuple[int, ...] = (0, 0)
        self._seen = 0
        self._mask: NDArray[np.bool_] | None = None

    @property
    def mask(self) -> NDArray[np.bool_] | None:
        """(h, w) bool, True where tissue may be seen; None until enough motion was seen."""
        return self._mask

    @property
    def settled(self) -> bool:
        """False while what does not move may still be taken for tissue."""
        return self._mask is not None

    def step(self, levels: Pyramid) -> bool:
        """Take the next picture; True when the mask changed."""
        if len(levels) < 2:
            return False
        self._shape = levels[0].shape
        self._history.append(levels[1])
        if len(self._history) <= _STEP_FRAMES:
            return False
        earlier = self._history.pop(0)
        if not self._learn(levels[1], earlier):
            return False
        self._seen += 1
        if self._seen not in _EARLY and self._seen % _EVERY:
            return False
        self._mask = self._judge()
        return True

    def _learn(self, now: Array32, earlier: Array32) -> bool:
        gradient = _gradient(now)
        strong = gradient > _FLOOR_GREY
        change = np.abs(now - earlier)
        moved = np.count_nonzero(change[strong] > 0.5 * gradient[strong])
        if moved < _MOVING_SHARE * max(int(np.count_nonzero(strong)), 1):
            return False
        if self._change is None or self._gradient is None:
            self._change, self._gradient = np.zeros_like(change), np.zeros_like(gradient)
        self._change = np.float32(_FORGET) * self._change + change
        self._gradient = np.float32(_FORGET) * self._gradient + gradient
        return True

    def _judge(self) -> NDArray[np.bool_]:
        assert self._change is not None
        assert self._gradient is not None
        change, gradient = self._change, self._gradient
        floor = np.float32(_FLOOR_GREY * float(np.clip(self._seen, 0, 10)))
        static = np.less(change, np.float32(_STATIC_RATIO) * gradient) & np.greater(gradient, floor)
        grown = cv2.dilate(static.astype(np.uint8), np.ones((3, 3), np.uint8))
        full = cv2.resize(grown, (self._shape[1], self._shape[0]), interpolation=cv2.INTER_NEAREST)
        return np.asarray(full == 0)


def _gradient(image: Array32) -> Array32:
    """Largest grey difference within ±1 px, a measure of how much a one-pixel move would change."""
    kernel = np.ones((3, 3), np.uint8)
    return np.asarray(cv2.morphologyEx(image, cv2.MORPH_GRADIENT, kernel), dtype=np.float32)
