"""All eight parameters from nothing: exact without noise, honest with it, whichever way the marker body is mounted."""

from dataclasses import replace
from itertools import permutations, product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from probewatch.appliance.crosswire.expected_error import expected_error_mm
from probewatch.appliance.crosswire.offset import Demand, ScanRefused, solve_zeta
from probewatch.appliance.crosswire.whole import solve_whole
from tests.support.crossings import CROSSING_MM, SIZE_PX, TRUE, errors, guided_views

QUIET = {"noise_mm": 0.0, "noise_deg": 0.0, "noise_px": 0.0}


def test_noise_free_views_give_everything_exactly() -> None:
    solution = solve_whole(guided_views(1, 30, **QUIET), SIZE_PX)
    np.testing.assert_allclose(errors(solution), 0, atol=1e-7)
    np.testing.assert_allclose(solution.crossing_mm, CROSSING_MM, atol=1e-6)
    np.testing.assert_allclose(solution.points_mm, np.tile(CROSSING_MM, (30, 1)), atol=1e-6)
    np.testing.assert_allclose(solution.residual_mm, 0, atol=1e-6)
    assert solution.kept.all()


def mountings() -> list[np.ndarray]:
    """The 24 ways in which a marker body's axes can lie along those of the picture."""
    found = []
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        axes = np.eye(3)[list(order)] * np.array(signs)[:, None]
        if np.linalg.det(axes) > 0:
            found.append(axes)
    return found


@pytest.mark.parametrize(
    "index", [0, 5, 11, 17, *(pytest.param(i, marks=pytest.mark.thorough) for i in (2, 8, 14, 20, 23))]
)
@pytest.mark.parametrize("polarity", [(1, 1), (-1, 1)])
def test_no_mounting_of_the_marker_body_needs_a_first_guess(index: int, polarity: tuple[int, int]) -> None:
    slightly = Rotation.from_rotvec([0.1, -0.2, 0.15]).as_matrix()
    true = replace(TRUE, rotation=slightly @ mountings()[index], polarity=polarity)
    solution = solve_whole(guided_views(index, 40, true=true), SIZE_PX, polarity)
    assert np.all(np.abs(errors(solution, true)) < 4.5 * solution.sigma)


def test_a_mirrored_picture_is_a_turned_marker_body() -> None:
    """Both put every point of the picture in the same place: the polarity is for the caller to say."""
    views = guided_views(3, 40)
    plain, mirrored = solve_whole(views, SIZE_PX), solve_whole(views, SIZE_PX, (-1, 1))
    turned = np.diag([-1.0, 1.0, -1.0])
    np.testing.assert_allclose(mirrored.calibration.rotation, turned @ plain.calibration.rotation, atol=1e-6)
    np.testing.assert_allclose(mirrored.points_mm, plain.points_mm, atol=1e-5)


def coverage(runs: int) -> tuple[np.ndarray, list]:
    found = [solve_whole(guided_views(seed), SIZE_PX, latency_sigma_s=0.1) for seed in range(runs)]
    return np.array([errors(solution) / solution.sigma for solution in found]), found


@pytest.mark.thorough
def test_stated_sigmas_are_the_scatter() -> None:
    ratios, found = coverage(20)
    assert np.mean(np.abs(ratios) < 1) == pytest.approx(0.68, abs=0.1)
    assert np.abs(ratios).max() < 4.5
    assert all(0.03 < solution.expected_mm < 0.1 for solution in found)


@pytest.mark.slow
def test_stated_sigmas_cover_as_they_say_in_four_hundred_scans() -> None:
    ratios, _found = coverage(400)
    np.testing.assert_allclose(np.mean(np.abs(ratios) < 1, axis=0), 0.683, atol=0.07)
    assert np.mean(np.abs(ratios) < 1) == pytest.approx(0.683, abs=0.03)


def test_the_promised_error_is_that_of_reconstructed_points() -> None:
    off_mm, promised_mm = [], []
    for seed in range(20):
        solution = solve_whole(guided_views(seed, 60), SIZE_PX)
        found = solution.calibration
        place_px = np.random.default_rng(seed).uniform(-120, 120, (20, 2))
        told = [
            (np.column_stack([place_px * one.scale_mm_per_px, np.zeros(20)]) - one.offset_mm) @ one.rotation
            for one in (found, TRUE)
        ]
        off_mm.append(np.mean(np.sum((told[0] - told[1]) ** 2, axis=1)))
        promised_mm.append(expected_error_mm(found) ** 2)
    assert np.sqrt(np.mean(off_mm)) == pytest.approx(np.sqrt(np.mean(promised_mm)), rel=0.35)


def test_one_bad_view_in_five_is_rejected_by_index() -> None:
    views = guided_views(7, 50)
    bad = [3, 11, 17, 20, 29, 33, 40, 44, 45, 49]
    random = np.random.default_rng(1)
    for index in bad:
        views[index] = replace(views[index], centre_px=views[index].centre_px + random.choice([-1, 1], 2) * 80)
    solution = solve_whole(views, SIZE_PX)
    assert np.flatnonzero(~solution.kept).tolist() == bad
    assert np.all(np.abs(errors(solution)) < 4.5 * solution.sigma)


def test_views_of_nothing_are_refused() -> None:
    views = guided_views(8, 30)
    random = np.random.default_rng(2)
    views = [replace(view, centre_px=random.uniform([0, 0], SIZE_PX)) for view in views]
    assert solve_whole(views, SIZE_PX).localisation_mm > 2, "what fits nothing says so by its noise"
    with pytest.raises(ScanRefused, match="5 views of the crossing, 6 are needed"):
        solve_whole(views[:5], SIZE_PX)


def test_how_late_the_tracker_is_follows_from_passages_to_and_fro() -> None:
    solution = solve_whole(guided_views(9, 100, late_s=0.065), SIZE_PX, latency_sigma_s=0.1)
    assert abs(solution.latency_s - 0.065) < 4 * solution.latency_sigma_s < 0.016
    assert np.all(np.abs(errors(solution)) < 4.5 * solution.sigma)


def test_passages_in_one_direction_leave_the_latency_open_and_zeta_with_it() -> None:
    """Their speeds differ, so something is left to see; but less, and ζ says so."""
    both = solve_whole(guided_views(10, 60), SIZE_PX, latency_sigma_s=0.1)
    one = solve_whole(guided_views(10, 60, one_way=True), SIZE_PX, latency_sigma_s=0.1)
    assert one.latency_sigma_s > 2 * both.latency_sigma_s
    assert one.sigma[7] > 1.2 * both.sigma[7]


def test_the_closed_form_agrees() -> None:
    views = guided_views(11, 80)
    solution = solve_whole(views, SIZE_PX)
    centres, poses = np.array([view.centre_px for view in views]), np.array([view.matrix for view in views])
    closed = solve_zeta(centres, poses, solution.calibration, Demand())
    assert abs(closed.zeta_mm - solution.calibration.offset_mm[2]) < 2 * closed.zeta_sigma_mm
