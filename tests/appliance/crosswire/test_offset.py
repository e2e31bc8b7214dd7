"""ζ and the whole offset from one point seen from many sides: theory, a search, and when it must refuse."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar
from scipy.spatial.transform import Rotation

from probewatch.appliance.crosswire.offset import (
    Demand,
    OffsetSolution,
    ScanRefused,
    refuse_slid,
    renewed,
    solve_offset,
    solve_zeta,
)
from probewatch.appliance.types import Calibration

LOCALISATION_MM = 0.3
TRUTH = Calibration(
    Rotation.from_rotvec([0.6, -0.4, 0.9]).as_matrix(),
    (-1, 1),
    np.array([0.21, 0.26]),
    np.array([11.0, 62.0, 14.0]),
    (640, 480),
)
BLIND = replace(TRUTH, offset_mm=np.array([11.0, 62.0, -5.0]))
ANYTHING = Demand(sigma_mm=np.inf, tilt_deg=0.0)


def scan(seed: int, views: int, tilt_deg: float, turn_deg: float = 10.0, noise_mm: float = LOCALISATION_MM):
    """(N, 2) pixels and (N, 4, 4) poses; the noise of a view goes into the position that its pose reports."""
    random = np.random.default_rng(seed)
    crossing = np.array([64.0, -87.0, -1520.0])
    hand = Rotation.from_rotvec([1.9, 0.7, -0.5])
    pixels = random.uniform([150, 100], [490, 380], (views, 2))
    poses = np.tile(np.eye(4), (views, 1, 1))
    for pose, pixel in zip(poses, pixels, strict=True):
        tilt = np.radians(random.normal(0, [tilt_deg, tilt_deg, turn_deg]))
        turn = (hand * Rotation.from_rotvec(tilt)).as_matrix()
        in_picture = np.array([*((pixel - [319.5, 239.5]) * TRUTH.polarity * TRUTH.scale_mm_per_px), 0.0])
        pose[:3, :3] = turn @ TRUTH.rotation
        pose[:3, 3] = crossing - pose[:3, :3] @ TRUTH.rotation.T @ (in_picture - TRUTH.offset_mm)
        pose[:3, 3] += random.normal(0, noise_mm, 3)
    return pixels, poses


def lines(pixels, poses):
    """a and n of Eq. 7, spelled out view by view."""
    a, n = [], []
    for pixel, pose in zip(pixels, poses, strict=True):
        x, y = (pixel - [319.5, 239.5]) * [-0.21, 0.26]
        to_tracker = pose[:3, :3] @ TRUTH.rotation.T
        a.append(to_tracker @ (np.array([x, y, 0]) - [11.0, 62.0, 0]) + pose[:3, 3])
        n.append(to_tracker @ [0, 0, -1.0])
    return np.array(a), np.array(n)


def test_noise_free_views_give_the_offset_exactly() -> None:
    views = scan(1, 12, 10, noise_mm=0)
    assert solve_zeta(*views, BLIND).zeta_mm == pytest.approx(14, abs=1e-9)
    nothing_known = replace(TRUTH, offset_mm=np.zeros(3))
    np.testing.assert_allclose(solve_offset(*views, nothing_known).offset_mm, TRUTH.offset_mm, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("tilt_deg", [5, 20])
def test_closed_form_is_where_the_cloud_is_smallest(seed: int, tilt_deg: float) -> None:
    pixels, poses = scan(seed, 20, tilt_deg)
    solution = solve_zeta(pixels, poses, BLIND, ANYTHING)
    assert solution.kept.all()
    a, n = lines(pixels, poses)

    def size(zeta: float) -> float:
        return float(np.sum((a - a.mean(axis=0) + zeta * (n - n.mean(axis=0))) ** 2))

    slope_vanishes = brentq(lambda zeta: size(zeta + 20) - size(zeta - 20), -100, 100, xtol=1e-13)
    assert solution.zeta_mm == pytest.approx(slope_vanishes, abs=1e-12)
    blind_search = minimize_scalar(size, bracket=(-50, 50), tol=1e-12)
    assert solution.zeta_mm == pytest.approx(blind_search.x, abs=1e-5)
    assert solution.cloud_after_mm == pytest.approx(np.sqrt(size(solution.zeta_mm) / 20))
    assert solution.cloud_before_mm == pytest.approx(np.sqrt(size(-5.0) / 20))


@cache
def solutions(views: int, tilt_deg: float, runs: int) -> tuple[OffsetSolution, ...]:
    return tuple(solve_zeta(*scan(run, views, tilt_deg), BLIND, ANYTHING) for run in range(runs))


TABLE_MM = {20: {2: 1.4, 5: 0.60, 10: 0.28, 20: 0.16, 30: 0.11}, 50: {2: 0.94, 5: 0.40, 10: 0.19, 20: 0.10, 30: 0.07}}


def check_against_theory(views: int, tilt_deg: float, runs: int) -> None:
    found = solutions(views, tilt_deg, runs)
    errors_mm = np.array([solution.zeta_mm for solution in found]) - 14
    formula_mm = np.array([s.zeta_sigma_mm / s.localisation_mm * LOCALISATION_MM for s in found])
    assert np.std(errors_mm / formula_mm) == pytest.approx(1, abs=0.10)
    assert np.std(errors_mm) == pytest.approx(TABLE_MM[views][tilt_deg], rel=0.17)
    assert abs(errors_mm.mean()) < 3.5 * errors_mm.std() / np.sqrt(runs)
    assert np.mean([s.localisation_mm for s in found]) == pytest.approx(LOCALISATION_MM, rel=0.03)
    assert np.median([s.tilt_sd_deg for s in found]) == pytest.approx(tilt_deg, rel=0.2)


@pytest.mark.parametrize("tilt_deg", [10, *(pytest.param(tilt, marks=pytest.mark.thorough) for tilt in (2, 5, 20, 30))])
def test_zeta_scatters_as_the_formula_says(tilt_deg: float) -> None:
    check_against_theory(20, tilt_deg, 300)


@pytest.mark.slow
@pytest.mark.parametrize("views", [20, 50])
@pytest.mark.parametrize("tilt_deg", [2, 5, 10, 20, 30])
def test_zeta_scatters_as_the_formula_says_over_thousands_of_scans(views: int, tilt_deg: float) -> None:
    check_against_theory(views, tilt_deg, 3000)


def test_stated_sigma_covers_the_truth() -> None:
    ratios = [abs(s.zeta_mm - 14) / s.zeta_sigma_mm for s in solutions(20, 10, 300)[:200]]
    assert np.mean(np.array(ratios) < 1) == pytest.approx(0.68, abs=0.08)
    assert np.mean(np.array(ratios) < 2.5) > 0.97
    assert sum(ratio < 2.5 for ratio in ratios[:20]) >= 19


def test_stated_sigma_of_the_whole_offset_covers_the_truth() -> None:
    slid = replace(TRUTH, offset_mm=np.array([5.0, 70.0, 20.0]))
    found = [solve_offset(*scan(seed, 20, 10), slid) for seed in range(100)]
    ratios = np.abs([(s.offset_mm - TRUTH.offset_mm) / s.sigma_mm for s in found])
    np.testing.assert_allclose(np.mean(ratios < 1, axis=0), 0.68, atol=0.13)


def test_gross_outliers_are_rejected_and_counted() -> None:
    clean = scan(3, 25, 10)
    spoiled = clean[0].copy(), clean[1].copy()
    spoiled[0][[2, 11]] += [120, -60], [-40, 90]
    spoiled[1][[5, 20], :3, 3] += [[0, 30, 5], [400, 0, 0]]
    expected = np.ones(25, dtype=bool)
    expected[[2, 5, 11, 20]] = False
    for solve in (solve_zeta, solve_offset):
        solution = solve(*spoiled, BLIND)
        np.testing.assert_array_equal(solution.kept, expected)
        assert (solution.views, solution.rejected) == (21, 4)
        alone = solve(clean[0][expected], clean[1][expected], BLIND)
        np.testing.assert_allclose(solution.offset_mm, alone.offset_mm, rtol=1e-12)


def test_outliers_that_agree_among_themselves_do_not_win() -> None:
    pixels, poses = scan(4, 20, 10)
    pixels[:4] += [100, 0]
    solution = solve_zeta(pixels, poses, BLIND)
    assert not solution.kept[:4].any()
    assert abs(solution.zeta_mm - 14) < 2.5 * solution.zeta_sigma_mm


def test_a_scan_full_of_contradictions_is_refused() -> None:
    pixels, poses = scan(4, 20, 10)
    pixels[:6] += np.random.default_rng(0).uniform(60, 150, (6, 2))
    with pytest.raises(ScanRefused, match="6 of 20 views contradict"):
        solve_zeta(pixels, poses, BLIND)


@pytest.mark.parametrize(
    ("views", "tilt_deg", "demand", "says"),
    [
        (0, 20, None, "0 usable views of the crossing, 8 are needed"),
        (7, 20, None, "7 usable views of the crossing, 8 are needed"),
        (20, 2, None, r"tilt spread is [12]\.\d° over 20 views, 5° is needed"),
        (20, 0, None, "5° is needed"),
        (9, 7, Demand(sigma_mm=0.2), r"9 views of 0\.[23]\d* mm over .* ± 0\.2 mm is asked \(ζ needs [12]\d\.\d°\)"),
        (20, 0, ANYTHING, "give ± inf mm"),
    ],
)
def test_what_the_scan_cannot_support_is_refused_with_figures(views, tilt_deg, demand, says) -> None:
    pixels, poses = scan(2, max(views, 1), tilt_deg)
    with pytest.raises(ScanRefused, match=says):
        solve_zeta(pixels[:views], poses[:views], BLIND, demand)


def test_the_whole_offset_needs_rotation_and_says_so() -> None:
    pixels, poses = scan(2, 20, 0, turn_deg=0)
    with pytest.raises(ScanRefused, match="inf"):
        solve_offset(pixels, poses, BLIND, ANYTHING)


def test_the_tilt_that_would_do_is_the_tilt_that_does() -> None:
    views = scan(5, 40, 15)
    solution = solve_zeta(*views, BLIND, Demand(sigma_mm=0.2, tilt_deg=0.0))
    shrunk = solution.tilt_needed_deg / solution.tilt_sd_deg
    assert solution.zeta_sigma_mm == pytest.approx(0.2 * shrunk, rel=1e-9)


def test_a_marker_that_slid_in_the_plane_is_noticed() -> None:
    views = scan(6, 20, 10)
    refuse_slid(*views, BLIND)
    slid = replace(BLIND, offset_mm=np.array([15.0, 59.0, -5.0]))
    with pytest.raises(ScanRefused, match=r"by -[34]\.\d mm laterally and \+[23]\.\d mm axially"):
        refuse_slid(*views, slid)
    assert np.linalg.norm(solve_offset(*views, slid).offset_mm - TRUTH.offset_mm) < 1


def test_what_cannot_be_seen_in_the_plane_is_not_held_against_the_scan() -> None:
    refuse_slid(*scan(6, 20, 0, turn_deg=0), replace(BLIND, offset_mm=np.array([20.0, 50.0, 0.0])))


def test_the_new_calibration_keeps_all_but_what_was_solved() -> None:
    known = replace(BLIND, covariance=np.diag(np.arange(1.0, 9.0)), observed=(True,) * 7 + (False,))
    zeta = solve_zeta(*scan(7, 20, 10), known)
    new = renewed(known, zeta)
    assert new.offset_mm[2] == zeta.zeta_mm
    np.testing.assert_array_equal(new.offset_mm[:2], known.offset_mm[:2])
    np.testing.assert_array_equal(new.rotation, known.rotation)
    np.testing.assert_allclose(np.diag(new.covariance), [1, 2, 3, 4, 5, 6, 7, zeta.zeta_sigma_mm**2])
    assert all(new.observed)
    assert renewed(BLIND, zeta).covariance is None
    whole = solve_offset(*scan(7, 20, 10), known)
    np.testing.assert_allclose(np.diag(renewed(known, whole).covariance)[5:], whole.sigma_mm**2)
