"""Undoes the averaging of a scanner that leaves a share s of each picture in the next: q_n = s q_(n-1) + (1 − s) p_n.

What is left of the last picture stays where its tissue was. It attracts the registration, so that motion is seen late,
by s ÷ (1 − s) pictures, and, where the speckle changes, too short. The share shows when the probe moves quickly: p_n
then has nothing in common with the pictures before it, place by place, and whatever q_n has in common with them was
left by the scanner: s of the last, s² of the one before that, s³ of the next. No motion of tissue does that each time
alike.

Where there is no share, any motion shows it. Slopes of speckle that has moved by half a cell are opposite to what they
were; where something of the last picture is left, they are not.
"""

from collections import deque

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.registration.pyramid import Array32, Bits
from probewatch.drivers.samples import GreyImage

_SPOTS = 12_000
"""Places at which pictures are compared. A likeness then errs by .015 (study, gesture, 400 × 300 px); the time grows
with their number."""
_BACK = 3
"""Earlier pictures with which each is compared, for s, s² and s³. Not varied."""
_FEWEST, _MOST, _WITHIN = 12, 20, 60
"""Fewest and most quick pictures whose median gives a share, and the pictures among which they must be. Fewer find a
share sooner and less accurately. With more, and over a longer time, a change of the share is noticed later, and
pictures add up that only the noise of a tracker has called quick: with .5 mm and 120 pictures .77 was found for .7 in a
sweep. A share other than the one in force needs the most."""
_LEAST_SHARE, _MOST_SHARE = 0.1, 0.9
"""Bounds beyond which nothing is undone. Below the least, motion is seen late by a tenth of a picture, 4 ms; above the
most, undoing would amplify noise more than fourfold, and pictures are nearly still."""
_SPREAD, _LAW, _NEW = 0.04, 0.015, (0.8, 1.08)
"""Largest median difference of the likenesses to the last picture from their median; largest difference of the third
likeness from what the first two predict; and bounds of what noise that is new in each picture, as a codec's, leaves of
s, s² and s³: within all of them it is a share. Gestures of the study have .01 to .02, .005 and .97 to 1.03; behind a
JPEG of quality 40 the last is .84. Wider bounds take changing speckle for a share: a sweep of 20 mm/s without averaging
reaches 1.2; narrower ones never accept one."""
_DEPTHS, _EVERYWHERE = 4, 0.06
"""Bands of depth, and by how much the median likeness of one may differ from that of all: a scanner averages the whole
picture alike. It is .01 in rigid tissue, .03 where a part of the face is off the skin, and .07 to .3 over tissue that
follows a press, because what moves along with the face is no quicker for a quick hand."""
_FAINT = 0.02
"""Largest share of the strength of all slopes at which a band shows nothing: one as dark as that holds the rounding of
greys. Not measured."""
_SAME = 0.1
"""Share of the last picture that a newly found share would leave where the one in force was undone, from which it
replaces that one: five times the error of a dozen pictures in the study. Each change begins the evidence again; a lower
value does so for nothing."""
_LOOKED_AT = 0.4
"""Likeness from which the slopes can be opposite at no depth. A lower one misses soft tissue of which only the deep
part is opposite; a higher one costs a twentieth of a millisecond more often. Not measured."""
_OPPOSITE, _OFTEN = (-0.05, -0.1), 5
"""Likeness below which nothing of the last picture can be left, that of the whole picture and that of a band of depth,
and the pictures that must show it. Without averaging it falls to −.12 to −.2 in every session of the study, and five
pictures were below −.05 within .2 to 6 s, except in a mere hold; with a share of .15 the least of 895 was −.057, with
.2 −.009, with .3 .083."""
_OPPOSED, _KNOWN = 300, 7200
"""Pictures for which these forbid accepting a share, and for which they show that there is none: 10 s and four minutes.
An operator may have changed the share since. The second is longer than a probe that is held still stays verified."""
_PARTED = 0.9
"""Share of the negative likeness that undoing gives a picture in which nothing of the last is left, from which a
picture counts as such. A lower one counts speckle that has moved by half a cell (−.24 at .3 in the study); a higher one
never counts any."""
_NOTHING = 1e-9
"""Prevents a division by zero for equal pictures."""


