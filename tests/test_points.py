"""The compiled part of registration against NumPy's and SciPy's own words for the same sums."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from appliance.core.points import Look, Picture, Points, Warp

TUKEY, LEAST_SCALE = 6.0, 2.0
ASKEW = Warp(0.98, 0.05, 30.3, -0.04, 1.01, 22.6, 0.9, 4.0)


def speckle(seed: int = 1, shape: tuple[int, int] = (48, 64)) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0, 255, shape).astype(np.float32)


def some(n: int = 700, seed: int = 2) -> np.ndarray:
    """(6, n) points that a picture of 48 × 64 partly shows."""
    random = np.random.default_rng(seed)
    x, y = random.uniform(-34, 34, n), random.uniform(-26, 26, n)
    return np.stack([x, y, *random.normal(0, 20, (2, n)), random.normal(0, 400, n), random.uniform(0, 255, n)]).astype(
        np.float32
    )


def places(parts: np.ndarray, warp: Warp) -> np.ndarray:
    """(2, n) columns and rows."""
    x, y = parts[:2].astype(float)
    return np.stack([warp.xx * x + warp.xy * y + warp.x0, warp.yx * x + warp.yy * y + warp.y0])


def looked_up(picture: np.ndarray, where: np.ndarray) -> np.ndarray:
    return map_coordinates(picture.astype(float), where[::-1], order=1, mode="nearest")


def inside(picture: np.ndarray, where: np.ndarray) -> np.ndarray:
    x, y = where
    return (x >= 0) & (y >= 0) & (x <= picture.shape[1] - 1) & (y <= picture.shape[0] - 1)


def jacobian(parts: np.ndarray) -> np.ndarray:
    return np.concatenate([parts[2:], np.ones((1, parts.shape[1]))])


@pytest.mark.parametrize("kind", [np.float32, np.uint8])
def test_a_look_sums_tukeys_weights_of_what_gain_and_bias_leave(kind: type) -> None:
    picture, parts = speckle().astype(kind), some()
    where = places(parts, ASKEW)
    seen = inside(picture, where)
    residual = looked_up(picture, where) - (ASKEW.gain * parts[5] + ASKEW.bias)
    scale = 1.4826 * np.sort(np.abs(residual[seen]))[np.count_nonzero(seen) // 2]
    weights = np.clip(1 - (residual / (TUKEY * scale)) ** 2, 0, None) ** 2 * seen
    J = jacobian(parts)

    look = Look(Points(parts))
    count, sums = look.take(Picture(picture), ASKEW, 1_000, TUKEY, LEAST_SCALE)

    assert 0 < count == np.count_nonzero(seen) < parts.shape[1]
    np.testing.assert_allclose(look.weights, weights, atol=2e-4)
    np.testing.assert_allclose(look.weighted, weights * residual, atol=2e-2)
    np.testing.assert_allclose(sums[:5], J @ (weights * residual), rtol=2e-4, atol=2)
    np.testing.assert_allclose(sums[5:], np.square(J[[0, 1, 2, 4]]) @ weights, rtol=2e-4)


def test_the_scale_of_residuals_is_never_less_than_what_counts_as_noise() -> None:
    picture, parts = np.full((48, 64), 100, np.uint8), some()
    parts[5] = 100.5
    look = Look(Points(parts))
    seen, _ = look.take(Picture(picture), Warp(1, 0, 31, 0, 1, 23, 1, 0), 500, TUKEY, LEAST_SCALE)
    expected = (1 - (0.5 / (TUKEY * LEAST_SCALE)) ** 2) ** 2
    assert seen == np.count_nonzero(look.weights)
    np.testing.assert_allclose(look.weights[look.weights > 0], expected, rtol=1e-5)


def test_strips_and_curvature_are_those_of_the_weights() -> None:
    parts = some(960)
    points = Points(parts)
    look = Look(points)
    look.take(Picture(speckle()), ASKEW, 1_000, TUKEY, LEAST_SCALE)
    J, root = jacobian(parts), np.sqrt(look.weights.astype(float))

    strips = (J * look.weighted).reshape(5, 24, 40).sum(axis=2)
    np.testing.assert_allclose(look.strips(24), strips, rtol=1e-3, atol=0.5)
    np.testing.assert_allclose(points.curvature(960), J @ J.T, rtol=1e-4, atol=50)
    np.testing.assert_allclose(
        points.curvature(960, look.weights), (J * root * (5 * root - 4)) @ J.T, rtol=1e-3, atol=50
    )
    few = J[:, ::2]
    np.testing.assert_allclose(points.curvature(480), 2 * few @ few.T, rtol=1e-4, atol=50)
    np.testing.assert_allclose(points.energy(), np.square(J[[0, 1, 2, 4]]).sum(axis=1), rtol=1e-5)


def test_the_slope_of_a_tilted_plane_answers_as_it_is() -> None:
    rows, columns = np.mgrid[:48, :64]
    picture = (3 * columns + 2 * rows).astype(np.float32)
    parts = some(500) * np.float32([[0.5], [0.5], [1], [1], [1], [1]])
    look = Look(Points(parts))
    look.take(Picture(picture), Warp(1, 0, 31.5, 0, 1, 23.5, 1, 0), 500, 1e6, 1e6)
    x, y = parts[2:4].astype(float)
    expected = [6 * x.sum(), 6 * y.sum(), 4 * x.sum(), 4 * y.sum(), x @ x, y @ y]
    np.testing.assert_allclose(look.respond(Picture(picture), 500), expected, rtol=1e-4, atol=1)


def test_correlations_in_place_and_aside() -> None:
    picture, parts = speckle(shape=(96, 128)), some()
    warp = Warp(1, 0.02, 60.2, -0.02, 1, 47.7, 1, 0)
    where = places(parts, warp)
    parts[5] = looked_up(picture, where) + np.random.default_rng(3).normal(0, 40, parts.shape[1])
    aside = [[0, 0], [9, 0], [-9, 0], [0, 9], [0, -9]]
    looks = [looked_up(picture, where + np.array(step)[:, None]) for step in aside]
    expected = [np.corrcoef(parts[5], look)[0, 1] for look in looks]
    found, share = Points(parts).judge(Picture(picture), warp, 1_000, 9.0)
    assert share == 1.0
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_correlation_with_what_is_constant_is_none() -> None:
    flat = Picture(np.full((48, 64), 77, np.uint8))
    found, _ = Points(some()).judge(flat, ASKEW, 1_000, 12.0)
    assert found == [0.0] * 5


@pytest.mark.parametrize("kind", [np.float32, np.uint8])
@pytest.mark.parametrize("pitch", [1, 3])
def test_points_have_structure_and_central_differences(kind: type, pitch: int) -> None:
    image = speckle().astype(kind)
    mask = np.random.default_rng(4).random(image.shape) < 0.7
    down, across = (2 * part for part in np.gradient(image.astype(float)))
    steep = (np.abs(across) + np.abs(down)).astype(int)
    lattice = np.zeros(image.shape, bool)
    lattice[2:-2:pitch, 2:-2:pitch] = True
    counts = np.bincount(np.minimum(steep[lattice], 511), minlength=512)
    held = np.cumsum(counts * np.arange(512.0) ** 2)
    enough = max(int(np.searchsorted(held, 0.02 * held[-1])), 3)

    chosen = Picture(image).structured(mask, pitch, 2, 0.02, 3)
    np.testing.assert_array_equal(chosen, np.flatnonzero(lattice & mask & (steep > enough)))

    points = Picture(image).describe(chosen, chosen.size, 2.0, -63.0, -47.0, 0.8)
    rows, columns = np.divmod(chosen, image.shape[1])
    x, y = 2.0 * columns - 63, 2.0 * rows - 47
    gx, gy = across.ravel()[chosen] / 4, down.ravel()[chosen] / 4
    expected = np.stack([x, y, gx, gy, gy * x / 0.8 - gx * y * 0.8, image.ravel()[chosen]])
    np.testing.assert_allclose(points.parts, expected, rtol=1e-4, atol=2e-2)


def test_fewer_points_are_taken_evenly() -> None:
    picture = Picture(speckle())
    chosen = picture.structured(None, 1, 2, 0.02, 3)
    all_of_them = picture.describe(chosen, chosen.size, 1.0, 0.0, 0.0, 1.0).parts
    some_of_them = picture.describe(chosen, 100, 1.0, 0.0, 0.0, 1.0).parts
    taken = np.arange(100) * chosen.size // 100
    np.testing.assert_array_equal(some_of_them, all_of_them[:, taken])


ANY = st.floats(width=32)


@settings(max_examples=200)
@given(st.lists(ANY, min_size=8, max_size=8), st.lists(ANY, min_size=6, max_size=6), st.integers(2, 9))
def test_no_number_makes_it_look_outside_the_picture(warp: list[float], point: list[float], side: int) -> None:
    """Around the picture lies what would show: a look outside would bring it in."""
    around = np.full((3 * side, side), 1e30, np.float32)
    around[side : 2 * side] = 7
    picture = Picture(around[side : 2 * side])
    points = Points(np.repeat(np.float32(point)[:, None], 70, axis=1))
    look = Look(points)
    look.take(picture, Warp(*warp[:6], 0, 0), 500, 1e9, 1e9)
    seen = look.weights > 0
    assert np.all(np.isin(look.weighted[seen], np.float32(7))), "a look outside"
    look.respond(picture, 500)
    points.judge(picture, Warp(*warp), 500, warp[0])


@pytest.mark.parametrize("shape", [(1, 640), (480, 1), (0, 0)])
def test_a_picture_too_small_to_look_between_its_pixels_is_refused(shape: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="cannot be looked at"):
        Picture(np.zeros(shape, np.float32))


def test_the_library_is_not_older_than_its_source() -> None:
    core = Path(__file__).parents[1] / "appliance/core"
    assert (core / "_points.so").stat().st_mtime >= (core / "points.c").stat().st_mtime, "make .venv/dev compiles it"
