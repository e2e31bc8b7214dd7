"""Decides whether a picture shows the same tissue in the same geometry as an earlier one, though none lay between.

The tracker says where the tissue should be; the picture must have it there, within the limit of the offset, and all
over: a picture half of which is another's, or that is magnified about one place, is alike in a part only. Speckle that
a quick hand has changed is less alike, but all over.
"""

from dataclasses import dataclass
from functools import cache
from itertools import pairwise, product

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.registration.pyramid import Array32, Bits
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import GreyImage, Matrix4

SMALL_PX = 160
"""Number of columns in which pictures are compared. More asks for a zoom that is nearer and costs time for each that is
tried; fewer leave too little speckle to distinguish a mirrored picture from another."""
_SHADE_PX = 5.0
"""Sigma, px of the small picture, of what counts as shade: wider than speckle. More lets a bright half match any."""
_AROUND_PX, _BLACK = 7, 5.0
"""Side, px, of a square about each pixel of the small picture, and mean grey level of the square below which the pixel
is black. Noise of ± 8 on black has a mean of 3 (that of half a normal distribution). Less takes noise beside a picture
for tissue, more leaves out shadows. Not varied."""
_LEAST_GREY = 2.0
"""Standard deviation, grey levels, from which a part of a small picture can be compared: noise of ± 4 on black has 1.5,
dim tissue 5 and more."""
_SPECKLE_PX, _LEAST_FINE_GREY = 1.0, 1.0
"""Sigma, px of the small picture, of what is too coarse for speckle, and contrast, grey levels, from which the finer
rest is shown. A wider sigma takes layers that come and go for speckle, and a narrower one what an averaging scanner
smears: see `_LEAST_DIP` in double_exposure.py."""
_LEAST_SIDE_PX = 32
"""Least side of a small picture, px: one with less is a strip and no picture, and its parts are a few px wide."""
_GRID = (6, 4)
"""Number of parts across and down. Fewer smear a change over a whole part, more hold too few grains to compare."""
_PART_BESIDE_PX = 1
"""Distance, px, from the common shift at which a part may lie: that of a turn of 1° at the edge of the picture. More
finds a part by chance, less loses the edges of a picture that the hand has turned."""
_LEAST_PARTS = 6
"""Fewest parts that must show anything in both pictures. Fewer let a corner decide for the picture, more ask for a full
field."""
_LEAST_SHOWN = 2
"""Fewest parts that must show something before a picture can be compared: wires in water are in three or four."""
_ALIKE, _LEAST_ALIKE = 0.4, 0.75
"""Correlation from which a part is alike, and share of such parts from which a picture as a whole is the earlier one.
1 mm out of the plane left .79 to .96 of the parts alike, 1.3 mm .67 to .88; a mirrored picture had .58 at most, one
magnified by 9 to 30 % .47, a torn one .55 (`probewatch study`, gesture-hold, gesture-mixed, gesture-elevational-20,
seed 1, every 25th picture). In a recording of a liver, which was consulted for the thresholds as well, a mirrored
picture had .57, and its third successor .93 and more. More voids what quick sweeps have shown, less takes another
picture for the earlier one."""
_MUCH_ALIKE, _LEAST_MUCH_ALIKE = 0.7, 0.6
"""Correlation from which a part is much alike, and share of such parts from which a picture is the earlier one though
its rest is covered. A torn picture has .5. More voids what was shown when a menu covers a third of the picture, less
takes a torn picture for whole."""
_LEAST_HURRIED, _MOST_OF_THEM, _LEAST_HALF = 0.5, 0.5, 0.35
"""Least share of parts that are alike in a picture that a quick hand has changed, largest share of these that may be
much alike, and least share alike in each half: one half of a torn picture is as it was, and the other shows another
picture. 25 mm/s out of the plane with a turn of 30°/s left .6 to .8 alike and a tenth of them much alike. Less follows
a torn picture."""
_IN_PLACE_PX = 2.6
"""Largest distance, px, from the place at which the tissue should be: .5 mm of a picture of 32 mm. It was measured on
11 pairs each of a sweep of 5 mm/s, a fan and an in-plane gesture, with .2 s between the two (seed 1). Of the pairs of
the same tissue 24 were alike as a whole, or all over and in place; of those magnified by 9 to 30 % or mirrored none; of
those stretched along one axis by 12 % ten, all but two of which are reported as stretched. More takes chance for a
place, less loses tissue that moves."""
DARK = 0.4
"""Contrast of a place ÷ that of what is searched for there, below which the place shows nothing: it is shadow, or skin
that the probe has left. Less finds bands in the dark of a probe in air; more loses tissue behind a shadow."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """Holds a picture and its pose. small: (h, w). pose: (4, 4) sensor → tracker, mm, None where none was read."""

    t_ns: int
    small: Array32
    pose: Matrix4 | None


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """Holds how a picture continues an earlier one.

    moved_px: (2,) px of the small picture by which its tissue has moved. beside_px: (2,) how far that is from where it
    should be. alike, much_alike: shares among the parts that show anything. least_half: share of parts alike in that
    half of the picture, upper, lower, left or right, that has fewest.
    """

    moved_px: Array
    beside_px: Array
    alike: float
    much_alike: float
    least_half: float

    @property
    def whole(self) -> bool:
        """Returns whether the picture shows the same tissue in the same geometry all over."""
        return self.alike >= _LEAST_ALIKE

    @property
    def hurried(self) -> bool:
        """Returns whether the picture is less alike all over, as in quick motion: half of a torn one is as it was."""
        spread = self.least_half >= _LEAST_HALF and self.much_alike <= _MOST_OF_THEM * self.alike
        return not self.whole and self.alike >= _LEAST_HURRIED and spread

    @property
    def in_place(self) -> bool:
        """Returns whether the tissue is where it should be."""
        return float(np.max(np.abs(self.beside_px))) <= _IN_PLACE_PX

    @property
    def covered(self) -> bool:
        """Returns whether the picture shows the same tissue in the same geometry except where something covers it."""
        return not self.whole and self.much_alike >= _LEAST_MUCH_ALIKE


def small(image: GreyImage, mask: Bits | None = None) -> Array32:
    """Returns a picture, (h, w) uint8, at about 160 columns, coarse enough that a zoom need not be exact, without broad
    shade and gain.

    mask: (h, w) bool, True where tissue may be seen; all else, and what is black, becomes 0 and adds no shade.
    """
    share = min(1.0, SMALL_PX / image.shape[1])
    size = (max(round(image.shape[1] * share), 1), max(round(image.shape[0] * share), 1))
    picture = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
    within = (cv2.blur(picture, (_AROUND_PX, _AROUND_PX)) >= _BLACK).astype(np.float32)
    if mask is not None:
        within *= cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    shade = cv2.GaussianBlur(picture * within, (0, 0), _SHADE_PX) / (cv2.GaussianBlur(within, (0, 0), _SHADE_PX) + 1e-6)
    return np.asarray((picture - shade) * within, dtype=np.float32)


def parts_shown(picture: Array32) -> int:
    """Returns how many of the 24 parts of a small picture show anything; 0 for a picture that is only a strip."""
    if min(picture.shape) < _LEAST_SIDE_PX:
        return 0
    return int(np.count_nonzero(_deviations(picture) >= _LEAST_GREY))


def contrasts(picture: Array32) -> Array:
    """Returns the logarithm, (24,), of the contrast of the speckle in each part of a small picture, NaN where there is
    no speckle to see, by `_LEAST_FINE_GREY`.
    """
    fine = picture - cv2.GaussianBlur(picture, (0, 0), _SPECKLE_PX)
    levels = _deviations(fine)
    return np.where(levels >= _LEAST_FINE_GREY, np.log(np.maximum(levels, _LEAST_FINE_GREY)), np.nan)


def contrast_of(image: Array32) -> float:
    """Returns the standard deviation of the grey levels, 0 if there are none: as numpy does, in a tenth of the time."""
    return 0.0 if image.size == 0 else float(cv2.meanStdDev(image)[1].item())


def _deviations(picture: Array32) -> Array:
    """Returns the standard deviation, (24,), of the grey levels in each part."""
    # Differences of the integral image at the corners of the parts are the sums over the parts.
    rows, columns = _edges(picture.shape)
    corners = (each[np.ix_(rows, columns)] for each in cv2.integral2(picture))
    sums, squares = (np.diff(np.diff(each, axis=0), axis=1) for each in corners)
    count = np.outer(np.diff(rows), np.diff(columns))
    return np.asarray(np.sqrt(np.maximum(squares / count - np.square(sums / count), 0.0)).ravel())


def comparable(picture: Array32) -> bool:
    """Returns whether a small picture holds anything to compare."""
    return parts_shown(picture) >= _LEAST_SHOWN


def link_between(before: Array32, now: Array32, moved_px: Array, slack_px: Array) -> Link | None:
    """Returns how one small picture continues another of its size; None where too little is seen in both to compare.

    moved_px: (2,) how far the tissue should have moved across and down since the earlier one. slack_px: (2,) how far
    from there it may lie.
    """
    column, row = _common_shift(before, now, np.round(moved_px).astype(int), slack_px)
    parts = [_part_likeness(before, now, part, (column, row)) for part in _parts(before.shape)]
    likenesses = np.array([np.nan if one is None else one for one in parts]).reshape(_GRID[::-1])
    if np.count_nonzero(np.isfinite(likenesses)) < _LEAST_PARTS:
        return None
    alike, much_alike = (_share(likenesses, least) for least in (_ALIKE, _MUCH_ALIKE))
    rows, columns = _GRID[1] // 2, _GRID[0] // 2
    halves = likenesses[:rows], likenesses[rows:], likenesses[:, :columns], likenesses[:, columns:]
    moved = np.array([column, row], float)
    return Link(moved, moved - moved_px, alike, much_alike, min(_share(half, _ALIKE) for half in halves))


def _share(likenesses: Array, least: float) -> float:
    """Returns the share, among the parts that show anything, with a likeness of `least` and more; 1 where none do."""
    shown = likenesses[np.isfinite(likenesses)]
    return float(np.mean(shown >= least)) if shown.size else 1.0


def _common_shift(before: Array32, now: Array32, moved: NDArray[np.int64], slack_px: Array) -> tuple[int, int]:
    """Returns column and row by which the middle of the picture has moved; `moved` where it cannot be searched for."""
    height, width = before.shape
    rows, columns = height // 4, width // 4
    middle = before[rows : height - rows, columns : width - columns]
    reach = np.round(slack_px).astype(int)
    left, top = np.maximum(np.array([columns, rows]) + moved - reach, 0)
    right, bottom = np.maximum(np.array([width - columns, height - rows]) + moved + reach, 0)
    around = now[top:bottom, left:right]
    if around.shape[0] < middle.shape[0] or around.shape[1] < middle.shape[1] or middle.std() == 0:
        return int(moved[0]), int(moved[1])
    _, _, _, (column, row) = cv2.minMaxLoc(cv2.matchTemplate(around, middle, cv2.TM_CCOEFF_NORMED))
    return int(column + left - columns), int(row + top - rows)


def _parts(shape: tuple[int, ...]) -> list[tuple[slice, slice]]:
    rows, columns = ([slice(*ends) for ends in pairwise(edges.tolist())] for edges in _edges(shape))
    return list(product(rows, columns))


@cache
def _edges(shape: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns the rows and the columns at which the parts of a picture of this shape begin and end."""
    across, down = _GRID
    return np.linspace(0, shape[0], down + 1).astype(int), np.linspace(0, shape[1], across + 1).astype(int)


def _part_likeness(before: Array32, now: Array32, part: tuple[slice, slice], shift: tuple[int, int]) -> float | None:
    """Returns the best correlation of the part near the place to which it has gone; None where that is outside the
    picture, or either of them shows nothing.
    """
    rows, columns = part
    top, left = (max(side.start + moved - _PART_BESIDE_PX, 0) for side, moved in zip(part, shift[::-1], strict=True))
    bottom, right = (side.stop + moved + _PART_BESIDE_PX for side, moved in zip(part, shift[::-1], strict=True))
    template, around = before[rows, columns], now[top : max(bottom, 0), left : max(right, 0)]
    if around.shape[0] < template.shape[0] or around.shape[1] < template.shape[1]:
        return None
    contrast = contrast_of(template)
    if contrast < _LEAST_GREY or contrast_of(around) < DARK * contrast:
        return None
    return float(cv2.matchTemplate(around, template, cv2.TM_CCOEFF_NORMED).max())
