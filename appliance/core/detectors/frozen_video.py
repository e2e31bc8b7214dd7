"""A live picture is never the same twice: noise alone changes it. One that is has been frozen."""

import numpy as np

from appliance.core.detectors.detector import Detector
from appliance.types import Check, Fault, VerdictKind
from drivers.samples import GreyImage

_SAME_GREY = 2
"""Difference up to which a pixel is the same: a video codec's ripple. More calls a dark, quiet picture frozen; noise of
± 4 greys is live (tests/appliance/core/detectors/test_detectors.py).
"""
_CHANGED_SHARE = 1e-3
"""Of the pixels, that may change in a frozen picture: a clock of 20 × 10 px in 640 × 480 is .0007
(tests/appliance/core/detectors/test_detectors.py). More calls a live picture frozen that moves in one place only.
"""


class FrozenVideo(Detector):
    """Counts for how long successive pictures have been equal, up to a ticking clock in a corner.

    The line asks it first: what repeats the picture before is not registered. repeats: whether the latest did.
    """

    def __init__(self, limit_ns: int) -> None:
        self._limit_ns = limit_ns
        self.forget_pictures(0)

    def forget_pictures(self, since_ns: int) -> None:
        """See Detector; the picture before is forgotten as well."""
        self._image: GreyImage | None = None
        self._since_ns = self._now_ns = 0
        self.repeats = False

    @property
    def repeats_ns(self) -> int:
        """Age of the picture's content."""
        return self._now_ns - self._since_ns

    def compare(self, t_ns: int, image: GreyImage) -> None:
        """Take the next picture, (h, w) uint8, of t_ns."""
        self.repeats = self._image is not None and _same(self._image, image)
        if not self.repeats:
            self._since_ns = t_ns
        self._image, self._now_ns = image, t_ns

    def checks(self) -> tuple[Check, ...]:
        """Age of the picture's content, ms."""
        if self._image is None:
            return ()
        verdict = VerdictKind.FAULT if self.repeats_ns > self._limit_ns else VerdictKind.OK
        limit_ms = self._limit_ns / 1e6
        return (Check("frozen-video", Fault.FROZEN_VIDEO, self.repeats_ns / 1e6, 0.0, "ms", limit_ms, verdict),)


def _same(before: GreyImage, now: GreyImage) -> bool:
    if before.shape != now.shape:
        return False
    sparse_before, sparse_now = before[::2, ::2].astype(np.int16), now[::2, ::2].astype(np.int16)
    changed = np.count_nonzero(np.abs(sparse_now - sparse_before) > _SAME_GREY)
    return bool(changed <= _CHANGED_SHARE * sparse_now.size)
