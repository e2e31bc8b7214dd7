"""The compiled part of the core against NumPy's, SciPy's and OpenCV's own words for the same sums."""

from collections.abc import Callable
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import map_coordinates

from probewatch.appliance.core.registration.points import Fit, Picture, Template
from probewatch.appliance.core.registration.pyramid import pyramid
from tests.support.deformed import faded

TUKEY, LEAST_SCALE, CELLS, NINTHS, TOGETHER = 6.0, 18.0, 48, 9.0, 8.0
CENTRE, ASPECT, FADING = (31.5, 23.5), 0.8, 11.0
GIVE, STIFF = (0.6, -0.8, 0.5, 0.9, -0.4, 0.3), (4.0, 3.0, 2.0, 5.0, 6.0, 7.0)
SHOWS = [0, 1, 2, 0, 0, 1, 1, 1, 1]


def speckle(seed: int = 1, shape: tuple[int, int] = (48, 64)) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 2295, shape).astype(np.int16)


def some(n: int = 500, seed: int = 2) -> np.ndarray:
    """(5, n) points of a level of 48 × 64."""
    random = np.random.default_rng(seed)
    column, row = random.integers(1, 63, n), np.sort(random.integers(1, 47, n))
    return np.stack([column, row, *random.normal(0, 400, (2, n)), random.integers(0, 2295, n)]).astype(np.int16)


def points(parts: np.ndarray, factor: float = 1.0) -> Template:
    return Template(parts, factor, CENTRE, ASPECT, FADING)


def askew() -> Fit:
    return Fit(2.3, -1.6, 0.05, 0.9, 4.0, GIVE, STIFF)


def from_middle(parts: np.ndarray, factor: float) -> np.ndarray:
    """(2, n) px of the full picture."""
    return factor * parts[:2].astype(float) + (factor - 1) / 2 - np.array(CENTRE)[:, None]


def give(parts: np.ndarray, factor: float) -> tuple[np.ndarray, np.ndarray]:
    """(2, n) what gives way along x, of x and drag; (4, n) along y, of x, y, y², x·y."""
    middle = from_middle(parts, factor)
    x, y = middle / np.array(CENTRE)[:, None]
    return np.stack([x, faded((middle[1] + CENTRE[1]) / FADING)]), np.stack([x, y, y * y, x * y])


def test_the_drag_of_the_skin_falls_exponentially() -> None:
    depth = np.linspace(0, 8, 100)
    np.testing.assert_allclose(faded(depth), np.exp(-depth), atol=0.01)


def jacobian(parts: np.ndarray, factor: float = 1.0) -> np.ndarray:
    """(11, n) ∂grey/∂(u_x, u_y, α, give), grey, 1."""
    across, down, grey = parts[2:].astype(float)
    x, y = from_middle(parts, factor)
    gx, gy = across / (2 * factor), down / (2 * factor)
    along_x, along_y = give(parts, factor)
    return np.stack([gx, gy, gy * x / ASPECT - gx * y * ASPECT, *gx * along_x, *gy * along_y, grey, np.ones_like(grey)])


def places(parts: np.ndarray, fit: Fit, factor: float = 1.0) -> np.ndarray:
    """(2, n) column and row in the other level."""
    (x, y), (along_x, along_y), terms = from_middle(parts, factor), give(parts, factor), np.array(fit.give)
    c, s = np.cos(fit.alpha), np.sin(fit.alpha)
    there = [
        c * x - s * ASPECT * y + fit.u_x + terms[:2] @ along_x,
        s / ASPECT * x + c * y + fit.u_y + terms[2:] @ along_y,
    ]
    return (np.stack(there) + np.array(CENTRE)[:, None] - (factor - 1) / 2) / factor


def looked_up(level: np.ndarray, where: np.ndarray) -> np.ndarray:
    return map_coordinates(level.astype(float), where[::-1], order=1, mode="nearest")


def inside(level: np.ndarray, where: np.ndarray) -> np.ndarray:
    x, y = where
    return (x >= 0) & (y >= 0) & (x <= level.shape[1] - 1) & (y <= level.shape[0] - 1)


