"""The bound on the error of a point: held against draws, against exact geometry, and against a fine grid."""

from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.quality.examination import Finding, examine, without
from probewatch.appliance.core.quality.point_error import (
    Change,
    Places,
    bounds_at,
    change_of,
    grid_mm,
    longest,
    slope_of_places,
)
from probewatch.appliance.limits import Limits, Region
from probewatch.appliance.types import PARAMETERS
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.rigid import Array, rotation_from_vector
from tests.support.motions import TRUTH, tilting_path
from tests.support.windows import filled

STILL = np.zeros((3, 4))
HAND = np.array([[0.0, -0.1, 0.2, 20.0], [0.1, 0.0, 0.1, -15.0], [-0.2, -0.1, 0.0, 8.0]])
"""mm/s: of a hand that slides and turns."""
SIGMAS = np.array([*np.deg2rad([0.4, 0.3, 0.35]), 0.005, 0.006, 0.7, 0.6, 0.8, 0.006])
"""rad, relative, mm, s: about what a gesture shows."""


def change(seed: int, about: float = 1.0, sigmas: Array = SIGMAS) -> Change:
    """A posterior whose parameters are correlated at random, and whose mean is so many sigmas away."""
    random = np.random.default_rng(seed)
    mixed = random.standard_normal((9, 30))
    correlation = np.corrcoef(mixed)
    return Change(about * sigmas * random.standard_normal(9), correlation * np.outer(sigmas, sigmas), 0.0, 7)


def shown_at(at_mm: Array, theta: Array, pace: Array) -> Array:
    """(k, 9) and (n, 3) → (k, n, 3): exactly how far the place in the room is from where the reference puts it, in the
    axes of the picture: what `changed` makes of the reference, and the way of the hand during the lag.
    """
    turns, scales = rotation_from_vector(theta[:, :3]), 1 + np.pad(theta[:, 3:5], ((0, 0), (0, 1)))
    truth = np.einsum("kji,knj->kni", turns, scales[:, None] * at_mm - TRUTH.offset_mm - theta[:, None, 5:8])
    return truth - (at_mm - TRUTH.offset_mm) + theta[:, 8, None, None] * (at_mm @ pace[:, :3].T + pace[:, 3])


def test_the_exact_error_is_that_of_the_changed_calibration() -> None:
    theta = 0.5 * SIGMAS
    theta[8] = 0.0
    truth, at_mm = TRUTH.changed(theta[:8]), grid_mm(TRUTH, Region(), 3)
    pixels_mm = at_mm / np.append(TRUTH.scale_mm_per_px, 1.0) * np.append(truth.scale_mm_per_px, 1.0)
    in_sensor = (pixels_mm - truth.offset_mm) @ truth.rotation, (at_mm - TRUTH.offset_mm) @ TRUTH.rotation
    error = (in_sensor[0] - in_sensor[1]) @ TRUTH.rotation.T
    assert np.allclose(shown_at(at_mm, theta[None], STILL)[0], error, atol=1e-12)


def test_the_slope_is_the_derivative_of_the_error() -> None:
    at_mm, step = grid_mm(TRUTH, Region(), 3), 1e-6
    slope = slope_of_places(at_mm, TRUTH)
    for k in range(8):
        theta = step * np.eye(9)[k]
        error = (shown_at(at_mm, theta[None], STILL) - shown_at(at_mm, -theta[None], STILL))[0] / (2 * step)
        assert np.allclose(slope[:, :, k], error, atol=1e-6), PARAMETERS[k]


@pytest.mark.parametrize("seed", range(12))
def test_so_many_lengths_of_drawn_vectors_lie_within_the_bounds(seed: int) -> None:
    """From round ones to needles, from no mean to one of six standard deviations along any axis."""
    random = np.random.default_rng((seed, 1))
    axes = np.linalg.qr(random.standard_normal((3, 3)))[0]
    covariance = axes * 10 ** random.uniform(-2, 0, 3) @ axes.T
    mean = random.choice([0.0, 0.5, 2.0, 6.0]) * axes[random.integers(3)]
    drawn = random.multivariate_normal(mean, covariance, 150_000)
    (narrow,), (wide,) = longest(mean[None], covariance[None])
    length = np.linalg.norm(drawn, axis=1)
    assert 0.946 <= np.mean(length <= narrow) <= 0.958
    assert 0.9955 <= np.mean(length <= wide) <= 0.998


