"""Draws contours of the error of a point over the live picture, from the bounds at its grid of places. Pure."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline

Reals = NDArray[np.float64]

_STEPS_MM = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Steps from one contour to the next, mm: the smallest is taken that draws at most `_MOST`."""
_MOST = 4
"""Number of contours at most. More hide the picture; fewer leave parts of it without a figure near."""
_FINE = 4
"""Parts of each side of a cell, between which a spline gives the bounds, so that straight pieces look like a curve."""
_AWAY = 0.06
"""Share of the picture by which a figure stays away from its edges, so that it can be read whole."""


def contours(point: Mapping[str, Any] | None) -> list[dict[str, Any]]:
    """Returns the contours of the bound for 99.7 %, from the least on: `mm`; `path`, pieces of it as an SVG path in
    shares of width and height; `at`, where its figure stands. point: as in the status; the result is empty where it has
    no bounds, or where these differ by less than a step.
    """
    bounds_mm = np.array([] if point is None else point.get("region_mm", []), dtype=float)
    if point is None or bounds_mm.ndim != 2 or min(bounds_mm.shape) < 2 or not np.isfinite(bounds_mm).all():
        return []
    region = point["region"]
    x = np.linspace(region["left"], region["right"], bounds_mm.shape[1])
    y = np.linspace(region["top"], region["bottom"], bounds_mm.shape[0])
    triangles = _triangles(x, y, bounds_mm)
    found = ((mm, _pieces(triangles, mm)) for mm in levels_mm(float(bounds_mm.min()), float(bounds_mm.max())))
    return [{"mm": mm, "path": _path(pieces), "at": _figure_at(pieces)} for mm, pieces in found if len(pieces)]


def levels_mm(least_mm: float, most_mm: float) -> list[float]:
    """Returns the multiples of one step between the two."""
    for step_mm in _STEPS_MM:
        numbers = np.arange(np.floor(least_mm / step_mm) + 1, np.ceil(most_mm / step_mm))
        if len(numbers) <= _MOST:
            return [round(float(number * step_mm), 1) for number in numbers]
    return []


def _triangles(x: Reals, y: Reals, values: Reals) -> Reals:
    """Returns (n, 3, 3): x, y and value at the corners of triangles that fill the refined grid. values: (y, x)."""
    fine_x, fine_y = (np.interp(np.arange(_FINE * (len(at) - 1) + 1) / _FINE, np.arange(len(at)), at) for at in (x, y))
    spline = RectBivariateSpline(y, x, values, kx=min(3, len(y) - 1), ky=min(3, len(x) - 1))
    corners = np.stack([*np.meshgrid(fine_x, fine_y), spline(fine_y, fine_x)], axis=-1)
    upper_left, upper_right = corners[:-1, :-1], corners[:-1, 1:]
    lower_left, lower_right = corners[1:, :-1], corners[1:, 1:]
    halves = ((upper_left, upper_right, lower_right), (upper_left, lower_right, lower_left))
    return np.concatenate([np.stack(half, axis=2).reshape(-1, 3, 3) for half in halves])


def _pieces(triangles: Reals, level: float) -> Reals:
    """Returns (k, 2, 2): both ends, x and y, of the straight piece of the contour in each triangle that it crosses."""
    above = triangles[:, :, 2] > level
    crossed = triangles[(above.sum(axis=1) % 3) > 0]
    above = crossed[:, :, 2] > level
    # The corner that is alone on its side; the contour crosses the two edges that meet there.
    alone = np.argmax(above == (above.sum(axis=1) == 1)[:, None], axis=1)
    rows = np.arange(len(crossed))
    apex = crossed[rows, alone]
    ends = []
    for beside in (1, 2):
        other = crossed[rows, (alone + beside) % 3]
        share = (level - apex[:, 2]) / (other[:, 2] - apex[:, 2])
        ends.append(apex[:, :2] + share[:, None] * (other[:, :2] - apex[:, :2]))
    return np.stack(ends, axis=1)


def _path(pieces: Reals) -> str:
    return "".join(f"M{a[0]:.4f} {a[1]:.4f}L{b[0]:.4f} {b[1]:.4f}" for a, b in pieces)


def _figure_at(pieces: Reals) -> list[float]:
    """Returns the lowest place of the contour away from the edges of the picture; beside its middle where none is."""
    places = pieces.mean(axis=1)
    inside = places[((places > _AWAY) & (places < 1 - _AWAY)).all(axis=1)]
    place = inside[np.argmax(inside[:, 1])] if len(inside) else places[len(places) // 2]
    return [round(float(one), 4) for one in np.clip(place, _AWAY, 1 - _AWAY)]
