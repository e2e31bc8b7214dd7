"""Finds what was done to a picture: mirrored, magnified about any place, stretched along its axes, turned or sheared.

Tissue is the proof: a change is found where the earlier picture, changed in this way, is like the later one, and the
unchanged one is not, wherever it may have gone.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np

from probewatch.appliance.core.detectors.picture_link import DARK, contrast_of, parts_shown
from probewatch.appliance.core.detectors.polarity import POLARITIES
from probewatch.appliance.core.detectors.stretch import lines_between, seen_in_both, stretch_between, warped
from probewatch.appliance.core.registration.pyramid import Array32
from probewatch.drivers.rigid import Array

_LEAST_LIKENESS, _BETTER_BY = 0.55, 0.25
"""Least correlation of the changed picture, and by how much it must exceed that of the unchanged one, wherever a fast
hand took it. Less explains a new scene as a flip or zoom; more misses those with an overlay. In a prototype, not here,
a mirrored picture came to .92 where the unchanged one had .02."""
LEAST_STRETCH, _STRETCH_BETTER_BY = 0.035, 0.15
"""Least difference from 1 of the magnification along an axis, and how much more like the later picture the stretched
one must be than the unchanged one."""
_EXPLAINED = 0.4
"""Share of what is not alike that a stretch must explain to be likely. In a window of 19 by 21 mm, with the probe held,
lateral stretches by 4 to 6 % explained .58 to .95 (seeds 1 to 6). Less voids what was shown at more breaks of the
chain, more misses stretches."""
_ACROSS, _CALM, _AS_ALIKE = 0.3, 0.85, 0.03
"""Ratio of the stretch across to that down, below which a sliding organ may be the cause; likeness of the earlier
pictures to one another, above which nothing slid; and by how much the picture may be less alike than these once the
stretch is undone. Over organs that breathe by 8 mm along the beam, in pictures of 32 by 21 and 26 by 13 mm, false
stretches had ratios of 0 to .1, and either left the pictures less alike by .2 and more, or came after likenesses of .3
to .8 (study, gesture-hold, organ-8-axial, seeds 1 to 3). A larger ratio or likeness leaves real changes of depth
unnamed, a smaller one names what organs do."""
_STARTS = tuple((across, down) for across in (1.0, 0.92, 1.08) for down in (1.0, 0.92, 1.08))
"""Magnifications about which a stretch is searched for: each finds those within 8 %, so all together 16 %."""
_TURNS_RAD = tuple(float(turn) for turn in np.deg2rad([0.0, 9.0, -9.0, 18.0, -18.0]))
"""Turns, rad, about which turned lines are searched for: each finds those within about 5°, all together those up to
22°. More cost time, 3 ms each; a picture that was turned by more is mostly like nothing that was there before."""
_SLACK_PX = 3
"""Distance, px of the small picture, by which the hand may go elsewhere than it went last: 12 px of 640. More admits
more matches by chance."""
_MOST_ZOOM, _COARSE_STEP, _FINE_STEP = 2.2, 0.03, 0.015
"""Largest magnification that is tried, up and down, and steps of its logarithm: first in pictures of half the size,
where 3 % move the side of what is searched for by half a px, then about the best. Scanners step their depth by a fifth
to a half, and zoom by 2. More costs time, and what is left in the picture shows less."""
_SEARCHED_PARTS = 7
"""Number of the 24 parts that must show something in both pictures: more than one row. With fewer, as with wires in
water and the bright rows of a probe in air, any few other lines look like them mirrored and zoomed (recording
NwirePhantomFreehand)."""
_LEAST_ZOOM = 0.02
"""Difference from 1 up to which a magnification is not a new setting."""
_LEAST_GREY = 1.0
"""Least standard deviation, grey levels, of what is searched for: black with faint noise has less, dim tissue 5 and
more."""
_BEST = 3
"""Number of candidates of the coarse search that are tried again: among neighbouring ones the best is mostly the
first."""
_FLIPS = {(-1, 1): 1, (1, -1): 0, (-1, -1): -1}
"""Argument of `cv2.flip` for each polarity other than the reference's."""


@dataclass(frozen=True, slots=True)
class PictureChange:
    """Represents what happened to the picture: polarity ±1 and magnification, each (lateral, axial). A change that has
    neither is unnamed: it is not known how the picture has changed.
    """

    polarity: tuple[int, int] = (1, 1)
    zoom: tuple[float, float] = (1.0, 1.0)