@pytest.mark.parametrize(("seed", "about"), [(1, 0.0), (2, 1.0), (3, 2.0)])
def test_the_exact_error_at_200_places_is_covered_as_often_as_stated(seed: int, about: float) -> None:
    """Drawn from the posterior, and carried through without a derivative. So many draws tell 95 % to .5."""
    own, random = change(seed, about), np.random.default_rng((seed, 2))
    at_mm = np.concatenate([grid_mm(TRUTH, Region(), 14), grid_mm(TRUTH, Region(left=0.3, right=0.7), 2)])
    bounds_mm = bounds_at(at_mm, slope_of_places(at_mm, TRUTH), own, HAND).bounds_mm
    theta = random.multivariate_normal(own.mean, own.covariance, 2000)
    error_mm = np.linalg.norm(shown_at(at_mm, theta, HAND), axis=2)
    narrow, wide = (float(np.mean(error_mm <= bound)) for bound in bounds_mm)
    assert len(at_mm) == 200
    assert narrow == pytest.approx(0.95, abs=0.015)
    assert wide >= 0.994


@pytest.mark.parametrize("seed", range(20))
def test_the_worst_of_the_region_is_at_one_of_its_corners(seed: int) -> None:
    own = change(seed, about=seed % 4)
    fine, corners = (grid_mm(TRUTH, Region(), across) for across in (25, 2))
    of = [bounds_at(at, slope_of_places(at, TRUTH), own, HAND).bounds_mm.max(axis=1) for at in (fine, corners)]
    assert np.all(of[0] <= of[1] * (1 + 1e-9))


def test_worst_and_median_are_those_of_the_region_and_a_depth_has_its_own() -> None:
    own = change(5)
    everywhere = Places(TRUTH, Limits(point_depth_mm=10.0)).error(own, HAND)
    middle = Places(TRUTH, Limits(region=Region(left=0.4, right=0.6, top=0.4, bottom=0.6))).error(own, HAND)
    assert everywhere.depth_mm == 10.0
    assert everywhere.at_depth_mm is not None
    for narrow, wide in (everywhere.worst_mm, everywhere.median_mm, everywhere.at_depth_mm):
        assert 0 < narrow < wide
    assert everywhere.median_mm[1] < everywhere.worst_mm[1]
    assert middle.worst_mm[1] < everywhere.worst_mm[1]
    assert everywhere.at_depth_mm[1] <= everywhere.worst_mm[1]
    assert (middle.depth_mm, middle.at_depth_mm, middle.shown_ns) == (None, None, 7)


@pytest.mark.parametrize("rows", [1, -1])
def test_a_depth_counts_from_the_top_of_the_picture_whichever_way_its_rows_run(rows: int) -> None:
    """Ten per cent of the axial scale and a slide of 1 mm along it: one edge is off by their sum."""
    known = Change(np.array([0.0] * 4 + [0.1, 0.0, 1.0, 0.0, 0.0]), 1e-12 * np.eye(9), 0.0, 0)
    half_mm = TRUTH.image_size_px[1] * float(TRUTH.scale_mm_per_px[1]) / 2
    for depth_mm in (0.0, half_mm / 2, 2 * half_mm):
        at_depth = Places(replace(TRUTH, polarity=(1, rows)), Limits(point_depth_mm=depth_mm)).error(known, STILL)
        assert at_depth.at_depth_mm is not None
        assert at_depth.at_depth_mm[1] == pytest.approx(abs(0.1 * rows * (depth_mm - half_mm) - 1.0), abs=1e-3)


