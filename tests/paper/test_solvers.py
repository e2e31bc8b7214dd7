"""Every AX = XB solver: exact without noise, unbiased with it, honest about what it knows, and clear about what it
cannot."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from probewatch.appliance.core.handeye.freehand import freehand, solve_freehand
from probewatch.appliance.core.handeye.motions import UNKNOWN, HandEye, Motions, nearest_polarity, rodrigues_rad
from probewatch.appliance.core.handeye.observability import observability
from probewatch.appliance.core.handeye.scaled_rotation import scaled_rotation, solve_scaled_rotation
from probewatch.appliance.core.handeye.sums import Sums
from tests.paper.solvers.averaging import average
from tests.paper.solvers.homogeneous import solve_null_space, solve_two_step
from tests.paper.solvers.likelihood import TrackerNoise, refine
from tests.paper.solvers.norm_constraint import solve_norm_constraint
from tests.paper.solvers.planar import solve_planar
from tests.paper.solvers.three_translations import solve_three_translations
from tests.paper.solvers.two_translations import solve_two_translations
from tests.support.handeye_motions import OFFSET_MM, ROTATION, SCALE, X, motions, picture_moves, rigid

LEVER_MM = ROTATION.T @ OFFSET_MM
ANGLE_RAD = float(np.deg2rad(0.02))
THREE = np.array([[8.0, 1, 1], [-1, 7, 2], [1, -2, 8]])
"""Three translations of the picture, mm, far from dependent."""

METHODS = {
    "qr": lambda m, _: solve_scaled_rotation(m.u, m.t_b, "qr"),
    "polar": lambda m, _: solve_scaled_rotation(m.u, m.t_b),
    "norm": lambda m, _: solve_norm_constraint(m.u, m.t_b),
    "two translations": lambda m, _: solve_two_translations(m.u[:2], m.t_b[:2]),
    "three translations": lambda m, _: solve_three_translations(m.u[:3], m.t_b[:3]),
    "planar": lambda m, _: solve_planar(m),
    "freehand": lambda m, _: solve_freehand(m.u, m.displacements(LEVER_MM)),
    "null space": lambda m, _: solve_null_space(m),
    "two steps": lambda m, _: solve_two_step(m),
    "likelihood": lambda m, noise: refine(m, near(m), noise),
    "likelihood, freehand": lambda m, noise: refine(m, near(m), noise, picture_rows=True),
}
GIVEN = {
    # method: (spread mm, spread of turns rad, scales, sure of t_x)
    "qr": (np.array([4, 4, 0]), 0.0, 2, 0),
    "polar": (np.array([4, 4, 0]), 0.0, 2, 0),
    "norm": (np.array([4, 4, 0]), 0.0, 2, 0),
    "two translations": ("three", 0.0, 2, 0),
    "three translations": ("three", 0.0, 2, 0),
    "planar": (np.array([4, 4, 0]), np.array([0, 0, 0.1]), 2, 2),
    "freehand": (np.array([4, 4, 4]), np.array([0.03, 0.03, 0.1]), 2, 0),
    "null space": (np.array([4, 4, 4]), 0.1, 3, 3),
    "two steps": (np.array([4, 4, 4]), 0.1, 3, 3),
    "likelihood": (np.array([4, 4, 0]), np.array([0, 0, 0.1]), 2, 2),
    "likelihood, freehand": (np.array([4, 4, 4]), np.array([0.035, 0.035, 0.1]), 2, 3),
}


def near(m: Motions) -> HandEye:
    """A start that is off by 5° about three axes, 5 % and 3 mm."""
    turn = Rotation.from_rotvec([0.05, -0.05, 0.05]).as_matrix()
    return HandEye(turn @ ROTATION, SCALE[: m.u.shape[1]] * 1.05, OFFSET_MM + 3, UNKNOWN)


def given(
    method: str, seed: int, position_mm: float = 0.0, angle_rad: float = 0.0, n: int = 40, scales: int = 0
) -> Motions:
    spread, turn, usual, _ = GIVEN[method]
    if isinstance(spread, str):
        flat = THREE * ([1, 1, 0] if method.startswith("two") and scales != 3 else 1)
        moves = rigid(np.zeros((3, 3)), flat)
    else:
        moves = picture_moves(np.random.default_rng(seed), n, spread, turn)
    return motions(moves, seed, position_mm, angle_rad, scales or usual)


def error(found: HandEye, offsets: int = 3) -> np.ndarray:
    """Rotation rad (3), relative scale (k), offset mm."""
    turn = Rotation.from_matrix(found.rotation @ ROTATION.T).as_rotvec()
    return np.concatenate([turn, found.scale / SCALE[: len(found.scale)] - 1, (found.offset_mm - OFFSET_MM)[:offsets]])


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("method", METHODS)
def test_without_noise_every_method_is_exact(method: str, seed: int) -> None:
    found = METHODS[method](given(method, seed), TrackerNoise(0.001, 1e-7))
    np.testing.assert_allclose(error(found, GIVEN[method][3]), 0, atol=1e-9)
    assert np.linalg.det(found.rotation) == pytest.approx(1)


@pytest.mark.parametrize("method", ["polar", "qr", "norm", "two translations", "three translations", "likelihood"])
def test_a_volume_gives_three_scales(method: str) -> None:
    spread = dict(GIVEN)[method][0]
    moves = (
        rigid(np.zeros((3, 3)), THREE)
        if isinstance(spread, str)
        else picture_moves(np.random.default_rng(3), 12, 4.0, 0.0)
    )
    found = METHODS[method](motions(moves, 3, scales=3), TrackerNoise(0.1, ANGLE_RAD))
    np.testing.assert_allclose(error(found, 0), 0, atol=1e-9)
    assert found.scale.shape == (3,)


def test_two_general_motions_are_enough_for_the_homogeneous_system() -> None:
    pair = motions(picture_moves(np.random.default_rng(5), 2, 5.0, 0.3), scales=3)
    np.testing.assert_allclose(error(solve_null_space(pair)), 0, atol=1e-9)
    np.testing.assert_allclose(error(solve_two_step(pair)), 0, atol=1e-9)


def test_the_offset_of_planar_motion_is_a_line_along_the_picture_normal() -> None:
    found = solve_planar(given("planar", 1))
    zeta = OFFSET_MM[2]
    np.testing.assert_allclose(found.offset_mm + zeta * found.free, OFFSET_MM, atol=1e-9)
    np.testing.assert_array_equal(found.free, [0, 0, 1])
    still = solve_planar(motions(picture_moves(np.random.default_rng(1), 8, np.array([4, 4, 0]), 0.0)))
    np.testing.assert_allclose(error(still, 0), 0, atol=1e-9)
    assert np.isnan(still.offset_mm).all()


def test_the_printed_equation_5_would_be_wrong() -> None:
    """Without (I − R_a) t_x noise-free turns leave an error of many degrees: what the corrected form is for."""
    m = given("planar", 2)
    literal = solve_scaled_rotation(m.u, m.t_b)
    assert np.degrees(np.linalg.norm(error(literal, 0)[:3])) > 5
    np.testing.assert_allclose(error(solve_scaled_rotation(m.u, m.displacements(LEVER_MM)), 0), 0, atol=1e-9)


ALONG = motions(rigid(np.zeros((4, 3)), np.outer([1.0, 2, -3, 4], [3, 4, 0])))
FLAT = motions(picture_moves(np.random.default_rng(0), 9, np.array([4, 4, 0]), 0.0))
ONE_AXIS = motions(picture_moves(np.random.default_rng(0), 9, 4.0, np.array([0, 0, 0.2])), scales=3)


@pytest.mark.parametrize(
    ("solve", "says"),
    [
        (lambda: solve_scaled_rotation(ALONG.u, ALONG.t_b), "span 2 directions"),
        (lambda: solve_norm_constraint(ALONG.u, ALONG.t_b), "span 2 directions"),
        (lambda: solve_two_translations(ALONG.u[:2], ALONG.t_b[:2]), "span 2 directions"),
        (lambda: solve_planar(ALONG), "span 2 directions"),
        (lambda: solve_three_translations(FLAT.u[:3], FLAT.t_b[:3]), "span 3 directions"),
        (lambda: solve_freehand(FLAT.u, FLAT.t_b), "span 3 directions|planar form"),
        (lambda: solve_two_step(ONE_AXIS), "two axes"),
        (lambda: solve_null_space(ONE_AXIS), "more than one solution"),
        (lambda: solve_norm_constraint(FLAT.u, 0 * FLAT.t_b), "no positive scale"),
    ],
)
def test_motion_that_does_not_determine_the_answer_is_refused(solve, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        solve()


@pytest.mark.parametrize("polarity", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_polarity_is_what_leaves_the_rotation_nearest(polarity: tuple[int, int]) -> None:
    moves = picture_moves(np.random.default_rng(4), 20, np.array([4, 4, 0]), np.array([0, 0, 0.1]))
    seen = motions(moves)
    alpha = -Rotation.from_matrix(moves[:, :3, :3]).as_rotvec()[:, 2]
    first = rigid(np.random.default_rng(1).normal(0, 1, (20, 3)), np.zeros((20, 3)))
    mirrored = Motions.of_pictures(seen.u * polarity, alpha * np.prod(polarity), first @ X, first @ moves @ X)
    found, told = nearest_polarity(solve_planar(mirrored), ROTATION)
    assert told == polarity
    np.testing.assert_allclose(error(found, 2), 0, atol=1e-9)
    corrected = Motions.of_pictures(
        seen.u * polarity, alpha * np.prod(polarity), first @ X, first @ moves @ X, polarity
    )
    np.testing.assert_allclose(error(solve_planar(corrected), 2), 0, atol=1e-9)


def test_a_lateral_flip_looks_like_half_a_turn_as_in_table_1() -> None:
    """A sensor turned by 176° about image depth: unflipped 3.07, flipped 0.07 or thereabouts."""
    sensor = Rotation.from_rotvec([0, 3.07, 0]).as_matrix()
    t_a = np.random.default_rng(2).normal(0, 4, (20, 3)) * [1, 1, 0]
    u, t_b = t_a[:, :2] / SCALE[:2], t_a @ sensor
    assert rodrigues_rad(solve_norm_constraint(u, t_b).rotation) == pytest.approx(3.07)
    assert rodrigues_rad(solve_norm_constraint(u * [-1, 1], t_b).rotation) == pytest.approx(np.pi - 3.07)


def study(method: str, runs: int, position_mm: float) -> tuple[np.ndarray, np.ndarray | None]:
    """(runs, p) errors, and the sigmas where the method gives them."""
    noise = TrackerNoise(position_mm, ANGLE_RAD)
    found = [METHODS[method](given(method, seed, position_mm, ANGLE_RAD), noise) for seed in range(runs)]
    errors = np.array([error(f, GIVEN[method][3]) for f in found])
    if found[0].covariance is None:
        return errors, None
    return errors, np.array([np.sqrt(np.diag(f.covariance))[: errors.shape[1]] for f in found])


def check_statistics(method: str, runs: int, position_mm: float, bias: float, one: float, two: float) -> None:
    errors, sigmas = study(method, runs, position_mm)
    assert np.all(np.abs(errors.mean(axis=0)) < bias * errors.std(axis=0)), errors.mean(axis=0) / errors.std(axis=0)
    if sigmas is not None:
        np.testing.assert_allclose(np.mean(np.abs(errors) < sigmas, axis=0), 0.683, atol=one)
        np.testing.assert_allclose(np.mean(np.abs(errors) < 1.96 * sigmas, axis=0), 0.95, atol=two)


UNBIASED = [method for method in METHODS if method not in ("norm", "null space")]


@pytest.mark.parametrize("method", UNBIASED)
def test_errors_scatter_about_zero(method: str) -> None:
    check_statistics(method, 80, 0.25, bias=0.4, one=0.16, two=0.08)


@pytest.mark.slow
@pytest.mark.parametrize("position_mm", [0.1, 0.25])
@pytest.mark.parametrize("method", UNBIASED)
def test_errors_scatter_about_zero_over_a_thousand_runs(method: str, position_mm: float) -> None:
    check_statistics(method, 1000, position_mm, bias=0.2, one=0.05, two=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("position_mm", [0.1, 0.25])
def test_the_null_space_of_equation_3_is_biased_and_its_two_steps_are_not(position_mm: float) -> None:
    once, _ = study("null space", 1000, position_mm)
    steps, _ = study("two steps", 1000, position_mm)
    if position_mm > 0.2:
        assert np.abs(once.mean(axis=0) / once.std(axis=0)).max() > 0.2
    assert np.all(steps.std(axis=0) < 1.02 * once.std(axis=0))


@pytest.mark.parametrize("position_mm", [0.1, 0.25])
def test_the_norm_constraint_is_biased_upwards_by_noise_and_the_linear_form_is_not(position_mm: float) -> None:
    """Steps of 1 mm: the squared noise of two readings, 6 σ², is not small against 2 mm²."""
    norm, linear = [], []
    for seed in range(100):
        m = motions(picture_moves(np.random.default_rng(seed), 300, np.array([1.0, 1, 0]), 0.0), seed, position_mm)
        norm.append(error(solve_norm_constraint(m.u, m.t_b), 0)[3:])
        linear.append(error(solve_scaled_rotation(m.u, m.t_b), 0)[3:])
    # E|t_b|² = |Λu|² + 6σ², spread over u_x² and u_y²: each of variance 1 and fourth moment 3.
    expected = np.sqrt(1 + 6 * position_mm**2 / 4) - 1
    np.testing.assert_allclose(np.mean(norm, axis=0), expected, rtol=0.15)
    assert np.all(np.abs(np.mean(linear, axis=0)) < 0.3 * np.std(linear, axis=0))


def test_running_sums_give_the_same_answer_as_all_motions_at_once() -> None:
    m = given("freehand", 3, 0.1, ANGLE_RAD)
    v = m.displacements(LEVER_MM)
    sums = Sums.empty()
    for u_i, v_i in zip(m.u, v, strict=True):
        sums = sums.after(u_i, v_i)
    for streamed, batch in (
        (freehand(sums), solve_freehand(m.u, v)),
        (scaled_rotation(sums), solve_scaled_rotation(m.u, v)),
    ):
        np.testing.assert_allclose(streamed.rotation, batch.rotation, atol=1e-12)
        np.testing.assert_allclose(streamed.scale, batch.scale, rtol=1e-12)


def test_forgetting_follows_a_change_of_scale() -> None:
    """Twenty motions' memory: sixty motions after a 10 % change nothing of the old scale is left."""
    before, after = given("polar", 1, n=100), given("polar", 2, n=60)
    sums = Sums.empty()
    for u_i, v_i in zip(np.vstack([before.u, after.u * 1.1]), np.vstack([before.t_b, after.t_b]), strict=True):
        sums = sums.after(u_i, v_i, keep=0.95)
    assert sums.weight == pytest.approx(20, abs=0.1)
    np.testing.assert_allclose(scaled_rotation(sums).scale * 1.1, SCALE[:2], rtol=0.01)


