"""Locates the borders of a convex picture: two straight sides and two arcs about one point. Pure geometry.

A border is where the black beside the sector ends, seen from outside. What is dark inside moves it inwards, what is
drawn beside it moves it outwards, and both do so only along parts of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.registration.pyramid import Bits
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import GreyImage

LEFT, RIGHT, FACE, BOTTOM = range(4)
"""The borders, in the order of every list of them."""
APEX_X, APEX_Y, LEFT_SLOPE, ASPECT, FACE_RADIUS, BOTTOM_RADIUS = 0, 1, 2, 4, 5, 6
"""Indices in the vector of a fan: column and row of the apex; columns per row by which the left and the right side move
away from it; rows ÷ columns of the same length; radii of the arcs, in rows."""
_SAMPLES = 96
"""Most places along each border. More cost time; fewer leave too few where a shadow hides some."""
Blacks = tuple[float, float]
"""Greys up to which it is dark beside a fan: where the tissue is dark, and where it is not."""
_BLURRED_PX = 2
"""px over which an edge may be blurred. With more, dark tissue at a border is taken for a blur; with less, a blur moves
the border outwards."""
_END = 0.04
"""Share of a border that is left out at either end: corners are rounded, and text is drawn there."""


@dataclass(frozen=True, slots=True, eq=False)
class Border:
    """Holds the points of a border in a picture.

    at: (n,) rows of a side or columns of an arc. found: (n,) column or row of the border there, NaN where it is not
    seen. cosine: (n,) cosine of its slope, by which a step along the axis is shorter across the border.
    """

    at: Array
    found: Array
    cosine: Array

    def seen(self) -> "Border":
        """Returns the border without the places where it is not seen."""
        known = np.isfinite(self.found)
        return Border(self.at[known], self.found[known], self.cosine[known])


def predicted(fan: Array, border: int, at: Array) -> tuple[Array, Array]:
    """Returns the columns or rows, (n,), at which a fan, (7,), has this border, and their derivatives by it, (n, 7)."""
    slopes = np.zeros((at.size, 7))
    if border in (LEFT, RIGHT):
        side, down = (-1 if border == LEFT else 1), at - fan[APEX_Y]
        slope = fan[LEFT_SLOPE + border]
        slopes[:, APEX_X], slopes[:, APEX_Y], slopes[:, LEFT_SLOPE + border] = 1, -side * slope, side * down
        return fan[APEX_X] + side * slope * down, slopes
    radius = FACE_RADIUS + border - FACE
    beside = at - fan[APEX_X]
    depth = np.sqrt(np.maximum(fan[radius] ** 2 - (fan[ASPECT] * beside) ** 2, 1.0))
    slopes[:, APEX_X], slopes[:, APEX_Y] = fan[ASPECT] ** 2 * beside / depth, 1
    slopes[:, ASPECT], slopes[:, radius] = -fan[ASPECT] * beside**2 / depth, fan[radius] / depth
    return fan[APEX_Y] + depth, slopes


def corner(fan: Array, side: int, arc: int) -> tuple[float, float]:
    """Returns the column and row where a side meets an arc."""
    slope = fan[LEFT_SLOPE + side]
    down = fan[FACE_RADIUS + arc - FACE] / np.sqrt(1 + (fan[ASPECT] * slope) ** 2)
    return float(fan[APEX_X] + (-1 if side == LEFT else 1) * slope * down), float(fan[APEX_Y] + down)


def places(fan: Array, border: int, shape: tuple[int, ...], most: int) -> Array:
    """Returns the rows or columns, (n,) whole numbers, at which a border is looked for in a picture of this shape.

    most: the largest n.
    """
    axis = 0 if border in (LEFT, RIGHT) else 1
    ends = (FACE, BOTTOM) if axis == 0 else (LEFT, RIGHT)
    corners = [corner(fan, *((border, end) if axis == 0 else (end, border)))[1 - axis] for end in ends]
    first = max(corners[0], 0.0)
    last = min(corners[1], shape[axis] - 1.0) if np.isfinite(corners[1]) else shape[axis] - 1.0
    room = _END * (last - first)
    return np.round(np.linspace(first + room, last - room, int(np.clip(last - first, 0, most))))


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Holds the pixels in which borders of a fan are looked for, in pictures of one size.

    at, cosine: (n,) as in `Border`. expected: (n,) where the fan has the borders. inwards: (n,) sign of the direction
    into the fan. rows, columns: (n, m) of the pixels across the borders, the outermost first. outside: (n, m) whether
    they are beyond the picture's edge. most: (n,) last column or row at which a border may lie.
    """

    at: Array
    cosine: Array
    expected: Array
    inwards: NDArray[np.intp]
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    outside: Bits
    most: NDArray[np.intp]

    def read(self, image: GreyImage, black: Blacks) -> Border:
        """Returns the border in a picture.

        It lies where the second grey is passed, because edges are blurred, or where the first is passed if the second
        does not follow at once, as where the tissue is dark. It is not found where the picture's edge cuts it off, or
        where the dark beside it is not seen.
        """
        greys = np.where(self.outside, 0, image[self.rows, self.columns])
        dim, clear = _first(greys > black[0]), _first(greys > black[1])
        first = np.where(clear - dim <= _BLURRED_PX, clear, dim)
        reach = greys.shape[1] // 2
        found = np.round(self.expected) + self.inwards * (first - reach - 0.5)
        seen = (dim < greys.shape[1]) & (dim > 0) & (found > 0) & (found < self.most)
        return Border(self.at, np.where(seen, found, np.nan), self.cosine)

    def near(self, image: GreyImage, black: Blacks, room_px: float) -> Bits:
        """Returns whether each point, (n,) bool, is within room_px of where it is expected, across the border."""
        with np.errstate(invalid="ignore"):
            return np.asarray(np.abs((self.read(image, black).found - self.expected) * self.cosine) <= room_px)


