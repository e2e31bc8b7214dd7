"""Measures how much one picture is stretched against another along each axis, from how far its parts have moved.

A shift moves all parts alike, a turn moves each across its lever arm, and a stretch moves the parts apart, whatever
point it is about.
"""

from dataclasses import dataclass
from math import sqrt

import cv2
import numpy as np

from probewatch.appliance.core.registration.keyframe import warp_matrix
from probewatch.appliance.core.registration.pyramid import Array32
from probewatch.appliance.core.registration.realtime_tracker import Warp
from probewatch.drivers.rigid import Array

_SIDE_PX, _REACH_PX = 32, 10
"""Side of a part, and distance to which it is searched for, px of a picture of 160 columns. A stretch distorts a larger
part itself, and a smaller one resembles other places; at the edge a stretch by 12 % moves a part by 8 px, and the hand
moves it some more."""
_INSET_PX = 4
"""Distance, px, from the edge of the picture to the outer parts, so that they may move outwards. Further in they show
less of a stretch; nearer they are lost sooner, because what goes beyond the edge is found at the edge."""
_LEAST_SEEN = 0.3
"""Fewest pixels seen in a row or column that counts ÷ those seen in the fullest one. More narrows a fan to its middle,
less keeps rows and columns that hold next to nothing. Not varied."""
_EDGE = np.ones((3, 3), np.uint8)
"""Neighbours of a pixel that must be seen as well: a pixel at the border holds some of what lies beyond it."""
_GRID = (5, 4)
"""Number of parts across and down: at least four in each direction, so that enough remain beside text or shadow."""
_LEAST_ALIKE = 0.4
"""Least correlation of a part with the place where it is found. Less takes another place for it, more loses parts in
quick motion."""
_ASTRAY_PX, _LEAST_PARTS = 1.5, 9
"""Distance from the fit, px, from which a part has been mistaken for another, and fewest parts that must lie nearer:
less than half of the grid is one corner of the picture."""
_TURNS, _NEAR_PX = 8, 0.3
"""Number of rounds of reweighting, and distance from the fit, px, within which a part counts fully: the accuracy to
which the vertex of a peak is known."""
_RIGID = 3
"""Number of columns of the fit that are no stretch: a shift along two axes, and a turn."""
_LOOKS = 2
"""Number of looks, each at the picture stretched as found so far: the second finds parts that the first did not, and is
accurate to .2 %."""


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Holds how a picture is stretched against an earlier one.

    magnification: (2,) across and down. warp: (2, 3) from a place in the earlier picture to its place in this one.
    apart_px: by how much the stretch moves the parts, without shift and turn. gained_px: by how much less of their
    motion is left than shift and turn alone leave. Both are medians over the parts; for a stretch that the picture has
    they are alike, and for parts that slide along each other next to nothing is gained.
    """

    magnification: Array
    warp: Array
    apart_px: float
    gained_px: float


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Holds by how much the lines of a picture have turned against an earlier one.

    turned_rad: (2,) by which lines across and lines down have turned: in a picture that was turned both are equal but
    for the sign, in one that was sheared only one of them has turned. warp: (2, 3) from a place in the earlier picture
    to its place in this one.
    """

    turned_rad: Array
    warp: Array


def seen_in_both(before: Array32, now: Array32) -> tuple[Array32, Array32]:
    """Returns both pictures, cropped to the rows and columns in which both show tissue, without the border of the
    tissue, because border and surroundings are stationary on the screen and would hide a stretch. They are not cropped
    where that would leave less than two parts a side.
    """
    seen = cv2.erode(((before != 0) & (now != 0)).astype(np.uint8), _EDGE).astype(bool)
    before, now = before * seen, now * seen
    rows, columns = (
        np.flatnonzero(share > _LEAST_SEEN * share.max()) for share in (seen.mean(axis=1), seen.mean(axis=0))
    )
    if min(rows.size, columns.size) < 2 * _SIDE_PX:
        return before, now
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return before[box], now[box]