@pytest.mark.thorough
def test_the_average_of_a_hundred_calibrations_is_ten_times_as_good_and_says_so() -> None:
    errors, sigmas = [], []
    for run in range(30):
        parts = [METHODS["polar"](given("polar", 1000 * run + k, 0.25, ANGLE_RAD, n=12), None) for k in range(100)]
        mean = average(parts)
        assert mean.count == 100
        errors.append(error(mean.mean, 0))
        sigmas.append(np.sqrt(np.diag(mean.mean.covariance))[:5])
        assert mean.scatter == pytest.approx(1, abs=0.5)
    single = np.sqrt(np.diag(parts[0].covariance))[:5]
    assert np.all(np.std(errors, axis=0) < single / 6)
    np.testing.assert_allclose(np.mean(np.abs(errors) < sigmas), 0.68, atol=0.15)


def test_an_average_of_contradictions_admits_its_scatter() -> None:
    parts = [METHODS["polar"](given("polar", k, 0.1, ANGLE_RAD), None) for k in range(10)]
    bent = [replace(part, scale=part.scale * (1.1 if k % 2 else 1)) for k, part in enumerate(parts)]
    assert average(bent).scatter > 5
    assert average(bent).mean.covariance[3, 3] > 5 * average(parts).mean.covariance[3, 3]
    with pytest.raises(ValueError, match="no calibration"):
        average([])


