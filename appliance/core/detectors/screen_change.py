"""Detects that the scanner's screen changed beside a stationary picture: then a person froze it, and the video is live.

A grabber or a cable that fails repeats everything. A freeze key stops the tissue and shows a mark, a text or a bar for
the frames kept, where nothing had moved before.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.samples import GreyImage

_STILL_GREY = 8
"""Change, grey levels, up to which a pixel has not moved. More takes dim tissue for screen; less takes a noisy screen
for tissue."""
_DECAY_GREY = 4
"""Grey levels by which the memory of what moved fades with each picture: 2 s at 30 Hz for a change from black to white,
so that the seconds of a clock count as moving. Less takes a mark that comes again soon for a clock, more a clock for a
mark."""
_AROUND = np.ones((13, 13), np.uint8)
"""Neighbourhood, 6 pixels to each side, in which nothing has moved about what counts as screen: dim tissue lies between
bright tissue. Wider misses marks close to the sector; narrower takes a gap in the speckle for screen."""
_MARK_GREY = 25
"""Change, grey levels, that makes a pixel part of a mark. Less counts the ripple of a codec; more misses a dim text.
Not measured."""
_LEAST_SHARE, _MOST_SHARE = 2.5e-4, 0.1
"""Least and largest share of the picture that a mark covers. The least is 9 × 9 px of 640 × 480, smaller than any
freeze symbol; a third of it is ten pixels of noise. What covers more than the largest is a menu, which another detector
reports. Not measured on real scanners."""

_Sparse = NDArray[np.int16]


class ScreenChange:
    """Remembers, while the picture is live, which pixels never move.

    seen: whether something has appeared, since the picture became stationary, where nothing had moved.
    """

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forgets all pictures."""
        self._before: _Sparse | None = None
        self._moved: _Sparse | None = None
        self._live: tuple[_Sparse, _Sparse] | None = None
        self.seen = False

    def step(self, sparse: _Sparse, change: _Sparse | None, stands: bool) -> None:
        """Takes the next picture.

        sparse: (h, w) int16 grey levels. change: its absolute difference from the picture before, None for the first
        and after another size. stands: whether the two are the same.
        """
        if change is None:
            self.restart()
        elif not stands:
            self._note(change)
        elif not self.seen and self._live is not None:
            self.seen = _marked(sparse, *self._live)
        self._before = sparse

    def _note(self, change: _Sparse) -> None:
        """Keeps the picture before, which was live, or is from before the mark."""
        assert self._before is not None
        if self._moved is None:
            self._moved = np.full(change.shape, 255, np.int16)
        self._live = self._before, self._moved
        self._moved = np.maximum(self._moved - _DECAY_GREY, change)
        self.seen = False


def sparse_of(image: GreyImage) -> _Sparse:
    """Returns every second pixel of every second row."""
    return image[::2, ::2].astype(np.int16)


def _marked(now: _Sparse, live: _Sparse, moved: _Sparse) -> bool:
    screen = cv2.dilate(moved, _AROUND) <= _STILL_GREY
    share = np.count_nonzero((np.abs(now - live) > _MARK_GREY) & screen) / now.size
    return bool(_LEAST_SHARE <= share <= _MOST_SHARE)
