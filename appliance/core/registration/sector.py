"""Learns where tissue is shown, so that everything beside it, such as the patient's name, can be made black.

What changes again and again as one large piece is the sector. Text never changes, and a clock or a trace that does is a
small separate piece. What is made black includes what the overlay mask calls static outside the sector, and more.
"""

import cv2
import numpy as np

from probewatch.appliance.core.registration.pyramid import Array32, Bits, half
from probewatch.drivers.samples import GreyImage

_APART = 6
"""Pictures between the two that are compared, .2 s at 30 Hz: a slow hand has moved by a grain of speckle."""
_CHANGED_GREY = 12
"""Difference, greys, that counts as change. The receiver's noise beside the sector reaches a smaller one; dim tissue
does not reach a larger one. Not measured."""
_MOVING_SHARE = 0.05
"""Share of the picture that must have changed, or else the probe is at rest and nothing is learnt: more than clocks and
traces cover."""
_ENOUGH = 6
"""Comparisons with motion before the sector is known: a second of it. Fewer leave holes at shadows."""
_FORGET = 0.97
"""Weight of what was learnt before, at each comparison: about 30 are remembered, six seconds of motion. A higher one
keeps a sector for longer that the scanner has made smaller; a lower one loses the tissue in a shadow."""
_OFTEN = 0.1
"""Share of the comparisons in which a pixel of the sector changes; a clock's digit changes in fewer. Not measured."""
_CLOSE, _OPEN, _GROW = np.ones((9, 9), np.uint8), np.ones((5, 5), np.uint8), np.ones((5, 5), np.uint8)
"""Kernels for the half-sized picture: they join speckle to one piece, cut strokes of letters off it, and keep its
edge."""
_JUMP_GREY, _JUMP_SHARE = 40, 0.02
"""Change, greys, from one picture to the next beside the sector, and the share of that area that may change so: beyond
it the scanner shows another screen, such as its list of patients, of which nothing is known. A clock's tick is a tenth
of that."""


class Sector:
    """Learns the sector from one picture after the other."""

    def __init__(self) -> None:
        self._before: GreyImage | None = None
        self._earlier: GreyImage | None = None
        self._activity: Array32 | None = None
        self._half: Bits | None = None
        self._inside: Bits | None = None
        self._count, self._seen, self._weight = 0, 0, 0.0

    def step(self, image: GreyImage) -> Bits | None:
        """Takes the next picture, (h, w) uint8, and returns where tissue may be seen in it, (h, w) bool.

        Returns None while that is not known. A picture of another size, or of another screen, starts again.
        """
        now = half(image)
        if self._before is not None and (self._before.shape != now.shape or self._another_screen(now)):
            self._forget()
        self._before = now
        self._count += 1
        if self._earlier is None or self._count >= _APART:
            if self._earlier is not None and self._learn(now, self._earlier):
                self._judge(image.shape)
            self._earlier, self._count = now, 0
        return self._inside

    def _forget(self) -> None:
        self._earlier = self._activity = self._half = self._inside = None
        self._count, self._seen, self._weight = 0, 0, 0.0

    def _another_screen(self, now: GreyImage) -> bool:
        if self._half is None or self._before is None:
            return False
        outside = ~self._half
        jumped = int(np.count_nonzero((cv2.absdiff(now, self._before) > _JUMP_GREY) & outside))
        return jumped > _JUMP_SHARE * max(int(np.count_nonzero(outside)), outside.size // 20)

    def _learn(self, now: GreyImage, earlier: GreyImage) -> bool:
        changed = cv2.absdiff(now, earlier) > _CHANGED_GREY
        if np.count_nonzero(changed) < _MOVING_SHARE * changed.size:
            return False
        before = np.zeros(now.shape, np.float32) if self._activity is None else self._activity * np.float32(_FORGET)
        self._activity = before + changed
        self._weight = self._weight * _FORGET + 1
        self._seen += 1
        return self._seen >= _ENOUGH

    def _judge(self, shape: tuple[int, ...]) -> None:
        assert self._activity is not None
        often = (self._activity > _OFTEN * self._weight).astype(np.uint8)
        pieces = cv2.morphologyEx(cv2.morphologyEx(often, cv2.MORPH_CLOSE, _CLOSE), cv2.MORPH_OPEN, _OPEN)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(pieces)
        if count < 2:
            return
        largest = (labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))).astype(np.uint8)
        outline, _ = cv2.findContours(largest, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        filled = cv2.dilate(cv2.drawContours(largest, outline, -1, 1, cv2.FILLED), _GROW)
        self._half = np.asarray(filled > 0)
        self._inside = np.asarray(cv2.resize(filled, (shape[1], shape[0]), interpolation=cv2.INTER_NEAREST) > 0)
