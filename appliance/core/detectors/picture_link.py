"""Whether a picture shows the same tissue in the same geometry as an earlier one, though none lay between.

The tracker says where the tissue should be; the picture must have it there, as far as the limit of the offset beside,
and all over: a picture of which a half is another's, or that is magnified about one place, is alike in a part alone.
Speckle that a quick hand has changed is less alike, but all over.
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
"""Columns in which pictures are compared. More asks for a zoom that is nearer and costs time for each that is tried;
fewer leave too little speckle to distinguish a mirrored picture from another.
"""
_SHADE_PX = 5.0
"""Sigma of what counts as shade, px of the small picture: wider than its speckle. More lets a bright half match any."""
_AROUND_PX, _BLACK = 7, 5.0
"""A px of the small picture is black where the mean of a square of this side, px, about it is below so many grey
levels. Noise of ± 8 on black has a mean of 3 (of half a normal distribution). Less takes noise beside a picture for
tissue, more leaves out shadows. Not varied."""
_LEAST_GREY = 2.0
"""Standard deviation of a small picture, grey levels, from which it can be compared: noise of ± 4 on black has 1.5,
dim tissue 5 and more."""
_SPECKLE_PX, _LEAST_FINE_GREY = 1.0, 1.0
"""Sigma of what is no speckle, px of the small picture, and contrast of what is finer that is shown, grey levels. Wider
ones take layers that come and go for it, and narrower ones what an averaging scanner smears: see `_LEAST_DIP`."""
_LEAST_SIDE_PX = 32
"""Side of a small picture, px: less is no picture but a strip, whose parts are a few px."""
_GRID = (6, 4)
"""Parts across and down. Fewer smear a change over a whole part, more hold too few grains to compare."""
_PART_BESIDE_PX = 1
"""px beside the common shift at which a part may lie: a turn of 1° at the edge of the picture. More finds a part by
chance, less loses the edges of a picture that the hand has turned."""
_LEAST_PARTS = 6
"""Parts that show anything in both. Fewer let a corner speak for the picture, more ask for a full field."""
_LEAST_SHOWN = 2
"""Parts of a picture that must show something, so that it can be compared: wires in water are in three or four."""
_ALIKE, _LEAST_ALIKE = 0.4, 0.75
"""Correlation from which a part is alike, and share of such parts from which a picture is the earlier one as a whole.
1 mm out of the plane left .79 to .96 of the parts alike, 1.3 mm .67 to .88; a mirrored picture had .58 at most, one
magnified by 9 to 30 % .47, a torn one .55 (`probewatch study`, gesture-hold, gesture-mixed, gesture-elevational-20,
seed 1, every 25th picture), and in a recording of a liver, at which the thresholds were looked up as well, a mirrored
one .57, its third successor .93 and more. More voids what quick sweeps have shown, less takes another picture for
it."""
_MUCH_ALIKE, _LEAST_MUCH_ALIKE = 0.7, 0.6
"""The same where the rest of the picture is covered: what is left is much alike. A torn picture has .5. More voids what
was shown when a menu covers a third of the picture, less takes a torn one for whole."""
_LEAST_HURRIED, _MOST_OF_THEM, _LEAST_HALF = 0.5, 0.5, 0.35
"""Share of parts that are alike in a picture that a quick hand has changed, share of these that may be much alike, and
share in each half: of a torn picture one half is as it was, and the other another. 25 mm/s out of the plane with a turn
of 30°/s left .6 to .8 alike and a tenth of them much alike. Less follows a torn picture."""
_IN_PLACE_PX = 2.6
"""Distance, px, from the place at which the tissue should be, .5 mm of a picture of 32 mm. With .2 s between, 11 pairs
each of a sweep of 5 mm/s, a fan and an in-plane gesture (seed 1): of the same tissue 24 were alike as a whole, or all
over and in place; magnified by 9 to 30 % or mirrored none, stretched along one axis by 12 % ten, all but two of which
are reported as stretched. More takes chance for a place, less loses tissue that moves."""
DARK = 0.4
"""Contrast of a place ÷ that of what is looked for there, below which it shows nothing: shadow, or skin that the probe
has left. Less finds bands in the dark of a probe in air; more loses tissue behind a shadow."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A picture. small: (h, w). pose: (4, 4) sensor → tracker, mm, None where none was read."""

    t_ns: int
    small: Array32
    pose: Matrix4 | None


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """How a picture continues an earlier one. moved_px: (2,) px of the small picture by which its tissue has moved,
    beside_px: (2,) how far that is from where it should be. alike, much_alike: shares of the parts that show anything;
    least_half: of those alike, in that half of the picture, upper, lower, left or right, that has fewest.
    """

    moved_px: Array
    beside_px: Array
    alike: float
    much_alike: float
    least_half: float

    @property
    def whole(self) -> bool:
        """Whether it shows the same tissue in the same geometry all over."""
        return self.alike >= _LEAST_ALIKE

    @property
    def hurried(self) -> bool:
        """Whether it is less alike all over, as of a quick hand: half of a torn picture is as it was."""
        spread = self.least_half >= _LEAST_HALF and self.much_alike <= _MOST_OF_THEM * self.alike
        return not self.whole and self.alike >= _LEAST_HURRIED and spread

    @property
    def in_place(self) -> bool:
        """Whether the tissue is where it should be."""
        return float(np.max(np.abs(self.beside_px))) <= _IN_PLACE_PX

    @property
    def covered(self) -> bool:
        """Whether it does but for what covers it."""
        return not self.whole and self.much_alike >= _LEAST_MUCH_ALIKE


