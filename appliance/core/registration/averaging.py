"""Undoes what a scanner averages that leaves a share s of the last picture in the next: q_n = s q_(n-1) + (1 − s) p_n.

What is left of the last picture stands where its tissue was. Registration is drawn there, so that motion is seen late,
by s ÷ (1 − s) pictures, and, where the speckle changes, too short. The share shows where the probe moves quickly: p_n
has nothing in common with the pictures before it, place by place, and whatever q_n has in common with them is what the
scanner left: s of the last, s² of the one before that, s³ of the next. No motion of tissue does that each time alike.

That there is no share shows in any motion. Slopes of speckle that has gone on by half a cell are opposite to what they
were, where something of the last picture is left they are not.
"""

from collections import deque

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.registration.pyramid import Array32, Bits
from probewatch.drivers.samples import GreyImage

_SPOTS = 12_000
"""Places at which pictures are compared. A likeness then errs by .015 (study, gesture, 400 × 300 px); time grows with
them."""
_BACK = 3
"""Pictures with which each is compared, for s, s² and s³. Not varied."""
_FEWEST, _MOST, _WITHIN = 12, 20, 60
"""Quick pictures by whose median a share is found, at least and at most, and among how many pictures. Fewer find it
sooner and worse. Of more, and of a longer time, a change of the share is noticed later, and pictures add up that a
tracker's noise alone has called quick: with .5 mm and 120 pictures .77 was found for .7 in a sweep. Another share than
the one in force needs as many as there may be."""
_LEAST_SHARE, _MOST_SHARE = 0.1, 0.9
"""Beyond which nothing is undone. With less than the least, motion is seen late by a tenth of a picture, 4 ms; with
more than the most, undoing would amplify noise more than fourfold, and pictures are nearly still."""
_SPREAD, _LAW, _NEW = 0.04, 0.015, (0.8, 1.08)
"""Median difference of the likenesses to the last picture from their own; of the third likeness from what the first two
tell; and of s, s² and s³ what is left in them by noise that is new in each picture, as a coder's: up to which it is a
share. In gestures of the study .01 to .02, .005 and .97 to 1.03, behind a JPEG of quality 40 .84. More takes speckle
that changes for a share: a sweep of 20 mm/s without averaging comes to 1.2; less never believes one."""
_DEPTHS, _EVERYWHERE = 4, 0.06
"""Bands of depth, and by how much the median likeness of one may differ from that of all: a scanner averages all of a
picture alike. In rigid tissue .01, .03 where a part of the face is off the skin; over tissue that follows a press .07
to .3, as what goes along with the face is no quicker for a quick hand."""
_FAINT = 0.02
"""Largest share of the strength of all slopes in a band that says nothing: one as dark as that holds the rounding of
greys. Not measured."""
_SAME = 0.1
"""Share of the last picture that a share found now would leave where the one in force was undone, from which on it
takes its place: five times what a dozen pictures err by in the study. Each change begins the evidence anew; less does
so for nothing."""
_LOOKED_AT = 0.4
"""Likeness from which on nothing can be opposite at any depth. Less misses soft tissue that deep down alone is
opposite, more costs a twentieth of a millisecond more often. Not measured."""
_OPPOSITE, _OFTEN = (-0.05, -0.1), 5
"""Likeness below which nothing of the last picture can be left, of all of it and of a band of depth, and pictures that
must show it. Without averaging it falls to −.12 to −.2 in every session of the study and five were below −.05 within .2
to 6 s, but for a mere hold; with a share of .15 the least of 895 was −.057, of .2 −.009, of .3 .083."""
_OPPOSED, _KNOWN = 300, 7200
"""Pictures for which that forbids to believe a share, and for which it says that there is none: 10 s and four minutes.
An operator may have changed the share since. The second is longer than a probe that is held still stays verified."""
_PARTED = 0.9
"""Share of the negative likeness that undoing gives a picture in which nothing of the last is left, from which on it is
taken for such a one. Less takes speckle for it that has gone by half a cell (−.24 at .3 in the study), more never
does."""
_NOTHING = 1e-9
"""Keeps what is equal from dividing by zero."""


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
        self._doubted = False
        self._mask: Bits | None = None
        self._spots: Bits | None = None
        self.restart()

    def restart(self) -> None:
        """What comes has nothing in common with what came; the share stays."""
        self._last: GreyImage | None = None
        self._sequence = self._repeated = self._in_row = 0
        self._slopes: deque[Array32] = deque(maxlen=1 + _BACK)

    @property
    def known(self) -> bool:
        """Whether a share is believed, or pictures have shown that there is none."""
        found = self._none is not None and self._pictures - self._none < _KNOWN
        return self.share > 0 or found or self._shown_none(_KNOWN)

    @property
    def none(self) -> bool:
        """Whether pictures have shown that there is no share."""
        return self.known and self.share == 0

    def repeat(self) -> None:
        """The grabber has handed on the latest picture once more: the scanner has averaged nothing."""
        self._repeated += 1

    def step(self, image: GreyImage, sequence: int, mask: Bits | None, quick: bool) -> tuple[GreyImage, bool]:
        """Take the next picture, (h, w) uint8. Returns it without what is left of those before, and whether the share
        has changed, so that it is another picture than it would have been.

        mask: (h, w) bool, True where tissue may be seen; None while it is not known, when no share is found. quick:
        whether all that is seen has gone on from where it was in the picture before, by more than its speckle is long.
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
        """Down the picture, here and there, where tissue may be seen: brightness and shades are alike in all pictures,
        and speckle changes fastest along the beam."""
        pitch = max(round((image.size / _SPOTS) ** 0.5), 2)
        above, below = image[:-1:pitch, ::pitch], image[1::pitch, ::pitch]
        if self._mask is not mask or self._spots is None:
            self._mask, self._spots = mask, mask[:-1:pitch, ::pitch] & mask[1::pitch, ::pitch]
        slope = cv2.subtract(below, above, mask=self._spots.view(np.uint8), dtype=cv2.CV_32F)
        return np.asarray(slope, np.float32)

    def _compared(self) -> tuple[NDArray[np.float64], float]:
        """(0 … 3,) correlations of the latest slopes with those before, the last first, and how much stronger the last
        are than the latest; nothing where a picture is flat."""
        sizes = [float(np.linalg.norm(slope)) for slope in self._slopes]
        if len(sizes) < 2 or min(sizes) <= 0:
            return np.empty(0), 1.0
        *before, now = self._slopes
        ends = zip(before[::-1], sizes[-2::-1], strict=True)
        return np.array([np.vdot(now, slope) / (sizes[-1] * size) for slope, size in ends]), sizes[-2] / sizes[-1]

    def _by_depth(self) -> NDArray[np.float64]:
        """(4,) correlations of the latest slopes with the last at so many depths; NaN where there is next to none."""
        now, before = (np.array_split(self._slopes[k], _DEPTHS) for k in (-1, -2))
        sizes = [float(np.linalg.norm(a)) * float(np.linalg.norm(b)) for a, b in zip(now, before, strict=True)]
        pairs = zip(now, before, sizes, strict=True)
        return np.array([np.vdot(a, b) / size if size > _FAINT * sum(sizes) else np.nan for a, b, size in pairs])

    def _learn(self, alike: NDArray[np.float64], quick: bool) -> bool:
        """Take what the latest picture has in common with those before it. True where another share is believed."""
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
        """Whether it takes the place of the share in force: at once where there is none, else once twenty pictures say
        so that have nothing of the time before."""
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
        """Whether so many of the latest pictures say that nothing of the last is left in the next."""
        return len(self._opposite) == _OFTEN and self._pictures - self._opposite[0] < pictures


def _parted(alike: float, left: float) -> bool:
    """Whether nothing of the last picture is left in the latest, as where the grabber has mirrored it. alike: of the
    two. left: what should be, ÷ contrast of the latest.
    """
    fresh = (alike - left) / max(1 - 2 * left * alike + left**2, _NOTHING) ** 0.5
    return bool(fresh < -_PARTED * left / (1 + left**2) ** 0.5)


def _share_of(alike: NDArray[np.float64]) -> float | None:
    """The share that these likenesses show, (n, 3 and 4), 0 for none; None where they show nothing."""
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