@dataclass(frozen=True, slots=True)
class Stretched:
    """Holds the stretch after which the expected picture is most like the one seen. zoom: that of each axis. alike,
    plain: likeness with the stretch and without it.
    """

    zoom: tuple[float, float]
    alike: float
    plain: float

    @property
    def certain(self) -> bool:
        """Returns whether the likeness proves the stretch: a shift alone comes nowhere near."""
        return self.alike > max(self.plain + _STRETCH_BETTER_BY, _LEAST_LIKENESS)

    @property
    def likely(self) -> bool:
        """Returns whether the stretch explains a good part of the unlikeness. Layers that are stretched along
        themselves remain much alike, so that `certain` cannot tell.
        """
        return self.alike > max(self.plain + _EXPLAINED * (1 - self.plain), _LEAST_LIKENESS)

    def change_beyond(self, least: float, pressed: float, calm: float) -> PictureChange | None:
        """Returns the change for this stretch. It is unnamed where the stretch is not certain, or an organ or the press
        of the face may be its cause; None where the stretch is not likely, or is not certain and small.

        least: change of the logarithm of an axis that counts. pressed: what the press adds to it. calm: least likeness
        of the earlier pictures to one another.
        """
        beyond = float(np.max(np.abs(np.log(self.zoom)))) > least + pressed
        if self.certain:
            return PictureChange(zoom=self.zoom) if beyond and self._is_the_scanners(calm) else PictureChange()
        return PictureChange() if self.likely and beyond else None

    def _is_the_scanners(self, calm: float) -> bool:
        """Returns whether no organ that slides along the beam is the cause: such an organ stretches the picture only
        down, not across, and leaves the pictures before it less alike.
        """
        across, down = np.abs(np.log(self.zoom))
        return bool(across > _ACROSS * down or (calm > _CALM and self.alike > calm - _AS_ALIKE))


def closest_stretch(
    expected: Array32,
    now: Array32,
    aspect: float,
    least: float = LEAST_STRETCH,
    starts: Sequence[tuple[float, float]] = _STARTS,
) -> Stretched | None:
    """Returns the stretch by `least` and more that makes what was expected most like what is there; None where none is
    found.

    expected, now: small pictures of one size. aspect: λ_axial ÷ λ_lateral. least: difference from 1 of the
    magnification of an axis. starts: magnifications about which the stretch is searched for, 2 ms each.
    """
    expected, now = seen_in_both(expected, now)
    best = None
    for start in starts:
        found = stretch_between(expected, now, aspect, start)
        if found is None or np.all(np.abs(found.magnification - 1) < least):
            continue
        alike = likeness(warped(expected, found.warp), now)
        if best is None or alike > best[0]:
            best = alike, (float(found.magnification[0]), float(found.magnification[1]))
    return None if best is None else Stretched(best[1], best[0], likeness(expected, now))


def stretch_of(expected: Array32, now: Array32, aspect: float) -> PictureChange | None:
    """Returns the stretch that makes what was expected like what is there; None where none does, or a shift does nearly
    as well.

    The parameters are those of `closest_stretch`.
    """
    found = closest_stretch(expected, now, aspect)
    return PictureChange(zoom=found.zoom) if found is not None and found.certain else None


def lines_turned_by(expected: Array32, now: Array32, aspect: float, *, far: bool) -> Array | None:
    """Returns the turns, (2,) rad as in `Lines`, that make what was expected like what is there; None where none do, or
    a shift does nearly as well.

    expected, now: small pictures of one size. aspect: λ_axial ÷ λ_lateral. far: whether to search for turns of more
    than about 5° as well.
    """
    best, turned = max(likeness(expected, now) + _STRETCH_BETTER_BY, _LEAST_LIKENESS), None
    for start_rad in _TURNS_RAD if far else _TURNS_RAD[:1]:
        found = lines_between(expected, now, aspect, start_rad)
        alike = 0.0 if found is None else likeness(warped(expected, found.warp), now)
        if found is not None and alike > best:
            best, turned = alike, found.turned_rad
    return turned


def shift_of(before: Array32, now: Array32, expected: Array32) -> Array | None:
    """Returns by how far, (2,) px across and down, the middle of the earlier picture has moved; None where it is found
    nowhere, or nearly as well where it was expected.

    The pictures are small ones of one size. expected: the earlier picture, moved.
    """
    rows, columns = before.shape[0] // 3, before.shape[1] // 3
    middle = before[rows : before.shape[0] - rows, columns : before.shape[1] - columns]
    if contrast_of(middle) < _LEAST_GREY:
        return None
    _, best, _, (column, row) = cv2.minMaxLoc(cv2.matchTemplate(now, middle, cv2.TM_CCOEFF_NORMED))
    if best <= max(likeness(expected, now) + _STRETCH_BETTER_BY, _LEAST_LIKENESS):
        return None
    return np.array([column - columns, row - rows], float)


def searchable(before: Array32, now: Array32) -> bool:
    """Returns whether two small pictures show so much that a flip or a zoom of one is not like the other by chance."""
    return min(parts_shown(before), parts_shown(now)) >= _SEARCHED_PARTS