def joined(windows: Sequence[Window]) -> Window:
    """Joins several windows into one, so that their borders are read at once."""
    parts = [[getattr(one, field.name) for one in windows] for field in fields(Window)]
    return Window(*(np.concatenate(part) for part in parts))


def _first(lit: Bits) -> NDArray[np.intp]:
    """Returns the index, (n,), of the first of two lit pixels side by side in each row of (n, m); m without any."""
    twice = lit[:, :-1] & lit[:, 1:]
    return np.asarray(np.where(twice.any(axis=1), twice.argmax(axis=1), lit.shape[1]), np.intp)


def window(fan: Array, border: int, shape: tuple[int, ...], reach_px: int, most_places: int = _SAMPLES) -> Window:
    """Returns the window of reach_px on either side of where the fan, (7,), has a border."""
    side = border in (LEFT, RIGHT)
    at = places(fan, border, shape, most_places)
    expected, slopes = predicted(fan, border, at)
    inwards = 1 if border in (LEFT, FACE) else -1
    across = np.round(expected).astype(np.intp)[:, None] + inwards * np.arange(-reach_px, reach_px + 1)
    most = shape[1 if side else 0] - 1
    outside = (across < 0) | (across > most)
    along, across = np.broadcast_to(at.astype(np.intp)[:, None], across.shape), np.clip(across, 0, most)
    rows, columns = (along, across) if side else (across, along)
    cosine = 1 / np.hypot(1, slopes[:, APEX_Y if side else APEX_X])
    return Window(at, cosine, expected, np.full(at.size, inwards), rows, columns, outside, np.full(at.size, most))


def off(fan: Array, border: int, seen: Border) -> Array:
    """Returns the distances, (n,) px across the border, from the border of a fan; NaN where it is not seen."""
    return (seen.found - predicted(fan, border, seen.at)[0]) * seen.cosine