def stretch_between(before: Array32, now: Array32, aspect: float, start: tuple[float, float]) -> Stretch | None:
    """Returns the stretch between two pictures (h, w) of the same size; None where too few parts are found again.

    start: magnification about which the stretch is searched for, up to 8 % beside it. aspect: λ_axial ÷ λ_lateral.
    """
    middle = (np.array(before.shape[::-1]) - 1) / 2
    M = np.diag(start)
    warp = np.column_stack([M, middle - M @ middle])
    apart, first = np.zeros(2), None
    for _ in range(_LOOKS):
        places, moved = _parts(warped(before, warp), now)
        columns = _columns(places, aspect)
        found = _fitted_to_most(columns, moved)
        if found is None:
            return None
        fit, off_px = found
        # Pixels are not square, so that the aspect scales the turn, as in `_columns`.
        M = np.array([[1 + fit[3], -aspect * fit[2]], [fit[2] / aspect, 1 + fit[4]]])
        warp = M @ warp + np.column_stack([np.zeros((2, 2)), middle + fit[:2] - M @ middle])
        apart = apart + fit[3:]
        # The parts of the first look show what shift and turn alone leave of the motion.
        first = first or (columns[:, :, :_RIGID], moved)
    assert first is not None
    rigid_px = _fitted(*first)[1]
    magnification = np.hypot(warp[[0, 1], [0, 1]], warp[[1, 0], [0, 1]] * [aspect, 1 / aspect])
    apart_px = float(np.median(np.linalg.norm(places * apart, axis=1)))
    return Stretch(magnification, warp, apart_px, float(np.median(rigid_px) - np.median(off_px)))


def lines_turned(before: Array32, now: Array32, aspect: float) -> Array | None:
    """Returns the turns as in `Lines`, found in one look; None where too few parts are found again."""
    found = lines_between(before, now, aspect, 0.0, looks=1)
    return None if found is None else found.turned_rad


def lines_between(before: Array32, now: Array32, aspect: float, start_rad: float, looks: int = _LOOKS) -> Lines | None:
    """Returns how lines turned between two pictures (h, w) of the same size; None where too few parts are found again.

    start_rad: turn about which theirs is searched for, up to 6° beside it where the grains of the speckle are 1.5 px of
    320 wide (sigma), 9° where they are 2.5 px (eight drawn pictures each). aspect: λ_axial ÷ λ_lateral. looks: as for
    `_LOOKS`.
    """
    middle = (np.array(before.shape[::-1]) - 1) / 2
    M = warp_matrix(start_rad, aspect)
    warp = np.column_stack([M, middle - M @ middle])
    for _ in range(looks):
        places, moved = _parts(warped(before, warp), now)
        found = _fitted_to_most(_columns_of_lines(places), moved)
        if found is None:
            return None
        fit = found[0]
        M = np.eye(2) + fit[2:].reshape(2, 2)
        warp = M @ warp + np.column_stack([np.zeros((2, 2)), middle + fit[:2] - M @ middle])
    slopes = np.array([warp[1, 0] / warp[0, 0], warp[0, 1] / warp[1, 1]])
    return Lines(np.arctan(slopes * [aspect, 1 / aspect]), warp)


def warped(image: Array32, warp: Array) -> Array32:
    """Returns the image after the warp, (2, 3), from a place in the image to where it goes."""
    return np.asarray(cv2.warpAffine(image, warp, (image.shape[1], image.shape[0])), dtype=np.float32)


def carried(image: Array32, way: Warp, aspect: float) -> Array32:
    """Returns the picture after its tissue has moved by `way`, px and rad about its middle."""
    M = warp_matrix(way[1], aspect)
    middle = (np.array(image.shape[::-1]) - 1) / 2
    return warped(image, np.column_stack([M, middle + way[0] - M @ middle]))


def likeness_in_place(a: Array32, b: Array32) -> float:
    """Returns the correlation of the middle of a with the same place of b; 1 where there is nothing to compare."""
    rows, columns = a.shape[0] // 10, a.shape[1] // 10
    middle = np.s_[rows : a.shape[0] - rows, columns : a.shape[1] - columns]
    own, other = (image[middle].ravel() - image[middle].mean() for image in (a, b))
    power = float(own @ own) * float(other @ other)
    return float(own @ other) / sqrt(power) if power > 0 else 1.0


