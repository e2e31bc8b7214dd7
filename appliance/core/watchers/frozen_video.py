"""A live picture is never the same twice: noise alone changes it. One that is has been frozen."""

import numpy as np

from appliance.types import Check, VerdictKind
from drivers.samples import Frame, GreyImage

_SAME_GREY = 2
"""Difference up to which a pixel is the same: a video codec's ripple. More calls a dark, quiet picture frozen; noise of
± 4 greys is live (tests/test_core_watchers.py).
"""
_CHANGED_SHARE = 1e-3
"""Of the pixels, that may change in a frozen picture: a clock of 20 × 10 px in 640 × 480 is .0007
(tests/test_core_watchers.py). More calls a live picture frozen that moves in one place only.
"""


class FrozenVideo:
    """Counts for how long successive pictures have been equal, up to a ticking clock in a corner.

    repeats: whether the latest picture equalled the one before.
    """

    def __init__(self, limit_ns: int) -> None:
        self._limit_ns = limit_ns
        self._image: GreyImage | None = None
        self._since_ns = 0
        self.repeats = False

    def step(self, frame: Frame) -> Check:
        """Age of the picture's content, ms. frame.image: (h, w) uint8."""
        self.repeats = self._image is not None and _same(self._image, frame.image)
        if not self.repeats:
            self._since_ns = frame.stamp.t_ns
        self._image = frame.image
        age_ns = frame.stamp.t_ns - self._since_ns
        verdict = VerdictKind.FAULT if age_ns > self._limit_ns else VerdictKind.OK
        return Check("frozen-video", "frozen-video", age_ns / 1e6, 0.0, "ms", self._limit_ns / 1e6, verdict)


def _same(before: GreyImage, now: GreyImage) -> bool:
    if before.shape != now.shape:
        return False
    sparse_before, sparse_now = before[::2, ::2].astype(np.int16), now[::2, ::2].astype(np.int16)
    changed = np.count_nonzero(np.abs(sparse_now - sparse_before) > _SAME_GREY)
    return bool(changed <= _CHANGED_SHARE * sparse_now.size)