def weighed(level: np.ndarray, parts: np.ndarray, fit: Fit, scale: float | None = None) -> tuple[np.ndarray, ...]:
    """Residual, Tukey's weight of it, and their scale; the weight is 0 out of view."""
    where = places(parts, fit)
    seen = inside(level, where)
    residual = looked_up(level, where) - (fit.gain * parts[4] + NINTHS * fit.bias)
    if scale is None:
        scale = max(1.4826 * np.sort(np.abs(residual[seen]))[np.count_nonzero(seen) // 2], LEAST_SCALE)
    return residual, np.clip(1 - (residual / (TUKEY * scale)) ** 2, 0, None) ** 2 * seen, scale


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_a_template_knows_its_normal_matrix_and_its_energy(factor: float) -> None:
    J = jacobian(some(), factor)
    template = points(some(), factor)
    size = np.sqrt(np.square(J).sum(axis=1))
    np.testing.assert_allclose(
        np.array(template.normal) / np.outer(size, size), J @ J.T / np.outer(size, size), atol=1e-5
    )
    np.testing.assert_allclose(template.energy, np.square(J[[0, 1, 10]]).sum(axis=1), rtol=1e-5)


def test_one_step_is_that_of_modified_residuals_and_what_is_expected() -> None:
    level, parts, fit = speckle(), some(), askew()
    residual, weight, scale = weighed(level, parts, fit)
    J = jacobian(parts)
    score, (across, down, all_) = J @ (weight * residual), np.square(J[[0, 1, 10]]) @ weight / template_energy(J)
    left = np.array([across, down, (across + down) / 2, across, across, down, down, down, down, all_, all_])
    answer = np.array([0.9] * 9 + [1, 1])
    A = J @ J.T * np.outer(answer * np.sqrt(left), answer * np.sqrt(left))
    stiff = TOGETHER * scale**2 * np.array(STIFF)
    A[range(3, 9), range(3, 9)] += stiff
    step = np.linalg.solve(A, answer * score + np.r_[0, 0, 0, stiff * np.array(GIVE), 0, 0])
    c, s = np.cos(0.05 - step[2]), np.sin(0.05 - step[2])
    u = 2.3 - (c * step[0] - s * ASPECT * step[1]), -1.6 - (s / ASPECT * step[0] + c * step[1])
    expected = [*u, 0.05 - step[2], *np.array(GIVE) - step[3:9], np.clip(0.9 + step[9], 0.2, 5), 4 + step[10] / 9]

    points(parts).descend(Picture(level), fit, 1)

    assert not fit.lost
    assert not fit.converged
    found = [fit.u_x, fit.u_y, fit.alpha, *fit.give, fit.gain, fit.bias]
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=5e-4)
    np.testing.assert_allclose(fit.step, step[:9], rtol=1e-3, atol=5e-4)
    np.testing.assert_allclose(np.array(fit.sums)[:, :11].sum(axis=0), score, rtol=1e-3, atol=2)


def template_energy(J: np.ndarray) -> np.ndarray:
    return np.square(J[[0, 1, 10]]).sum(axis=1)


def test_sums_are_kept_by_runs_of_points_for_the_end() -> None:
    level, parts, fit = speckle(), some(CELLS * 10), askew()
    residual, weight, _ = weighed(level, parts, fit)
    cells = (jacobian(parts) * weight * residual).reshape(11, CELLS, 10).sum(axis=2).T
    points(parts).descend(Picture(level), fit, 1, responding=True)
    np.testing.assert_allclose(np.array(fit.sums)[:, :11], cells, rtol=2e-3, atol=np.abs(cells).max() * 1e-5)


def test_the_scale_of_residuals_is_never_less_than_what_counts_as_noise() -> None:
    level, parts = np.full((48, 64), 900, np.int16), some()
    parts[4] = 905
    fit = Fit(0, 0, 0)
    points(parts).descend(Picture(level), fit, 1)
    weight = (1 - (5 / (TUKEY * LEAST_SCALE)) ** 2) ** 2
    np.testing.assert_allclose(np.array(fit.sums)[:, -1].sum(), weight * parts.shape[1], rtol=1e-5)


def test_response_curvature_and_covariance_are_those_of_what_was_seen() -> None:
    """After a step that was too short to matter: the keyframe itself, with noise."""
    level = cv2.GaussianBlur(speckle(5), (0, 0), 2.0)
    down, across = (2 * part for part in np.gradient(level.astype(float)))
    parts = some()
    at = parts[1], parts[0]
    noise = np.random.default_rng(7).normal(0, 60, parts.shape[1])
    parts[2:] = 1.4 * across[at], 1.4 * down[at], level[at] + noise
    template, fit = points(parts), Fit(0, 0, 0)
    template.descend(Picture(level), fit, 1, responding=True)

    _, _, scale = weighed(level, parts, Fit(0, 0, 0))
    _, weight, _ = weighed(level, parts, fit, scale)
    J, root = jacobian(parts), np.sqrt(weight)
    where = places(parts, fit)
    slopes = [looked_up(level, where + step) - looked_up(level, where - step) for step in ([[1], [0]], [[0], [1]])]
    c, s = np.cos(fit.alpha), np.sin(fit.alpha)
    xx, xy, yx, yy = (weight @ (slope * part) for slope in slopes for part in parts[2:4].astype(float))
    usual = [fit.gain * weight @ np.square(part.astype(float)) for part in parts[2:4]]
    found = c * xx + s * yx, c * yy - s * xy
    response = [found[0] / usual[0], found[1] / usual[1], sum(found) / sum(usual)]
    np.testing.assert_allclose(fit.response, response, rtol=1e-4)
    assert 0.5 < fit.response[2] < 0.9, "1 / 1.4, and a little more for the straight lines between pixels"
    curvature = (J * root * (5 * root - 4)) @ J.T
    size = np.sqrt(np.diag(curvature))
    np.testing.assert_allclose(
        np.array(fit.curvature) / np.outer(size, size), curvature / np.outer(size, size), atol=2e-3
    )


@pytest.mark.parametrize("stiff", [0.0, 1e-3, 1e9])
def test_the_end_draws_the_terms_to_what_is_expected_of_them(stiff: float) -> None:
    """By the normal equations of all that was seen at the last look, with the scatter of the cells."""
    fit = seen_with_noise(1)
    answer = np.r_[fit.gain * np.array(fit.response)[SHOWS], 1, 1]
    N, H = (np.array(A) * np.outer(answer, answer) + 1e-6 * np.eye(11) for A in (fit.normal, fit.curvature))
    scores = np.array(fit.sums)[:, :11].astype(float) * answer
    before = np.r_[fit.u_x, fit.u_y, fit.alpha, fit.give] + np.r_[fit.step]
    free = np.linalg.inv(N)
    spread = scores @ free
    variance = CELLS * spread.var(axis=0) / (1 - 11 / CELLS)
    together = fit.together()
    assert together == pytest.approx(np.mean(variance[:9] / np.diag(free)[:9]))

    expected = np.full(6, together / stiff if stiff else 1e12)
    for A in (N, H):
        A[range(3, 9), range(3, 9)] += together / expected
    covariance = fit.drawn(ASPECT, together, expected)
    step = np.linalg.inv(N)
    after = before - (scores @ step).sum(axis=0)[:9] - step[:9, 3:9] * together / expected @ before[3:]
    inverse = np.linalg.inv(H)
    pull = inverse[:, 3:9] * together / expected
    found = np.r_[fit.u_x, fit.u_y, fit.alpha, fit.give]
    np.testing.assert_allclose(found, after, atol=1e-2 * np.abs(np.array(fit.step)).max())
    np.testing.assert_allclose(found[3:], after[3:], atol=1e-9)
    spread, used = (scores @ inverse)[:, :3], 11 - np.trace(pull[3:9])
    wanted = (
        spread.T @ spread / (1 - used / CELLS) + pull[:3] * expected @ pull[:3].T + np.diag([0.005, 0.005, 2e-5]) ** 2
    )
    np.testing.assert_allclose(covariance, wanted, rtol=1e-5, atol=np.abs(wanted).min() * 1e-3)
    assert stiff < 1e9 or np.abs(found[3:]).max() < 1e-3, "rigid"


def seen_with_noise(steps: int, responding: bool = True) -> Fit:
    """After a descent into what differs from the keyframe."""
    parts, fit = some(), Fit(0, 0, 0)
    at = parts[1], parts[0]
    parts[4] = speckle(5)[at] + np.random.default_rng(7).normal(0, 60, parts.shape[1])
    points(parts).descend(Picture(speckle(5)), fit, steps, responding=responding)
    return fit


def test_a_fit_that_has_seen_nothing_shows_nothing() -> None:
    """All sums are 0 then, and nothing would look more certain."""
    lost = Fit(1e6, 0, 0)
    points(some()).descend(Picture(speckle()), lost, 1, responding=True)
    unknown = Fit(0, 0, 0, bias=np.nan)
    points(some()).descend(Picture(speckle()), unknown, 1, responding=True)
    assert lost.lost
    assert not unknown.lost
    for fit in (Fit(0, 0, 0), seen_with_noise(0), lost, unknown):
        assert fit.together() < 0
        assert fit.drawn(ASPECT, fit.together(), np.ones(6)) is None


def test_the_correlation_of_a_picture_with_itself_is_at_most_one() -> None:
    """A mean that is large beside the contrast: the difference of two large sums."""
    for seed in range(20):
        level = (2000 + 40 * np.random.default_rng(seed).random((96, 128))).astype(np.int16)
        parts = some(900, seed)
        parts[4] = level[parts[1], parts[0]]
        found, _ = points(parts).correlate(Picture(level), Fit(0, 0, 0), 9.0)
        assert 0.99 < found[0] <= 1.0


def test_correlations_in_place_and_aside() -> None:
    level, parts, fit = speckle(shape=(96, 128)), some(), Fit(29.2, 24.7, 0.02)
    where = places(parts, fit)
    noise = np.random.default_rng(3).normal(0, 300, parts.shape[1])
    parts[4] = looked_up(level, where) + noise
    aside = [[0, 0], [9, 0], [-9, 0], [0, 9], [0, -9]]
    looks = [looked_up(level, where + np.array(step)[:, None]) for step in aside]
    expected = [np.corrcoef(parts[4], look)[0, 1] for look in looks]
    found, share = points(parts).correlate(Picture(level), fit, 9.0)
    assert share == 1.0
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_correlation_with_what_is_constant_is_none() -> None:
    found, _ = points(some()).correlate(Picture(np.full((48, 64), 77, np.int16)), askew(), 12.0)
    assert found == [0.0] * 5


@pytest.mark.parametrize("pitch", [1, 3])
def test_points_have_structure_and_central_differences(pitch: int) -> None:
    level = speckle()
    mask = np.random.default_rng(4).random(level.shape) < 0.7
    down, across = (np.rint(2 * part).astype(int) for part in np.gradient(level.astype(float)))
    steep = np.minimum((np.abs(across) + np.abs(down)) // 9, 511)
    lattice = np.zeros(level.shape, bool)
    lattice[2:-2:pitch, 2:-2:pitch] = True
    counts = np.bincount(steep[lattice], minlength=512)
    held = np.cumsum(counts * np.arange(512.0) ** 2)
    enough = max(int(np.searchsorted(held, 0.02 * held[-1])), 3)

    chosen = Picture(level).structured(mask, pitch, 2, 0.02, 3)
    listed = np.flatnonzero(lattice & mask & (steep > enough))
    band = (60 // pitch // 6 + 1) * pitch
    upright = listed[np.argsort((listed % 64 - 2) // band, kind="stable")]
    np.testing.assert_array_equal(chosen, upright)
    expected = [*np.divmod(chosen, 64)[::-1], across.ravel()[chosen], down.ravel()[chosen], level.ravel()[chosen]]
    np.testing.assert_array_equal(Picture(level).described(chosen, chosen.size), expected)


def test_fewer_points_are_taken_evenly() -> None:
    picture = Picture(speckle())
    chosen = picture.structured(None, 1, 2, 0.02, 3)
    taken = np.arange(100) * chosen.size // 100
    np.testing.assert_array_equal(picture.described(chosen, 100), picture.described(chosen, chosen.size)[:, taken])


def test_steepness_that_16_bits_do_not_hold_is_steep() -> None:
    level = np.random.default_rng(8).integers(-16000, 16000, (48, 64)).astype(np.int16)
    down, across = (np.abs(2 * part) for part in np.gradient(level.astype(float)))
    structure = np.zeros(level.shape, bool)
    structure[2:-2, 2:-2] = (across + down)[2:-2, 2:-2] >= 512 * 9
    np.testing.assert_array_equal(np.sort(Picture(level).structured(None, 1, 2, 0.02, 3)), np.flatnonzero(structure))
    assert Picture(2 * level).structured(None, 1, 2, 0.02, 3).size <= 44 * 60


def test_masks_and_indices_may_be_of_any_kind_of_number_and_lie_anyhow() -> None:
    picture, mask = Picture(speckle()), np.random.default_rng(4).random((48, 64)) < 0.7
    chosen = picture.structured(mask, 1, 2, 0.02, 3)
    for other in (mask.astype(float), np.asfortranarray(mask), 256 * mask.astype(np.int64)):
        np.testing.assert_array_equal(picture.structured(other, 1, 2, 0.02, 3), chosen)
    described = picture.described(chosen, 90)
    for same in (chosen.astype(np.int64), np.repeat(chosen, 2)[::2]):
        np.testing.assert_array_equal(picture.described(same, 90), described)


@pytest.mark.parametrize(("pitch", "edge"), [(1, 0), (1, -2), (0, 2), (-1, 2)])
def test_a_gradient_that_would_look_outside_is_not_taken(pitch: int, edge: int) -> None:
    with pytest.raises(ValueError, match="choose no points"):
        Picture(speckle()).structured(None, pitch, edge, 0.02, 3)


@settings(max_examples=200)
@given(st.lists(st.floats(), min_size=3, max_size=3), st.lists(st.integers(0, 32767), min_size=2, max_size=2))
def test_no_number_makes_it_look_outside_the_picture(fit: list[float], at: list[int]) -> None:
    """Around the picture lies what would show: a look outside would bring it in."""
    side = 9
    around = np.full((3 * side, side), 70, np.int16)
    around[side : 2 * side] = 7
    picture = Picture(around[side : 2 * side])
    parts = np.repeat(np.int16([*at, 50, 50, 0])[:, None], 70, axis=1)
    parts[:2, ::2] = 4
    looked, template = Fit(*fit), points(parts)
    template.descend(picture, looked, 1, responding=True)
    sums = np.array(looked.sums).sum(axis=0)
    assert looked.lost or sums[10] == pytest.approx(7 * sums[13]), "a look outside"
    assert looked.lost or max(looked.response) == pytest.approx(0.2), "a slope, where all is flat"
    assert template.correlate(picture, Fit(*fit), 12.0)[0] == [0.0] * 5


@pytest.mark.parametrize("shape", [(1, 640), (480, 1), (0, 0), (2, 40_000)])
def test_a_picture_too_small_or_too_large_to_look_between_its_pixels_is_refused(shape: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="cannot be looked at"):
        Picture(np.zeros(shape, np.int16))


@pytest.mark.parametrize("shape", [(480, 640), (48, 57), (33, 90), (257, 1100), (1, 9), (9, 1), (2, 2), (1, 1)])
def test_levels_are_smooth_and_each_half_the_one_before(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(6).integers(0, 256, shape).astype(np.uint8)
    levels = pyramid(image).levels
    np.testing.assert_array_equal(levels[0], cv2.boxFilter(image, cv2.CV_16S, (3, 3), normalize=False))
    for k, (fine, half) in enumerate(pairwise(levels)):
        smooth = cv2.blur(fine.astype(float), (3, 3)) if k else fine.astype(float)
        rows, columns = half.shape
        mean = smooth[: 2 * rows, : 2 * columns].reshape(rows, 2, columns, 2).mean(axis=(1, 3))
        np.testing.assert_allclose(half, mean, atol=0.5 + 1e-9)


@pytest.mark.parametrize(
    ("picture", "why"),
    [
        (np.zeros((48, 64), np.uint16), "uint16"),
        (np.zeros((48, 64)), "float64"),
        (np.zeros((48, 64, 3), np.uint8), "shape"),
        (np.zeros(64, np.uint8), "shape"),
        (np.zeros((0, 64), np.uint8), "empty"),
    ],
)
def test_what_is_no_picture_has_no_levels(picture: np.ndarray, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        pyramid(picture)


@pytest.mark.parametrize("lie", [np.asfortranarray, lambda picture: np.repeat(picture, 2, 1)[:, ::2], np.copy])
def test_a_picture_may_lie_anyhow_in_memory(lie: Callable[[np.ndarray], np.ndarray]) -> None:
    image = np.random.default_rng(6).integers(0, 256, (48, 64)).astype(np.uint8)
    for found, expected in zip(pyramid(lie(image)).levels, pyramid(image).levels, strict=True):
        np.testing.assert_array_equal(found, expected)