def small(image: GreyImage, mask: Bits | None = None) -> Array32:
    """(h, w) uint8 to about 160 columns, coarse enough that a zoom need not be exact, without broad shade and gain.

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
    """How many of the 24 parts of a small picture show anything; 0 for a picture that is but a strip."""
    if min(picture.shape) < _LEAST_SIDE_PX:
        return 0
    return int(np.count_nonzero(_deviations(picture) >= _LEAST_GREY))


def contrasts(picture: Array32) -> Array:
    """(24,) logarithm of the contrast of the speckle in each part of a small picture, NaN where it shows none."""
    fine = picture - cv2.GaussianBlur(picture, (0, 0), _SPECKLE_PX)
    levels = _deviations(fine)
    return np.where(levels >= _LEAST_FINE_GREY, np.log(np.maximum(levels, _LEAST_FINE_GREY)), np.nan)


def contrast_of(image: Array32) -> float:
    """Standard deviation of its grey levels, 0 of an empty one: as numpy's, in a tenth of the time."""
    return 0.0 if image.size == 0 else float(cv2.meanStdDev(image)[1].item())


def _deviations(picture: Array32) -> Array:
    """(24,) standard deviation of the grey levels in each part."""
    rows, columns = _edges(picture.shape)
    corners = (each[np.ix_(rows, columns)] for each in cv2.integral2(picture))
    sums, squares = (np.diff(np.diff(each, axis=0), axis=1) for each in corners)
    count = np.outer(np.diff(rows), np.diff(columns))
    return np.asarray(np.sqrt(np.maximum(squares / count - np.square(sums / count), 0.0)).ravel())


def comparable(picture: Array32) -> bool:
    """Whether a small picture holds anything to compare."""
    return parts_shown(picture) >= _LEAST_SHOWN


def link_between(before: Array32, now: Array32, moved_px: Array, slack_px: Array) -> Link | None:
    """Small pictures of one size; None where too little is seen in both to compare.

    moved_px: (2,) how far the tissue should have moved across and down since the earlier one; slack_px: (2,) how far
    beside it may lie.
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
    """Share, among the parts that show anything, of those that are so much alike; 1 where none shows anything."""
    shown = likenesses[np.isfinite(likenesses)]
    return float(np.mean(shown >= least)) if shown.size else 1.0


def _common_shift(before: Array32, now: Array32, moved: NDArray[np.int64], slack_px: Array) -> tuple[int, int]:
    """Column and row by which the middle of the picture has moved."""
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
    """Rows and columns at which the parts of such a picture begin and end."""
    across, down = _GRID
    return np.linspace(0, shape[0], down + 1).astype(int), np.linspace(0, shape[1], across + 1).astype(int)


def _part_likeness(before: Array32, now: Array32, part: tuple[slice, slice], shift: tuple[int, int]) -> float | None:
    """Best correlation of the part near where it has gone; None where that is outside, or either shows nothing."""
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
