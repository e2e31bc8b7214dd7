"""How much one picture is stretched against another, along each axis, from how far its parts have moved.

A shift moves all parts alike, a turn moves them across, a stretch moves them apart, whatever it is about.
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
"""px of a picture of 160 columns: side of a part, and how far it is looked for. A larger part is itself torn by a
stretch, a smaller one is alike elsewhere; at the edge a stretch by 12 % moves it by 8 px, and the hand by some more."""
_INSET_PX = 4
"""From the edge of the picture to the outer parts, so that they may move outwards: further in they show less of a
stretch; nearer they are lost sooner, as what goes beyond the edge is found at the edge."""
_LEAST_SEEN = 0.3
"""A row or column counts from this share of the px seen in the fullest one. More narrows a fan to its middle, less
keeps rows and columns that hold next to nothing. Not varied."""
_EDGE = np.ones((3, 3), np.uint8)
"""Neighbours of a px that must be seen as well: a px at the border holds some of what lies beyond it."""
_GRID = (5, 4)
"""Parts across and down: four and more in each direction, so that some behind text or shadow leave enough."""
_LEAST_ALIKE = 0.4
"""Correlation of a part with where it is found: less takes another place for it, more loses parts of quick motion."""
_ASTRAY_PX, _LEAST_PARTS = 1.5, 9
"""How far beside the fit a part has been taken for another, and the fewest that decide: less than half of the grid is
one corner of the picture."""
_TURNS, _NEAR_PX = 8, 0.3
"""Rounds of reweighting, and distance from the fit within which a part counts fully: what the vertex of a peak is right
to."""
_RIGID = 3
"""Columns of the fit that are no stretch: a shift along two axes, and a turn."""
_LOOKS = 2
"""At a picture that is stretched as found by then: the second finds parts that the first did not, and to .2 %."""


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """magnification: (2,) across and down. warp: (2, 3) from a place in the picture before to its place in this one.
    apart_px: by how much it moves the parts, without shift and turn. gained_px: by how much less is left of their
    motion than shift and turn alone leave. Both are medians of the parts; of a stretch that the picture has, they are
    alike, and of parts that slide along each other next to nothing is gained.
    """

    magnification: Array
    warp: Array
    apart_px: float
    gained_px: float


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """turned_rad: (2,) by which lines across and lines down have turned: alike, but for the sign, in a picture that was
    turned, one of them in one that was sheared. warp: (2, 3) from a place in the picture before to its place in this
    one.
    """

    turned_rad: Array
    warp: Array


def seen_in_both(before: Array32, now: Array32) -> tuple[Array32, Array32]:
    """Returns both pictures, cropped to the rows and columns in which both show tissue, without its border: border and
    surroundings stand still on the screen, so that they would hide a stretch. Not cropped below two parts a side.
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
    """The stretch between two pictures (h, w) of the same size; None where too few parts are found again.

    start: magnification about which it is looked for, as far as 8 % beside. aspect: λ_axial ÷ λ_lateral.
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
        M = np.array([[1 + fit[3], -aspect * fit[2]], [fit[2] / aspect, 1 + fit[4]]])
        warp = M @ warp + np.column_stack([np.zeros((2, 2)), middle + fit[:2] - M @ middle])
        apart = apart + fit[3:]
        first = first or (columns[:, :, :_RIGID], moved)
    assert first is not None
    rigid_px = _fitted(*first)[1]
    magnification = np.hypot(warp[[0, 1], [0, 1]], warp[[1, 0], [0, 1]] * [aspect, 1 / aspect])
    apart_px = float(np.median(np.linalg.norm(places * apart, axis=1)))
    return Stretch(magnification, warp, apart_px, float(np.median(rigid_px) - np.median(off_px)))


def lines_turned(before: Array32, now: Array32, aspect: float) -> Array | None:
    """Lines as of `lines_between`; None where too few parts are found."""
    found = lines_between(before, now, aspect, 0.0, looks=1)
    return None if found is None else found.turned_rad


def lines_between(before: Array32, now: Array32, aspect: float, start_rad: float, looks: int = _LOOKS) -> Lines | None:
    """How lines turned between two pictures (h, w) of the same size; None where too few parts are found again.

    start_rad: turn about which it is looked for, as far as 8° beside. aspect: λ_axial ÷ λ_lateral.
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
    """warp: (2, 3) from a place in the image to where it goes."""
    return np.asarray(cv2.warpAffine(image, warp, (image.shape[1], image.shape[0])), dtype=np.float32)