def flip_or_zoom_of(expected: Array32, now: Array32) -> PictureChange | None:
    """Returns the flip, the magnification about any place, or both, that make the earlier picture like this one; None
    where none do, or the unchanged picture does nearly as well elsewhere.

    expected, now: small pictures of one size.
    """
    usual = _found(expected, now, PictureChange())
    if usual >= 1 - _BETTER_BY:
        return None
    coarse = [_halved(picture) for picture in (expected, now)]
    tried = sorted(_candidates(), key=lambda change: -_found(coarse[0], coarse[1], change))[:_BEST]
    fine = [near for change in tried for near in _near(change)]
    alike, change = max(((_found(expected, now, one), one) for one in fine), key=lambda pair: pair[0])
    return change if alike > max(usual + _BETTER_BY, _LEAST_LIKENESS) else None


def likeness(a: Array32, b: Array32) -> float:
    """Returns the correlation of the middle of a, where overlays are rare, with its place in b or a few px beside."""
    rows, columns = a.shape[0] // 10, a.shape[1] // 10
    slack_rows, slack_columns = min(_SLACK_PX, rows), min(_SLACK_PX, columns)
    middle = a[rows : a.shape[0] - rows, columns : a.shape[1] - columns]
    around = b[
        rows - slack_rows : b.shape[0] - rows + slack_rows,
        columns - slack_columns : b.shape[1] - columns + slack_columns,
    ]
    return _best_match(around, middle)


def _candidates() -> Iterator[PictureChange]:
    steps = np.arange(-np.log(_MOST_ZOOM), np.log(_MOST_ZOOM) + _COARSE_STEP, _COARSE_STEP)
    zooms = [1.0, *(float(zoom) for zoom in np.exp(steps) if abs(zoom - 1) > _LEAST_ZOOM)]
    for polarity, zoom in product(POLARITIES, zooms):
        if (polarity, zoom) != ((1, 1), 1.0):
            yield PictureChange(polarity, (zoom, zoom))


def _near(change: PictureChange) -> Iterator[PictureChange]:
    for step in (0.0, -_FINE_STEP, _FINE_STEP):
        zoom = change.zoom[0] * float(np.exp(step))
        if abs(zoom - 1) > _LEAST_ZOOM or (step == 0.0 and change.polarity != (1, 1)):
            yield PictureChange(change.polarity, (zoom, zoom))


def _found(before: Array32, now: Array32, change: PictureChange) -> float:
    """Returns the best correlation, anywhere, of the middle of one of the two pictures with the other one: the middle
    is that of the one that shows less.
    """
    mirrored = before if change.polarity == (1, 1) else cv2.flip(before, _FLIPS[change.polarity])
    zoom = change.zoom[0]
    if zoom > 1:
        return _best_match(np.asarray(mirrored, np.float32), _resized(_middle(now), 1 / zoom))
    return _best_match(now, _resized(_middle(np.asarray(mirrored, np.float32)), zoom))


def _middle(picture: Array32) -> Array32:
    rows, columns = picture.shape[0] // 4, picture.shape[1] // 4
    return picture[rows : picture.shape[0] - rows, columns : picture.shape[1] - columns]


def _resized(picture: Array32, share: float) -> Array32:
    if share == 1:
        return picture
    how = cv2.INTER_AREA if share < 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(picture, None, fx=share, fy=share, interpolation=how), np.float32)


def _halved(picture: Array32) -> Array32:
    return _resized(picture, 0.5)


def _best_match(around: Array32, template: Array32) -> float:
    """Returns the best correlation of the template with any place that shows enough, by `DARK`; 0 where there is
    nothing to compare.
    """
    contrast = contrast_of(template)
    if contrast < _LEAST_GREY:
        return 0.0
    likeness = cv2.matchTemplate(around, template, cv2.TM_CCOEFF_NORMED)
    return float(np.where(_contrast(around, template.shape) >= DARK * contrast, likeness, 0.0).max())


def _contrast(picture: Array32, shape: tuple[int, ...]) -> Array32:
    """Returns the standard deviation of every part of that shape; where it is 0, a correlation is of rounding only."""
    rows, columns = picture.shape[0] - shape[0] + 1, picture.shape[1] - shape[1] + 1
    size, corner = (shape[1], shape[0]), (0, 0)
    mean = cv2.boxFilter(picture, -1, size, anchor=corner, borderType=cv2.BORDER_CONSTANT)[:rows, :columns]
    square = cv2.sqrBoxFilter(picture, -1, size, anchor=corner, borderType=cv2.BORDER_CONSTANT)[:rows, :columns]
    return np.asarray(np.sqrt(np.maximum(square - mean**2, 0.0)), np.float32)