def _parts(before: Array32, now: Array32) -> tuple[Array, Array]:
    """Returns places in the earlier picture, (n, 2) px from its middle, and how far each has moved, (n, 2) px."""
    height, width = before.shape
    places, moved = list[list[float]](), list[list[float]]()
    for row in np.linspace(_INSET_PX, max(height - _SIDE_PX - _INSET_PX, _INSET_PX), _GRID[1]).astype(int):
        for column in np.linspace(_INSET_PX, max(width - _SIDE_PX - _INSET_PX, _INSET_PX), _GRID[0]).astype(int):
            part = before[row : row + _SIDE_PX, column : column + _SIDE_PX]
            top, left = max(row - _REACH_PX, 0), max(column - _REACH_PX, 0)
            around = now[top : row + _SIDE_PX + _REACH_PX, left : column + _SIDE_PX + _REACH_PX]
            found = _found(around, part)
            if found is not None:
                middle = (np.array(part.shape[::-1]) - 1) / 2 - [(width - 1) / 2, (height - 1) / 2]
                places.append([column + middle[0], row + middle[1]])
                moved.append([left + found[0] - column, top + found[1] - row])
    return np.array(places).reshape(-1, 2), np.array(moved).reshape(-1, 2)


def _found(around: Array32, part: Array32) -> tuple[float, float] | None:
    """Returns column and row at which the part lies in `around`, to a fraction of a px; None where it is not there, or
    is found at the edge, because then it may lie beyond.
    """
    if _is_even(part) or _is_even(around):
        return None
    likeness = np.asarray(cv2.matchTemplate(around, part, cv2.TM_CCOEFF_NORMED), np.float32)
    _, best, _, (column, row) = cv2.minMaxLoc(likeness)
    rows, columns = likeness.shape
    if best < _LEAST_ALIKE or not (0 < column < columns - 1 and 0 < row < rows - 1):
        return None
    return column + _vertex(likeness[row], column), row + _vertex(likeness[:, column], row)


def _is_even(image: Array32) -> bool:
    """Returns whether the whole image has one grey level."""
    darkest, brightest, _, _ = cv2.minMaxLoc(image)
    return darkest == brightest


def _vertex(values: Array32, peak: int) -> float:
    """Returns where a parabola through the peak, which is at neither end, and its neighbours is highest, −½ … ½."""
    below, at, above = (float(value) for value in values[peak - 1 : peak + 2])
    bend = 2 * at - below - above
    return 0.5 * (above - below) / bend if bend > 0 else 0.0


def _columns(places: Array, aspect: float) -> Array:
    """Returns how far, (n, 2, 5) px, a shift (2), a turn and a stretch (2) of 1 move each part."""
    x, y = places.T
    one, none = np.ones_like(x), np.zeros_like(x)
    across = np.stack([one, none, -aspect * y, x, none], axis=1)
    down = np.stack([none, one, x / aspect, none, y], axis=1)
    return np.stack([across, down], axis=1)


def _columns_of_lines(places: Array) -> Array:
    """Returns how far, (n, 2, 6) px, a shift (2) and all else that keeps lines straight (4) move each part."""
    x, y = places.T
    one, none = np.ones_like(x), np.zeros_like(x)
    across = np.stack([one, none, x, y, none, none], axis=1)
    down = np.stack([none, one, none, none, x, y], axis=1)
    return np.stack([across, down], axis=1)


def _fitted_to_most(columns: Array, moved: Array) -> tuple[Array, Array] | None:
    """Returns the fit as `_fitted` does; None where fewer than `_LEAST_PARTS` parts lie near the fit."""
    if len(moved) < _LEAST_PARTS:
        return None
    fit, off_px = _fitted(columns, moved)
    return (fit, off_px) if np.count_nonzero(off_px < _ASTRAY_PX) >= _LEAST_PARTS else None


def _fitted(columns: Array, moved: Array) -> tuple[Array, Array]:
    """Returns the coefficients, (k,), with which the (n, 2, k) columns move the parts as they have moved, and the
    distance, (n,) px, at which each part lies from that. It minimises distances, not their squares, so that outliers do
    not draw the fit.
    """
    near = np.ones(len(moved))
    for _ in range(_TURNS):
        weighed = columns * near[:, None, None]
        straight = weighed.reshape(-1, columns.shape[-1])
        fit = np.asarray(np.linalg.lstsq(straight, (moved * near[:, None]).ravel(), rcond=None)[0])
        off_px = np.linalg.norm(moved - columns @ fit, axis=1)
        # Squared, this weight is 1 ÷ distance, so that the least squares become least distances.
        near = 1 / np.sqrt(np.maximum(off_px, _NEAR_PX))
    return fit, np.asarray(off_px)
