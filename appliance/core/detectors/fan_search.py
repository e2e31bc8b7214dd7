"""Finds where a convex picture may lie, to a few pixels and without previous knowledge; `fan` then measures it."""

import cv2
import numpy as np

from probewatch.appliance.core.detectors.fan_borders import BOTTOM, FACE, LEFT, RIGHT
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import GreyImage

_LONGEST_PX = 480
"""Longest side, px, of the picture that is searched; of a larger one every second or third pixel is taken. A longer one
costs time: 1.5 ms at this size."""
_CORNER = 8
"""Ratio of the picture's width and height to those of a corner. At least one of the four corners is black beside a
sector."""
_NOISE_SIGMAS, _LEAST_GREY = 4.0, 2.0
"""Greys above black from which something is shown: in sigmas of the corner, and at least. Lower values take a grabber's
noise for tissue; higher ones miss dark tissue: a liver at 20 cm has 5."""
_CLOSE, _OPEN = np.ones((7, 7), np.uint8), np.ones((9, 9), np.uint8)
"""Kernels, px of the picture that is searched: closing joins speckle, opening removes text."""
_PAIRS = 150
"""Lines that are tried for each border. More find a border of which three quarters are hidden, and take longer."""
_BESIDE_PX = 1.5
"""px of the picture that is searched, by which a point of a border may lie beside it."""
_LEAST_SHARE, _LEAST_POINTS = 0.35, 12
"""Least share and number of the points of a border that must lie on it. Lower values find fans in ragged shapes; higher
ones miss fans with shadows."""
_LEAST_SLOPE, _MOST_SLOPE = 0.08, 2.0
"""Bounds of the slope of a side, columns per row: half an opening angle of 5 to 63°. A lower one takes leaning
rectangles for fans."""
_ASPECTS = np.arange(0.7, 1.5, 0.05)
"""Ratios of rows to columns of the same length that are tried. No video mode is squeezed further."""
_LEAST_DEPTH = 1.15
"""Least radius of the lower arc, in radii of the face: what is nearer is the lower edge of a line drawn there."""
_BETWEEN = 0.97
"""Share of the distance from the middle to the sides within which points belong to an arc: the corners belong to
neither."""


def thresholds(image: GreyImage) -> tuple[float, ...]:
    """Returns the greys, to be tried in turn, up to which a picture, (h, w) uint8, is black.

    The first follows from the noise of the darkest corner; the second, where there is one, is far above what a codec
    leaves beside bright tissue. Returns none where no corner is black.
    """
    height, width = image.shape
    rows, columns = max(height // _CORNER, 1), max(width // _CORNER, 1)
    corners = [image[r, c] for r in (slice(rows), slice(-rows, None)) for c in (slice(columns), slice(-columns, None))]
    black, noise = min((float(np.median(one)), float(np.subtract(*np.percentile(one, (84, 50))))) for one in corners)
    bright = float(np.percentile(image[::4, ::4], 90))
    low = black + max(_LEAST_GREY, _NOISE_SIGMAS * noise)
    high = black + 0.2 * (bright - black)
    if low >= bright or black > 0.5 * bright:
        return ()
    return (low, high) if high > 2 * low else (low,)


def fan_about(image: GreyImage, black: float) -> Array | None:
    """Returns the numbers of a fan, (7,) in the order of `fan_borders`, in a picture, (h, w) uint8; None without a fan.

    The last number is NaN where the lower arc is not seen.
    """
    every = -(-max(image.shape) // _LONGEST_PX)
    shown = _shown(image[::every, ::every], black)
    if shown is None:
        return None
    edges = _edges(shown)
    one, other = (_most(*edges[side], np.full(edges[side][0].size, _BESIDE_PX)) for side in (LEFT, RIGHT))
    if one is None or other is None:
        return None
    left_px, left, right_px, right = one[0], -one[1], *other
    if not (_LEAST_SLOPE < left < _MOST_SLOPE and _LEAST_SLOPE < right < _MOST_SLOPE):
        return None
    apex_y = -(right_px - left_px) / (left + right)
    apex_x = left_px - left * apex_y
    arcs = [_arc(*edges[arc], apex_x, apex_y, left, right) for arc in (FACE, BOTTOM)]
    if arcs[0] is None:
        return None
    face, aspect = arcs[0]
    bottom = np.nan
    if arcs[1] is not None and arcs[1][0] > _LEAST_DEPTH * face:
        bottom, aspect = arcs[1]
    every_px = np.array([every, every, 1, 1, 1, every, every], float)
    return np.asarray(np.array([apex_x, apex_y, left, right, aspect, face, bottom]) * every_px)


def _shown(image: GreyImage, black: float) -> GreyImage | None:
    """Returns (h, w) uint8 that is 1 in the largest piece that is not black; None where everything is black."""
    lit = (image > black).astype(np.uint8)
    pieces = cv2.morphologyEx(cv2.morphologyEx(lit, cv2.MORPH_CLOSE, _CLOSE), cv2.MORPH_OPEN, _OPEN)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(pieces, connectivity=4)
    if count < 2:
        return None
    return np.asarray(labels == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])), np.uint8)