def test_observability_counts_in_degrees_percent_and_millimetres() -> None:
    sigma = np.deg2rad(0.5), 0.02, 0.25
    seen = observability(np.diag([sigma[0] ** -2] * 3 + [sigma[1] ** -2] * 2 + [sigma[2] ** -2, 0, 0]))
    np.testing.assert_allclose(seen.singular, [4, 2, 2, 2, 0.5, 0.5, 0, 0])
    assert seen.known == (True, True, True, False, False, True, False, False)
    np.testing.assert_allclose(seen.sigma[:6], [0.5, 0.5, 0.5, 2, 2, 0.25])
    assert np.isinf(seen.sigma[6:]).all()


def test_motion_along_one_line_shows_one_scale_only() -> None:
    m = motions(picture_moves(np.random.default_rng(0), 20, np.array([4, 0, 0]), 0.0))
    seen = observability(Sums.of(m.u, m.t_b).information(ROTATION, SCALE[:2], 0.1))
    assert seen.known == (False, True, True, True, False, False, False, False)


def test_likelihood_leaves_alone_what_no_motion_shows() -> None:
    m = given("planar", 1)
    start = near(m)
    found = refine(m, start, TrackerNoise(0.1, ANGLE_RAD))
    assert found.offset_mm[2] == start.offset_mm[2]
    assert np.isinf(found.covariance[7, 7])
    assert np.isfinite(np.diag(found.covariance)[:7]).all()
