"""Undoes the averaging of a scanner that leaves a share s of the last picture in the next: q_n = s q_(n-1) + (1 − s) p_n.

What is left of the last picture stands where its tissue was. Registration is drawn there, so that motion is seen late
and, where the speckle changes, too short. The share shows where the probe moves quickly: p_n has nothing in common with
the pictures before it, place by place, and whatever q_n has in common with them is what the scanner left: s of the
last, s² of the one before that, s³ of the next. No motion of tissue does that each time alike.

That there is no share shows in any motion. Slopes of speckle that has gone on by half a cell are opposite to what they
were, where something of the last picture is left they are not.
"""

from collections import deque

import cv2
import numpy as np
from numpy.typing import NDArray

from appliance.core.registration.pyramid import Array32, Bits
from drivers.samples import GreyImage

_SPOTS = 12_000
"""Places at which pictures are compared. A likeness then errs by .015 (study, gesture, 400 × 300 px); time grows with
them."""
_BACK = 3
"""Pictures with which each is compared, for s, s² and s³. Not varied."""
_FEWEST, _MOST, _WITHIN = 12, 24, 120
"""Quick pictures by whose median a share is told, at least and at most, and among how many pictures. Fewer tell it
sooner and worse. Of more, and of a longer time, a change of the share is noticed later, and pictures add up that a
tracker's noise alone has called quick."""
_LEAST_SHARE, _MOST_SHARE = 0.1, 0.9
"""Beyond which nothing is undone. With less than the least, motion is seen late by a tenth of a picture, 4 ms; with
more than the most, undoing would amplify noise more than fourfold, and pictures are nearly still."""
_SPREAD, _LAW = 0.04, 0.025
"""Median difference of the likenesses to the last picture from their own, and of the three from s, s² and s³, up to which
it is a share. In gestures of the study .01 to .02 and .01, over a half space .02 and .02; a sweep of 20 mm/s without
averaging would differ from any share by .04. More takes speckle that changes for a share, less never believes one."""
_LEFT, _ERRS = 0.02, 0.0055
"""By which the likeness to the last picture may be wrong by what tissue that gives way has left there, half a cell away,
and by which the median of a dozen likenesses errs. What a share is told by is weighed with both: from .46 for .5 over a
half space of 20 mm to within .01 of it, and at .3 it errs by .013 instead of .006."""
_SAME = 0.03
"""By which a share must differ from the one in force to take its place: twice what a median of the fewest errs by in
the study. Each change begins the evidence anew."""
_OPPOSITE, _OFTEN = -0.05, 5
"""Likeness below which nothing of the last picture can be left, and pictures that must show it. Without averaging it
falls to −.12 to −.2 in every session of the study and five were below −.05 within .2 to 6 s, but for a mere hold; with
a share of .15 the least of 895 was −.057, of .2 −.009, of .3 .083."""
_OPPOSED, _KNOWN = 300, 7200
"""Pictures for which that forbids to believe a share, and for which it says that there is none: 10 s and four minutes.
An operator may have changed the share since. The second is longer than a probe that is held still stays verified."""
_PARTED = 0.9
"""Of the negative likeness that undoing gives a picture in which nothing of the last is left, from which on it is taken
for such a one. Less takes speckle for it that has gone by half a cell (−.24 at s = .3 in the study), more never does."""