def _edges(shown: GreyImage) -> tuple[tuple[Array, Array], ...]:
    """Returns the places along each border and where it is there, without what the picture's edge cuts off."""
    found: list[tuple[Array, Array]] = []
    for picture in (shown, np.ascontiguousarray(shown.T)):
        at = np.flatnonzero(picture.any(axis=1))
        first, last = picture[at].argmax(axis=1), picture.shape[1] - 1 - picture[at][:, ::-1].argmax(axis=1)
        for where, kept in ((first, first > 1), (last, last < picture.shape[1] - 2)):
            found.append((at[kept].astype(float), where[kept].astype(float)))
    return tuple(found)


def _most(at: Array, where: Array, room: Array) -> tuple[float, float] | None:
    """Returns a, b of the line where = a + b · at that has most points within the room of each, fitted to those points.

    Returns None where too few points lie on any line.
    """
    if at.size < _LEAST_POINTS:
        return None
    # Lines through random pairs of points are tried, and the one with most points near it is refined (RANSAC).
    random = np.random.default_rng(at.size)
    one = random.integers(0, at.size, _PAIRS)
    other = (one + random.integers(at.size // 5 + 1, at.size - at.size // 5, _PAIRS)) % at.size
    apart = at[other] - at[one]
    kept = apart != 0
    one, other, apart = one[kept], other[kept], apart[kept]
    if not one.size:
        return None
    slope = (where[other] - where[one]) / apart
    start = where[one] - slope * at[one]
    near = np.abs(where - start[:, None] - slope[:, None] * at) <= room
    best = near[int(near.sum(axis=1).argmax())]
    if best.sum() < max(_LEAST_POINTS, _LEAST_SHARE * at.size):
        return None
    centred = at[best] - at[best].mean()
    slope_of_all = float(centred @ where[best] / (centred @ centred))
    return float(where[best].mean() - slope_of_all * at[best].mean()), slope_of_all


def _arc(
    columns: Array, rows: Array, apex_x: float, apex_y: float, left: float, right: float
) -> tuple[float, float] | None:
    """Returns the radius, in rows, and the aspect of the arc about the apex on which most points between the sides lie.

    Returns None where too few points lie on any arc.
    """
    beside, down = columns - apex_x, rows - apex_y
    between = (down > 0) & (beside > -_BETWEEN * left * down) & (beside < _BETWEEN * right * down)
    beside, down = beside[between], down[between]
    if down.size < _LEAST_POINTS:
        return None
    best = (0, 0.0, 0.0)
    for aspect in _ASPECTS:
        radius = np.sort(np.hypot(down, aspect * beside))
        until = np.searchsorted(radius, radius + 2 * _BESIDE_PX)
        first = int((until - np.arange(radius.size)).argmax())
        best = max(best, (int(until[first]) - first, float(radius[first : until[first]].mean()), float(aspect)))
    return best[1:] if best[0] >= max(_LEAST_POINTS, _LEAST_SHARE * down.size) else None