class FrameAveraging:
    """Learns the share and takes what is left of earlier pictures off each new one.

    It takes every picture that does not repeat the one before; what it knows of the scanner outlives a loss of sight.
    share: that of the last picture in the next, 0 while none is accepted.
    """

    def __init__(self) -> None:
        self.share = 0.0
        self._pictures = 0
        self._quick: deque[tuple[int, NDArray[np.float64]]] = deque(maxlen=_MOST)
        self._opposite: deque[int] = deque(maxlen=_OFTEN)
        self._none: int | None = None
        self._doubted = False
        self._mask: Bits | None = None
        self._spots: Bits | None = None
        self.restart()

    def restart(self) -> None:
        """Forgets the last pictures, with which later ones have nothing in common, and keeps the share."""
        self._last: GreyImage | None = None
        self._sequence = self._repeated = self._in_row = 0
        self._slopes: deque[Array32] = deque(maxlen=1 + _BACK)

    @property
    def known(self) -> bool:
        """Returns whether a share is accepted, or pictures have shown that there is none."""
        found = self._none is not None and self._pictures - self._none < _KNOWN
        return self.share > 0 or found or self._shown_none(_KNOWN)

    @property
    def none(self) -> bool:
        """Returns whether pictures have shown that there is no share."""
        return self.known and self.share == 0

    def repeat(self) -> None:
        """Notes that the grabber has delivered the latest picture again, so that the scanner has averaged nothing."""
        self._repeated += 1

    def step(self, image: GreyImage, sequence: int, mask: Bits | None, quick: bool) -> tuple[GreyImage, bool]:
        """Takes the next picture, (h, w) uint8, and returns it without what is left of those before (equation 14b).

        Also returns whether the share has changed, so that the picture differs from what it would have been.
        mask: (h, w) bool, True where tissue may be seen; None while it is not known, when no share is found. quick:
        whether everything seen has moved since the picture before, by more than the length of its speckle.
        """
        since = 1 if self._last is None else max(sequence - self._sequence - self._repeated, 1)
        before, self._last, self._sequence, self._repeated = self._last, image, sequence, 0
        self._pictures += 1
        if mask is None:
            return image, False
        self._in_row = self._in_row + 1 if since == 1 else 0
        self._slopes.append(self._slope(image, mask))
        alike, contrast = self._compared()
        changed = self._in_row > 0 and self._learn(alike[: self._in_row], quick)
        left = self.share**since
        if before is None or not self.share or not alike.size or _parted(alike[0], left * contrast):
            return image, changed
        return np.asarray(cv2.addWeighted(image, 1 / (1 - left), before, -left / (1 - left), 0), np.uint8), changed

    def _slope(self, image: GreyImage, mask: Bits) -> Array32:
        """Returns the slopes down the picture at a grid of places where tissue may be seen.

        Brightness and shades are alike in all pictures, and speckle changes fastest along the beam.
        """
        pitch = max(round((image.size / _SPOTS) ** 0.5), 2)
        above, below = image[:-1:pitch, ::pitch], image[1::pitch, ::pitch]
        if self._mask is not mask or self._spots is None:
            self._mask, self._spots = mask, mask[:-1:pitch, ::pitch] & mask[1::pitch, ::pitch]
        slope = cv2.subtract(below, above, mask=self._spots.view(np.uint8), dtype=cv2.CV_32F)
        return np.asarray(slope, np.float32)

    def _compared(self) -> tuple[NDArray[np.float64], float]:
        """Returns correlations, (0 … 3,), of the latest slopes with those before, and a ratio of strengths.

        The correlation with the last picture comes first; there is none where a picture is flat. The ratio is the
        strength of the last slopes to that of the latest.
        """
        sizes = [float(np.linalg.norm(slope)) for slope in self._slopes]
        if len(sizes) < 2 or min(sizes) <= 0:
            return np.empty(0), 1.0
        *before, now = self._slopes
        ends = zip(before[::-1], sizes[-2::-1], strict=True)
        return np.array([np.vdot(now, slope) / (sizes[-1] * size) for slope, size in ends]), sizes[-2] / sizes[-1]

    def _by_depth(self) -> NDArray[np.float64]:
        """Returns correlations, (4,), of the latest slopes with the last by band of depth; NaN where they are faint."""
        now, before = (np.array_split(self._slopes[k], _DEPTHS) for k in (-1, -2))
        sizes = [float(np.linalg.norm(a)) * float(np.linalg.norm(b)) for a, b in zip(now, before, strict=True)]
        pairs = zip(now, before, sizes, strict=True)
        return np.array([np.vdot(a, b) / size if size > _FAINT * sum(sizes) else np.nan for a, b, size in pairs])

    def _learn(self, alike: NDArray[np.float64], quick: bool) -> bool:
        """Learns from what the latest picture has in common with those before; returns whether the share changed."""
        if not alike.size or not (quick or alike[0] < _LOOKED_AT):
            return False
        by_depth = self._by_depth()
        if alike[0] < _OPPOSITE[0] or np.nan_to_num(by_depth, nan=1.0).min() < _OPPOSITE[1]:
            self._opposite.append(self._pictures)
        if not quick or alike.size < _BACK:
            return False
        self._quick.append((self._pictures, np.concatenate([alike, by_depth])))
        recent = [alike for picture, alike in self._quick if self._pictures - picture < _WITHIN]
        enough = len(recent) >= (_MOST if self._doubted else _FEWEST)
        found = _share_of(np.array(recent)) if enough else None
        self._none = self._pictures if found == 0 else self._none
        return found is not None and self._believe(found)

    def _believe(self, found: float) -> bool:
        """Returns whether the found share replaces the one in force.

        It does so at once where there is none, otherwise once twenty quick pictures that are all new show it again.
        """
        differs = abs(found - self.share) > _SAME * (1 - found)
        if not differs or (found > 0 and self._shown_none(_OPPOSED)):
            self._doubted = self._doubted and differs
            return False
        if self.share > 0 and not self._doubted:
            self._doubted = True
            self._quick.clear()
            return False
        self.share, self._doubted = found, False
        return True

    def _shown_none(self, pictures: int) -> bool:
        """Returns whether enough of that many latest pictures show that nothing of the last is left in the next."""
        return len(self._opposite) == _OFTEN and self._pictures - self._opposite[0] < pictures


