"""Detects pictures that repeat: noise alone changes a live picture, so these were frozen, by a fault or by the user."""

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.detectors.detector import Detector
from probewatch.appliance.core.detectors.screen_change import ScreenChange, sparse_of
from probewatch.appliance.types import Check, Fault, VerdictKind
from probewatch.drivers.samples import GreyImage

REPORTS_FAULTS = (Fault.FROZEN_VIDEO, Fault.USER_FREEZE)

_SAME_GREY = 2
"""Largest difference, greys, at which a pixel is the same: the ripple of a video codec. A larger one calls a dark,
quiet picture frozen; noise of ± 4 greys is live (tests/appliance/core/detectors/test_detectors.py).
"""
_CHANGED_SHARE = 1e-3
"""Largest share of the pixels that may change in a frozen picture: a clock of 20 × 10 px in 640 × 480 is .0007
(tests/appliance/core/detectors/test_detectors.py). A larger one calls a live picture frozen that moves in one place
only.
"""


class FrozenVideo(Detector):
    """Measures for how long successive pictures have been equal, except for a ticking clock in a corner.

    The line asks it first, because a picture that repeats the one before is not registered. Where the screen changed
    around the repeated picture, the user froze it: there is nothing to compare, and no fault.
    repeats: whether the latest picture repeats the one before. limit_ns: time, ns, beyond which they are frozen.
    """

    def __init__(self, limit_ns: int) -> None:
        self._limit_ns = limit_ns
        self._screen = ScreenChange()
        self.forget_pictures(0)

    def forget_pictures(self, since_ns: int) -> None:
        """See Detector. The previous picture is forgotten as well."""
        self._image: NDArray[np.int16] | None = None
        self._screen.restart()
        self._since_ns = self._now_ns = 0
        self.repeats = False

    @property
    def repeats_ns(self) -> int:
        """Returns the age of the picture's content, ns."""
        return self._now_ns - self._since_ns

    def compare(self, t_ns: int, image: GreyImage) -> None:
        """Takes the next picture, (h, w) uint8, stamped t_ns."""
        sparse = sparse_of(image)
        before = self._image
        change = None if before is None or before.shape != sparse.shape else np.abs(sparse - before)
        self.repeats = change is not None and _same(change)
        self._screen.step(sparse, change, self.repeats)
        if not self.repeats:
            self._since_ns = t_ns
        self._image, self._now_ns = sparse, t_ns

    def checks(self) -> tuple[Check, ...]:
        """Returns the age of the picture's content, ms; none before the first picture."""
        if self._image is None:
            return ()
        name, fault, verdict = "frozen-video", Fault.FROZEN_VIDEO, VerdictKind.OK
        if self.repeats_ns > self._limit_ns and self._screen.seen:
            name, fault, verdict = "user-freeze", Fault.USER_FREEZE, VerdictKind.NOT_VERIFIED
        elif self.repeats_ns > self._limit_ns:
            verdict = VerdictKind.FAULT
        return (Check(name, fault, self.repeats_ns / 1e6, 0.0, "ms", self._limit_ns / 1e6, verdict),)


def _same(change: NDArray[np.int16]) -> bool:
    return bool(np.count_nonzero(change > _SAME_GREY) <= _CHANGED_SHARE * change.size)
