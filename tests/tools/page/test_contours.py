"""Contours of the error of a point lie where the bound has that value, and none is drawn of what is not known."""

import re

import numpy as np
import pytest

from probewatch.tools.page.contours import contours, levels_mm

ALL = {"left": 0.0, "right": 1.0, "top": 0.0, "bottom": 1.0}


def pieces(path: str) -> np.ndarray:
    """(k, 2, 2) ends of the pieces, x and y in shares."""
    return np.array(re.findall(r"M([\d.]+) ([\d.]+)L([\d.]+) ([\d.]+)", path), dtype=float).reshape(-1, 2, 2)


def point(bounds: np.ndarray, region: dict[str, float] | None = None) -> dict[str, object]:
    return {"region": region or ALL, "region_mm": bounds.tolist()}


def grid(of: object, region: dict[str, float] = ALL) -> np.ndarray:
    x, y = np.linspace(region["left"], region["right"], 5), np.linspace(region["top"], region["bottom"], 5)
    return np.array([[of(one, other) for one in x] for other in y])  # type: ignore[operator]


def test_bounds_that_grow_with_the_depth_give_rows() -> None:
    found = contours(point(grid(lambda x, y: 1.0 + 2.0 * y)))
    assert [one["mm"] for one in found] == [1.5, 2.0, 2.5]
    for one in found:
        ends = pieces(one["path"])
        np.testing.assert_allclose(ends[..., 1], (one["mm"] - 1.0) / 2.0, atol=1e-3)
        assert (ends[..., 0].min(), ends[..., 0].max()) == (0.0, 1.0)
        assert np.abs(np.diff(ends[..., 0], axis=1)).sum() == pytest.approx(1.0, abs=1e-3), "without a gap"


def test_bounds_that_are_least_in_the_middle_give_rings() -> None:
    """As where a rotation is open: what it adds grows with the distance, and is added to the rest by squares."""
    found = contours(point(grid(lambda x, y: float(np.sqrt(1.0 + 12.0 * ((x - 0.5) ** 2 + (y - 0.5) ** 2))))))
    assert [one["mm"] for one in found] == [1.5, 2.0, 2.5]
    radius = np.sqrt(1.25 / 12.0)
    radii = np.hypot(*(pieces(found[0]["path"]).reshape(-1, 2) - 0.5).T)
    np.testing.assert_allclose(radii, radius, atol=0.01)
    column, row = found[0]["at"]
    assert np.hypot(column - 0.5, row - 0.5) == pytest.approx(radius, abs=0.01)
    assert row > 0.7, "the figure stands below"


def test_a_region_is_drawn_where_it_lies() -> None:
    region = {"left": 0.2, "right": 0.6, "top": 0.1, "bottom": 0.9}
    (one,) = contours(point(grid(lambda x, y: 2.0 + x, region), region))[:1]
    ends = pieces(one["path"])
    np.testing.assert_allclose(ends[..., 0], one["mm"] - 2.0, atol=1e-3)
    assert (ends[..., 1].min(), ends[..., 1].max()) == (0.1, 0.9)


@pytest.mark.parametrize(
    ("least", "most", "expected"),
    [
        (1.31, 1.58, [1.4, 1.5]),
        (1.31, 2.95, [1.5, 2.0, 2.5]),
        (0.4, 4.9, [1.0, 2.0, 3.0, 4.0]),
        (3.0, 4.0, [3.2, 3.4, 3.6, 3.8]),
        (1.01, 1.04, []),
        (2.0, 2.0, []),
        (1.0, 5000.0, []),
    ],
)
def test_a_few_round_figures_are_drawn(least: float, most: float, expected: list[float]) -> None:
    assert levels_mm(least, most) == pytest.approx(expected)


@pytest.mark.parametrize(
    "unknown",
    [
        None,
        {},
        {"region_mm": [], "region": ALL},
        point(np.full((5, 5), np.nan)),
        point(np.full((5, 5), 2.0)),
        {"region_mm": [None], "region": ALL},
    ],
)
def test_nothing_is_drawn_of_what_is_not_known(unknown: dict[str, object] | None) -> None:
    assert contours(unknown) == []