def _parted(alike: float, left: float) -> bool:
    """Returns whether nothing of the last picture is left in the latest, as where the grabber has mirrored it.

    alike: likeness of the two. left: what should be left of the last, ÷ contrast of the latest.
    """
    # The likeness to the last picture that the latest would have once what should be left is taken off.
    fresh = (alike - left) / max(1 - 2 * left * alike + left**2, _NOTHING) ** 0.5
    return bool(fresh < -_PARTED * left / (1 + left**2) ** 0.5)


def _share_of(alike: NDArray[np.float64]) -> float | None:
    """Returns the share that these likenesses, (n, 3 and 4), show by equation 14c, 0 for none.

    Returns None where they show nothing.
    """
    first, second, third, *by_depth = np.median(alike, axis=0)
    if np.median(np.abs(alike[:, 0] - first)) > _SPREAD:
        return None
    if first < _LEAST_SHARE:
        return 0.0
    if min(second, third) <= 0:
        return None
    share = float((second / first * first**2 + third / second * second**2) / (first**2 + second**2))
    new = first / share
    lawful = _NEW[0] <= new <= _NEW[1] and abs(third - new * share**3) <= _LAW
    alike_everywhere = np.nan_to_num(np.abs(np.subtract(by_depth, first))).max() <= _EVERYWHERE
    return share if lawful and alike_everywhere and share <= _MOST_SHARE else None