def test_a_depth_beside_the_region_is_no_part_of_its_worst() -> None:
    own, middle = change(5), Region(top=0.45, bottom=0.55)
    beside = Places(TRUTH, Limits(region=middle, point_depth_mm=0.0)).error(own, HAND)
    assert beside.worst_mm == Places(TRUTH, Limits(region=middle)).error(own, HAND).worst_mm
    assert beside.at_depth_mm is not None
    assert beside.at_depth_mm[1] > beside.worst_mm[1]


def test_a_lag_counts_by_the_speed_of_the_hand_and_so_does_what_the_stamps_share() -> None:
    sigmas = np.full(9, 1e-9)
    late = Change(np.array([0.0] * 8 + [0.02]), np.diag(sigmas**2), 0.0, 0)
    speed = np.array([[0.0, 0.0, 0.0, 30.0], [0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
    places = Places(TRUTH, Limits())
    assert places.error(late, STILL).worst_mm[1] < 1e-6
    assert places.error(late, speed).worst_mm == pytest.approx((0.6, 0.6), abs=1e-5)
    assert places.error(replace(late, stamps_err_s=0.01), speed).worst_mm == pytest.approx((0.9, 0.9), abs=1e-5)


@pytest.fixture(scope="module")
def shown() -> Finding:
    return examine(filled(tilting_path, 10.0, 1), TRUTH, Limits())


def test_the_posterior_is_that_of_the_checks_with_what_the_model_leaves_out(shown: Finding) -> None:
    own = change_of(shown, 1e-4)
    assert own is not None
    assert shown.solution is not None
    assert np.allclose(own.mean[:8], shown.solution.change[:8])
    solved = np.sqrt(np.diag(shown.solution.covariance))[:8]
    left_out = np.sqrt(np.diag(own.covariance)[:8] - solved**2)
    assert np.rad2deg(left_out[:3]) == pytest.approx([0.1] * 3)
    assert left_out[3:] == pytest.approx([0.0025] * 2 + [0.2] * 3)
    latency = next(check for check in shown.checks if check.name == "latency")
    assert (own.mean[8], own.covariance[8, 8]) == pytest.approx((latency.value / 1e3, (latency.sigma / 1e3) ** 2))
    assert np.linalg.eigvalsh(own.covariance).min() > 0
    assert own.shown_ns == min(shown.solution.shown_ns)


def test_a_latency_that_the_paths_know_more_sharply_is_taken_as_a_whole(shown: Finding) -> None:
    """Its sigma alone, with what it had in common with the scales, would be no covariance."""
    sharp = (replace(check, sigma=0.01) if check.name == "latency" else check for check in shown.checks)
    assert shown.solution is not None
    tied = shown.solution.covariance.copy()
    tied[3, 8] = tied[8, 3] = 0.5 * np.sqrt(tied[3, 3] * tied[8, 8])
    own = change_of(Finding(tuple(sharp), replace(shown.solution, covariance=tied)), 0.0)
    assert own is not None
    assert own.covariance[8, 8] == pytest.approx(1e-10)
    assert own.covariance[3, 8] == pytest.approx(0.5 * np.sqrt(tied[3, 3]) * 1e-5)
    assert np.linalg.eigvalsh(own.covariance).min() > 0


@pytest.mark.parametrize("name", [*PARAMETERS, "latency"])
def test_without_any_one_of_the_nine_there_is_no_bound(shown: Finding, name: str) -> None:
    blind = (replace(check, value=np.nan) if check.name == name else check for check in shown.checks)
    assert change_of(Finding(tuple(blind), shown.solution), 0.0) is None


@pytest.mark.parametrize("name", ["polarity", "latency"])
def test_before_polarity_and_latency_are_in_order_there_is_no_bound(shown: Finding, name: str) -> None:
    assert change_of(without(shown, frozenset({name})), 0.0) is None


def test_without_a_solution_there_is_no_bound() -> None:
    assert change_of(examine(filled(tilting_path, 0.1, 1), TRUTH, Limits()), 0.0) is None


def test_an_empty_region_is_refused_by_name() -> None:
    with pytest.raises(ConfigurationError, match="region is empty"):
        Region(left=0.6, right=0.6)
