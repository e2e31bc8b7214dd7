"""Where the borders of a convex picture lie: two straight sides and two arcs about one point. Pure geometry.

A border is where the black beside the sector ends, seen from outside: what is dark inside moves it inwards, what is
drawn beside it outwards, and both only in parts of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.registration.pyramid import Bits
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import GreyImage

LEFT, RIGHT, FACE, BOTTOM = range(4)
"""Borders, in the order of every list of them."""
APEX_X, APEX_Y, LEFT_SLOPE, ASPECT, FACE_RADIUS, BOTTOM_RADIUS = 0, 1, 2, 4, 5, 6
"""Places in the vector of a fan: apex, column and row; columns that the left and the right side leave it by per row;
rows ÷ columns of the same length; radii of the arcs in rows."""
_SAMPLES = 96
"""Places along each border. More cost time, fewer leave too few where a shadow hides some."""
Blacks = tuple[float, float]
"""Greys up to which it is dark beside a fan: where the tissue is dark, and where it is not."""
_BLURRED_PX = 2
"""px over which an edge may be blurred. More takes dark tissue at a border for a blur, less is drawn outwards by
one."""
_END = 0.04
"""Share of a border at either end that is left out: corners are round, and text stands there."""


@dataclass(frozen=True, slots=True, eq=False)
class Border:
    """at: (n,) rows of a side, columns of an arc. found: (n,) where it lies there, column or row, NaN where it is not
    seen. cosine: (n,) of its slope, by which a step along the axis is shorter across it.
    """

    at: Array
    found: Array
    cosine: Array

    def seen(self) -> "Border":
        """The places where it is seen."""
        known = np.isfinite(self.found)
        return Border(self.at[known], self.found[known], self.cosine[known])


def predicted(fan: Array, border: int, at: Array) -> tuple[Array, Array]:
    """(n,) columns or rows where a fan, (7,), has this border; (n, 7) by how much each of its numbers moves that."""
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
    """Column and row where a side meets an arc."""
    slope = fan[LEFT_SLOPE + side]
    down = fan[FACE_RADIUS + arc - FACE] / np.sqrt(1 + (fan[ASPECT] * slope) ** 2)
    return float(fan[APEX_X] + (-1 if side == LEFT else 1) * slope * down), float(fan[APEX_Y] + down)


def places(fan: Array, border: int, shape: tuple[int, ...], most: int) -> Array:
    """(n,), at most so many, whole rows or columns in a picture of this shape at which a border is looked for."""
    axis = 0 if border in (LEFT, RIGHT) else 1
    ends = (FACE, BOTTOM) if axis == 0 else (LEFT, RIGHT)
    corners = [corner(fan, *((border, end) if axis == 0 else (end, border)))[1 - axis] for end in ends]
    first = max(corners[0], 0.0)
    last = min(corners[1], shape[axis] - 1.0) if np.isfinite(corners[1]) else shape[axis] - 1.0
    room = _END * (last - first)
    return np.round(np.linspace(first + room, last - room, int(np.clip(last - first, 0, most))))


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Where borders of a fan are looked for in pictures of one size. at, cosine: (n,) as of `Border`. expected: (n,)
    where the fan has them; inwards: (n,) sign of the way into it. rows, columns: (n, m) of the pixels across them, the
    outermost first. outside: (n, m) those beyond the picture's edge. most: (n,) last column or row that they may lie
    at.
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
        """The border in a picture: where the second grey is passed, as an edge is blurred; the first where only that is
        passed by, as where the tissue is dark. Where the picture's edge cuts it off, or the dark beside it is not seen,
        it is not found.
        """
        greys = np.where(self.outside, 0, image[self.rows, self.columns])
        dim, clear = _first(greys > black[0]), _first(greys > black[1])
        first = np.where(clear - dim <= _BLURRED_PX, clear, dim)
        reach = greys.shape[1] // 2
        found = np.round(self.expected) + self.inwards * (first - reach - 0.5)
        seen = (dim < greys.shape[1]) & (dim > 0) & (found > 0) & (found < self.most)
        return Border(self.at, np.where(seen, found, np.nan), self.cosine)

    def near(self, image: GreyImage, black: Blacks, room_px: float) -> Bits:
        """(n,) bool: where it lies so near to where it is expected, across it."""
        with np.errstate(invalid="ignore"):
            return np.asarray(np.abs((self.read(image, black).found - self.expected) * self.cosine) <= room_px)


def joined(windows: Sequence[Window]) -> Window:
    """Several borders to be read at once."""
    parts = [[getattr(one, field.name) for one in windows] for field in fields(Window)]
    return Window(*(np.concatenate(part) for part in parts))


def _first(lit: Bits) -> NDArray[np.intp]:
    """(n,) of the first two of (n, m) in a row, m where there are none."""
    twice = lit[:, :-1] & lit[:, 1:]
    return np.asarray(np.where(twice.any(axis=1), twice.argmax(axis=1), lit.shape[1]), np.intp)


def window(fan: Array, border: int, shape: tuple[int, ...], reach_px: int, most_places: int = _SAMPLES) -> Window:
    """The window of so many px on either side of where the fan, (7,), has a border."""
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
    """(n,) px, across the border, by which it lies beside that of a fan; NaN where it is not seen."""
    return (seen.found - predicted(fan, border, seen.at)[0]) * seen.cosine