def carried(image: Array32, way: Warp, aspect: float) -> Array32:
    """The picture after its tissue has gone so far, px and rad about its middle."""
    M = warp_matrix(way[1], aspect)
    middle = (np.array(image.shape[::-1]) - 1) / 2
    return warped(image, np.column_stack([M, middle + way[0] - M @ middle]))


def likeness_in_place(a: Array32, b: Array32) -> float:
    """Correlation of the middle of a with the same place of b; 1 where there is nothing to compare."""
    rows, columns = a.shape[0] // 10, a.shape[1] // 10
    middle = np.s_[rows : a.shape[0] - rows, columns : a.shape[1] - columns]
    own, other = (image[middle].ravel() - image[middle].mean() for image in (a, b))
    power = float(own @ own) * float(other @ other)
    return float(own @ other) / sqrt(power) if power > 0 else 1.0


def _parts(before: Array32, now: Array32) -> tuple[Array, Array]:
    """(n, 2) places in the picture before, px from its middle, and (n, 2) px by which what lies there has moved."""
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
    """Column and row of the part in what is around, to a fraction of a px; None where it is not there, or at the edge
    of it: then it may be beyond."""
    if _is_even(part) or _is_even(around):
        return None
    likeness = np.asarray(cv2.matchTemplate(around, part, cv2.TM_CCOEFF_NORMED), np.float32)
    _, best, _, (column, row) = cv2.minMaxLoc(likeness)
    rows, columns = likeness.shape
    if best < _LEAST_ALIKE or not (0 < column < columns - 1 and 0 < row < rows - 1):
        return None
    return column + _vertex(likeness[row], column), row + _vertex(likeness[:, column], row)


def _is_even(image: Array32) -> bool:
    """Whether all of it has one grey level."""
    darkest, brightest, _, _ = cv2.minMaxLoc(image)
    return darkest == brightest


def _vertex(values: Array32, peak: int) -> float:
    """Where a parabola through the peak, which is at neither end, and its neighbours is highest, −½ … ½."""
    below, at, above = (float(value) for value in values[peak - 1 : peak + 2])
    bend = 2 * at - below - above
    return 0.5 * (above - below) / bend if bend > 0 else 0.0


def _columns(places: Array, aspect: float) -> Array:
    """(n, 2, 5): px by which each part moves by a shift (2), a turn and a stretch (2) of 1."""
    x, y = places.T
    one, none = np.ones_like(x), np.zeros_like(x)
    across = np.stack([one, none, -aspect * y, x, none], axis=1)
    down = np.stack([none, one, x / aspect, none, y], axis=1)
    return np.stack([across, down], axis=1)


def _columns_of_lines(places: Array) -> Array:
    """(n, 2, 6): px by which each part moves by a shift (2), and by all that keeps lines straight."""
    x, y = places.T
    one, none = np.ones_like(x), np.zeros_like(x)
    across = np.stack([one, none, x, y, none, none], axis=1)
    down = np.stack([none, one, none, none, x, y], axis=1)
    return np.stack([across, down], axis=1)


def _fitted_to_most(columns: Array, moved: Array) -> tuple[Array, Array] | None:
    """Fit as of `_fitted`; None where fewer than _LEAST_PARTS lie near the fit."""
    if len(moved) < _LEAST_PARTS:
        return None
    fit, off_px = _fitted(columns, moved)
    return (fit, off_px) if np.count_nonzero(off_px < _ASTRAY_PX) >= _LEAST_PARTS else None


def _fitted(columns: Array, moved: Array) -> tuple[Array, Array]:
    """(k,) of the (n, 2, k) columns that move the parts as they have moved, by least distances, so that parts gone
    astray do not draw it; (n,) px by which each part lies beside that.
    """
    near = np.ones(len(moved))
    for _ in range(_TURNS):
        weighed = columns * near[:, None, None]
        straight = weighed.reshape(-1, columns.shape[-1])
        fit = np.asarray(np.linalg.lstsq(straight, (moved * near[:, None]).ravel(), rcond=None)[0])
        off_px = np.linalg.norm(moved - columns @ fit, axis=1)
        near = 1 / np.sqrt(np.maximum(off_px, _NEAR_PX))
    return fit, np.asarray(off_px)
