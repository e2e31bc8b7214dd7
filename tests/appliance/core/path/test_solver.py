"""The AX=XB solver against motions whose truth is known in closed form."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from probewatch.appliance.core.path import noise as path_noise
from probewatch.appliance.core.path.blocks import PARTS, WALK, WHITE
from probewatch.appliance.core.path.fit import PathFit
from probewatch.appliance.core.path.samples import PathSamples
from probewatch.appliance.core.path.solver import Prior, Solution, solve
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import rigid, rotation_from_vector, vector_from_rotation
from tests.support.motions import TRUTH, Noise, planar_path, samples, tilting_path

QUIET = Noise(position_mm=0.0, angle_deg=0.0, picture_px=0.0, drift_mm=0.0, drift_deg=0.0)
PLANAR = Prior(planar=True, offset_mm=5.0, latency_s=0.001)


def known(noise: Noise, planar: bool) -> path_noise.Noise:
    """As `tests.support.motions` makes it: white and a walk, of each row."""
    position, angle = np.zeros((2, PARTS))
    position[[WHITE, WALK]] = noise.position_mm**2, noise.drift_mm**2
    angle[[WHITE, WALK]] = np.square(np.deg2rad([noise.angle_deg, noise.drift_deg]))
    return path_noise.Noise(np.array([position, position, angle, *([position, angle, angle] if planar else [])]))


def solve_known(given: PathSamples, reference: Calibration, prior: Prior, noise: Noise) -> Solution:
    return solve(given, reference, prior, known(noise, prior.planar), learn=False)


def off(calibration: Calibration) -> Calibration:
    """A reference that is wrong by 3° about every axis, 4 % in scale and 2 mm in offset."""
    return replace(
        calibration,
        rotation=rotation_from_vector(np.deg2rad([3.0, -3.0, 3.0])) @ calibration.rotation,
        scale_mm_per_px=calibration.scale_mm_per_px * np.array([1.04, 0.96]),
        offset_mm=calibration.offset_mm + np.array([2.0, -2.0, 0.0]),
    )


def turn_deg(a: Calibration, b: Calibration) -> float:
    return float(np.rad2deg(np.linalg.norm(vector_from_rotation(a.rotation @ b.rotation.T))))


def test_planar_motion_without_noise_gives_rotation_scales_and_in_plane_offset_back() -> None:
    given = samples(planar_path, 120, 0, QUIET)
    found = solve_known(given, off(TRUTH), Prior(planar=True, latency_s=1e-6), QUIET).calibration
    assert turn_deg(found, TRUTH) < 0.01
    np.testing.assert_allclose(found.scale_mm_per_px, TRUTH.scale_mm_per_px, rtol=1e-4)
    np.testing.assert_allclose(found.offset_mm[:2], TRUTH.offset_mm[:2], atol=0.02)


def test_planar_motion_leaves_the_elevational_offset_unobserved() -> None:
    found = solve(samples(planar_path, 120, 0, Noise()), TRUTH, PLANAR).calibration
    assert found.observed == (True, True, True, True, True, True, True, False)


def test_tilt_shows_the_elevational_offset_too() -> None:
    found = solve(samples(tilting_path, 240, 1, Noise()), off(TRUTH), Prior(latency_s=0.001)).calibration
    assert all(found.observed)
    np.testing.assert_allclose(found.offset_mm, TRUTH.offset_mm, atol=3.0)
    assert turn_deg(found, TRUTH) < 1.0


def test_sixty_frames_at_a_tenth_of_a_millimetre_give_two_percent_and_one_degree() -> None:
    """RMS over 40 runs of the worse scale and of the rotation, from a reference that is wrong by 5° and 4 %."""
    found = [solve(samples(planar_path, 60, seed, Noise()), off(TRUTH), PLANAR).calibration for seed in range(40)]
    scale = [np.abs(c.scale_mm_per_px / TRUTH.scale_mm_per_px - 1).max() for c in found]
    turn = [turn_deg(c, TRUTH) for c in found]
    assert np.sqrt(np.mean(np.square(scale))) < 0.02
    assert np.sqrt(np.mean(np.square(turn))) < 1.0


def study(path, prior: Prior, frames: int, runs: int, noise: Noise) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[no-untyped-def]
    """(runs, 9) changes found about the truth, which should be zero, and their stated sigmas."""
    found = [solve_known(samples(path, frames, seed, noise), TRUTH, prior, noise) for seed in range(runs)]
    return np.array([s.change for s in found]), np.array([np.sqrt(np.diag(s.covariance)) for s in found])


@pytest.mark.parametrize(("frames", "most"), [(60, 0.84), pytest.param(120, 0.76, marks=pytest.mark.thorough)])
def test_stated_sigmas_cover_the_truth(frames: int, most: float) -> None:
    """Share of all observed parameters within one sigma, 80 runs; within 2 s the sigmas are rather too large."""
    changes, sigmas = study(planar_path, PLANAR, frames, 80, Noise())
    assert 0.62 <= np.mean((np.abs(changes) < sigmas)[:, :7]) <= most
    assert np.mean((np.abs(changes) < 1.96 * sigmas)[:, :7]) >= 0.92


@pytest.mark.slow
@pytest.mark.parametrize("position_mm", [0.1, 0.25])
@pytest.mark.parametrize(
    ("path", "prior", "told", "most"), [(planar_path, PLANAR, 7, 0.75), (tilting_path, Prior(latency_s=0.005), 8, 0.92)]
)
def test_errors_are_unbiased_and_covered_over_six_hundred_runs(
    path, prior: Prior, told: int, most: float, position_mm: float
) -> None:  # type: ignore[no-untyped-def]
    """The sigmas of freehand motion are too large here: the model always expects slanted tissue and tilts that lead
    registration astray, which this simulation lacks. Without the tilts the bound was .90.
    """
    changes, sigmas = study(path, prior, 120, 600, Noise(position_mm=position_mm))
    changes, sigmas = changes[:, :told], sigmas[:, :told]
    assert np.all(np.abs(changes.mean(axis=0)) < 0.2 * changes.std(axis=0)), changes.mean(axis=0) / changes.std(axis=0)
    one, two = (np.mean(np.abs(changes) < width * sigmas, axis=0) for width in (1.0, 1.96))
    assert np.all((one >= 0.63) & (one <= most)), one
    assert np.all(two >= 0.925), two


def circle(t_s: np.ndarray) -> np.ndarray:
    """(n, 4, 4): 3 mm/s, a quarter of a circle of 1.9 mm radius each second, no turn."""
    heading = np.pi / 2 * t_s
    place = 3 / (np.pi / 2) * np.stack([np.sin(heading), 1 - np.cos(heading), 0 * t_s], axis=1)
    return rigid(np.tile(np.eye(3), (len(t_s), 1, 1)), place)


@cache
def slow_sweeps(seconds: int) -> tuple[Calibration, ...]:
    """Of 80 sweeps, 30 frames a second, 0.1 mm, from a reference 5° and 4 % off; solved once for all tests."""
    swept = (samples(circle, 30 * seconds, seed, Noise()) for seed in range(80))
    return tuple(solve_known(one, off(TRUTH), PLANAR, Noise()).calibration for one in swept)


@pytest.mark.parametrize(("seconds", "scale_percent", "turn_bound_deg"), [(1, 6.5, 6.5), (2, 2.8, 2.0), (4, 1.1, 1.0)])
def test_a_slow_sweep_shows_the_scales_within_seconds(
    seconds: int, scale_percent: float, turn_bound_deg: float
) -> None:
    """RMS over 40 sweeps: worse scale, whole rotation."""
    found = slow_sweeps(seconds)[:40]
    scale = [100 * np.abs(c.scale_mm_per_px / TRUTH.scale_mm_per_px - 1).max() for c in found]
    assert np.sqrt(np.mean(np.square(scale))) < scale_percent
    assert np.sqrt(np.mean(np.square([turn_deg(c, TRUTH) for c in found]))) < turn_bound_deg


def scale_bound(path, seconds: int, noise: Noise) -> np.ndarray:  # type: ignore[no-untyped-def]
    """(2,) Cramér–Rao bound of the relative scales, turn in the plane and place unknown: generalised least squares of
    the centre's path on the picture's, white noise and random walk with its dense covariance.
    """
    t_s = np.arange(30 * seconds) / 30
    x, y = path(t_s)[:, :2, 3].T
    free, none = np.ones_like(x), np.zeros_like(x)
    by_turn_scales_place = np.array([[-y, x, none, free, none], [x, none, y, none, free]])
    weight = np.linalg.inv(noise.position_mm**2 * np.eye(t_s.size) + noise.drift_mm**2 * np.minimum.outer(t_s, t_s))
    information = sum(J @ weight @ J.T for J in by_turn_scales_place)
    return np.sqrt(np.diag(np.linalg.inv(information))[1:3])


@pytest.mark.parametrize("seconds", [1, 2, 4])
def test_a_slow_sweep_is_used_as_well_as_can_be(seconds: int) -> None:
    """One second of it allows no 5 %: the bound is 5.7 and 6.2 %, two and four seconds 2.2 and 0.8 %. 80 sweeps."""
    errors = np.array([c.scale_mm_per_px for c in slow_sweeps(seconds)]) / TRUTH.scale_mm_per_px - 1
    assert np.all(np.sqrt(np.mean(errors**2, axis=0)) < 1.2 * scale_bound(circle, seconds, Noise()))


@pytest.mark.parametrize("angle_deg", [0.02, 0.1])
def test_ten_seconds_of_freehand_tilt_give_the_whole_offset_without_a_phantom(angle_deg: float) -> None:
    """±2° of tilt; RMS over 15 runs: t_z 1 mm, rotation 0.5°, scales 1 %."""
    found = [
        solve(
            samples(tilting_path, 300, seed, Noise(angle_deg=angle_deg)), off(TRUTH), Prior(latency_s=0.001)
        ).calibration
        for seed in range(15)
    ]
    assert np.sqrt(np.mean([(c.offset_mm[2] - TRUTH.offset_mm[2]) ** 2 for c in found])) < 1.0
    assert np.sqrt(np.mean([turn_deg(c, TRUTH) ** 2 for c in found])) < 0.5
    scales = np.array([c.scale_mm_per_px for c in found]) / TRUTH.scale_mm_per_px - 1
    assert np.all(np.sqrt(np.mean(scales**2, axis=0)) < 0.01)


def test_orientation_noise_does_not_draw_the_offset_towards_the_sensor() -> None:
    """0.2° on ±2° of tilt: uncorrected, turn errors take 0.85 of 14 mm off t_z; the mean scatters by 0.1."""
    noise = Noise(angle_deg=0.2)
    found = [
        solve(samples(tilting_path, 300, seed, noise), TRUTH, Prior(latency_s=0.001)).change[7] for seed in range(20)
    ]
    assert abs(np.mean(found)) < 0.4


def test_motion_without_elevational_part_does_not_pretend_to_show_the_tilt() -> None:
    solution = solve(samples(planar_path, 60, 3, Noise()), TRUTH, Prior(tilt_rad=0.2, rotation_rad=0.2, latency_s=0.01))
    assert solution.calibration.observed[:2] == (False, False)


def test_latency_is_told_apart_from_scale() -> None:
    on_time = samples(planar_path, 150, 4, Noise())
    early = samples(planar_path, 150, 4, Noise(), start_s=0.02)
    given = replace(early, t_s=on_time.t_s, u_px=on_time.u_px, alpha_rad=on_time.alpha_rad)
    solution = solve(given, TRUTH, Prior(planar=True, latency_s=0.05))
    assert solution.change[8] == pytest.approx(-0.02, abs=0.003)
    np.testing.assert_allclose(solution.change[3:5], 0, atol=0.02)


@pytest.mark.parametrize("polarity", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_the_likelihood_prefers_the_true_polarity(polarity: tuple[int, int]) -> None:
    given = samples(planar_path, 90, 5, Noise(), truth=replace(TRUTH, polarity=polarity))
    fit = PathFit(given, TRUTH, solve(given, TRUTH).noise)
    misfits = {p: fit.misfit(replace(TRUTH, polarity=p)) for p in [(1, 1), (-1, 1), (1, -1), (-1, -1)]}
    best, second = sorted(misfits.values())[:2]
    assert misfits[polarity] == best
    assert (second - best) * 90 > 40


def test_too_few_pictures_are_refused() -> None:
    with pytest.raises(ValueError, match="too few to solve"):
        solve(samples(planar_path, 5, 0, Noise()), TRUTH)


def test_heavy_tails_do_not_move_the_estimate() -> None:
    given = samples(planar_path, 120, 6, Noise())
    u_px = given.u_px.copy()
    u_px[::17] += 9.0
    found = solve(replace(given, u_px=u_px), TRUTH, PLANAR).calibration
    np.testing.assert_allclose(found.scale_mm_per_px, TRUTH.scale_mm_per_px, rtol=0.03)