class FrameAveraging:
    """Takes every picture that does not repeat the one before; what it holds of the scanner outlives a loss of sight.

    share: of the last picture in the next, 0 while none is believed.
    """

    def __init__(self) -> None:
        self.share = 0.0
        self._pictures = 0
        self._quick: deque[tuple[int, NDArray[np.float64]]] = deque(maxlen=_MOST)
        self._opposite: deque[int] = deque(maxlen=_OFTEN)
        self._none: int | None = None
        self._mask: Bits | None = None
        self._spots: Bits | None = None
        self.restart()

    def restart(self) -> None:
        """What comes has nothing in common with what came; the share stays."""
        self._last: GreyImage | None = None
        self._sequence = self._repeated = 0
        self._slopes: deque[Array32] = deque(maxlen=1 + _BACK)

    @property
    def known(self) -> bool:
        """Whether a share is believed, or pictures have shown that there is none."""
        told = self._none is not None and self._pictures - self._none < _KNOWN
        return self.share > 0 or told or self._shown_none(_KNOWN)

    def repeat(self) -> None:
        """The grabber has handed on the latest picture once more: the scanner has averaged nothing."""
        self._repeated += 1

    def step(self, image: GreyImage, sequence: int, mask: Bits | None, quick: bool) -> tuple[GreyImage, bool]:
        """Take the next picture, (h, w) uint8. Returns it without what is left of those before, and whether the share
        has changed, so that it is another picture than it would have been.

        mask: (h, w) bool, True where tissue may be seen; None while it is not known, when no share is told. quick:
        whether all that is seen has gone on from where it was in the picture before, by more than its speckle is long.
        """
        since = 1 if self._last is None else max(sequence - self._sequence - self._repeated, 1)
        before, self._last, self._sequence, self._repeated = self._last, image, sequence, 0
        self._pictures += 1
        if since > 1 or mask is None:
            self._slopes.clear()
        if mask is not None:
            self._slopes.append(self._slope(image, mask))
        alike, contrast = self._compared()
        changed = self._learn(alike, quick)
        if before is None or not self.share or self._parted(alike, contrast):
            return image, changed
        left = self.share**since
        return np.asarray(cv2.addWeighted(image, 1 / (1 - left), before, -left / (1 - left), 0), np.uint8), changed

    def _slope(self, image: GreyImage, mask: Bits) -> Array32:
        """Down the picture, here and there, where tissue may be seen: brightness and shades are alike in all pictures,
        and speckle changes fastest along the beam."""
        pitch = max(round((image.size / _SPOTS) ** 0.5), 2)
        above, below = image[:-1:pitch, ::pitch], image[1::pitch, ::pitch]
        if self._mask is not mask or self._spots is None:
            self._mask, self._spots = mask, mask[:-1:pitch, ::pitch] & mask[1::pitch, ::pitch]
        slope = cv2.subtract(below, above, mask=self._spots.view(np.uint8), dtype=cv2.CV_32F)
        return np.asarray(slope, np.float32).ravel()

    def _compared(self) -> tuple[NDArray[np.float64], float]:
        """(0 … 3,) correlations of the latest slopes with those before, the last first, and how much stronger the last
        are than the latest; nothing where a picture is flat."""
        sizes = [float(np.sqrt(slope @ slope)) for slope in self._slopes]
        if len(sizes) < 2 or min(sizes) <= 0:
            return np.empty(0), 1.0
        *before, now = self._slopes
        ends = zip(before[::-1], sizes[-2::-1], strict=True)
        return np.array([float(now @ slope) / (sizes[-1] * size) for slope, size in ends]), sizes[-2] / sizes[-1]

    def _learn(self, alike: NDArray[np.float64], quick: bool) -> bool:
        """Take what the latest picture has in common with those before it. True where another share is believed."""
        if alike.size and alike[0] < _OPPOSITE:
            self._opposite.append(self._pictures)
        if not quick or alike.size < _BACK:
            return False
        self._quick.append((self._pictures, alike))
        recent = [alike for picture, alike in self._quick if self._pictures - picture < _WITHIN]
        told = _told(np.array(recent)) if len(recent) >= _FEWEST else None
        self._none = self._pictures if told == 0 else self._none
        if told is None or abs(told - self.share) <= _SAME or (told > 0 and self._shown_none(_OPPOSED)):
            return False
        self.share = told
        return True

    def _shown_none(self, pictures: int) -> bool:
        """Whether so many of the latest pictures say that nothing of the last is left in the next."""
        return len(self._opposite) == _OFTEN and self._pictures - self._opposite[0] < pictures

    def _parted(self, alike: NDArray[np.float64], contrast: float) -> bool:
        """Whether nothing of the last picture is left in the latest, as where the grabber has mirrored it."""
        if not alike.size:
            return False
        left = self.share * contrast
        fresh = (alike[0] - left) / max(1 - 2 * left * alike[0] + left**2, 1e-9) ** 0.5
        return bool(fresh < -_PARTED * left / (1 + left**2) ** 0.5)


def _told(alike: NDArray[np.float64]) -> float | None:
    """The share that these likenesses tell, (n, 3), 0 for none; None where they tell nothing."""
    first, second, third = np.median(alike, axis=0)
    if np.median(np.abs(alike[:, 0] - first)) > _SPREAD:
        return None
    if first < _LEAST_SHARE:
        return 0.0
    told = np.array([first, second / first, third / second]) if second > 0 else np.full(3, first)
    weights = np.array([_LEFT**-2, (first / _ERRS) ** 2, (second / _ERRS) ** 2])
    share = float(told @ weights / weights.sum())
    lawful = np.max(np.abs(np.array([first, second, third]) - share ** np.arange(1, 1 + _BACK))) <= _LAW
    return share if lawful and share <= _MOST_SHARE else None
