"""The sequential test against a solver, an optimiser and a promise that are not its own."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from probewatch.appliance.core.path.blocks import PARTS, WALK, WHITE
from probewatch.appliance.core.path.noise import Noise
from probewatch.appliance.core.path.solver import Prior, solve
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.bounded_fit import minimum
from probewatch.appliance.core.quality.judgement import judge
from probewatch.appliance.core.quality.sequential_test import Accusation, accuse
from probewatch.appliance.core.quality.stationary_time import StationaryTime
from probewatch.appliance.core.quality.verification import Verification
from probewatch.appliance.core.spread_work import run_to_end
from probewatch.appliance.limits import NAMED_NATS, Limits
from probewatch.appliance.types import Calibration, VerdictKind
from probewatch.drivers.rigid import Array, rigid, rotation_from_vector
from tests.support.motions import TRUTH, tilting_path
from tests.support.windows import filled, motion

LIMITS = Limits()


def known(position_mm: float = 0.1, angle_deg: float = 0.02) -> Noise:
    """White and a small walk, as `filled` makes it: a turn moves the picture by 64 mm of lever."""
    position, angle = np.zeros((2, PARTS))
    position[[WHITE, WALK]] = position_mm**2 + (64 * np.deg2rad(angle_deg)) ** 2, 0.01**2
    angle[[WHITE, WALK]] = np.deg2rad(angle_deg) ** 2, np.deg2rad(0.02) ** 2
    return Noise(np.array([position, position, angle]))


def accused(window: PathWindow, noise: Noise | None = None) -> Accusation | None:
    found = run_to_end(accuse(window, TRUTH, LIMITS, noise or known(), 0.0, breathing_known=True))
    return found if found.checks else None


def turned(axis: int, angle_deg: float) -> Calibration:
    return replace(TRUTH, rotation=rotation_from_vector(np.deg2rad(angle_deg) * np.eye(3)[axis]) @ TRUTH.rotation)


def pushed(window: PathWindow, mm_s: Array, px: Array | None = None) -> PathWindow:
    """The window's pictures with a drift (2,), and with errors (n, 2) of each picture."""
    again = PathWindow(TRUTH)
    again.poses = window.poses
    for k, seen in enumerate(window._seen):
        t_s = (seen.stamp.t_ns - window.start_ns) / 1e9
        error = mm_s * t_s / TRUTH.scale_mm_per_px + (0.0 if px is None else px[k])
        again.add(motion(t_s, k, seen.path_px + error, seen.path_rad))
    return again


def test_what_is_least_between_bounds_is_what_another_optimiser_finds() -> None:
    random = np.random.default_rng(0)
    for _ in range(10):
        A, b = random.standard_normal((15, 9)), 3 * random.standard_normal(15)
        low, high = -random.uniform(0.1, 1, 9), random.uniform(0.1, 1, 9)
        found = minimum(A.T @ A, A.T @ b, low, high)
        np.testing.assert_allclose(found, lsq_linear(A, b, (low, high)).x, atol=1e-5)


@pytest.mark.parametrize(
    ("truth", "names"),
    [
        (turned(0, 8), {"rotation-lateral"}),
        (turned(2, -7), {"rotation-elevational"}),
        (replace(TRUTH, scale_mm_per_px=TRUTH.scale_mm_per_px * [1.12, 1]), {"scale-lateral"}),
        (replace(TRUTH, offset_mm=np.add(TRUTH.offset_mm, [0, 12, 0])), {"offset-axial"}),
    ],
)
def test_what_is_wrong_is_named_alone(truth: Calibration, names: set[str]) -> None:
    found = accused(filled(tilting_path, 7.0, 3, truth=truth))
    assert found is not None
    assert found.nats >= NAMED_NATS
    assert found.named == names


def test_the_ratio_is_that_of_an_estimate_beyond_its_limit_by_its_sigma() -> None:
    """½ ((value − limit) ÷ sigma)², value and sigma by the maximum-likelihood solver, of inflated variances."""
    truth = replace(TRUTH, scale_mm_per_px=TRUTH.scale_mm_per_px * [1.1, 1])
    told, expected = [], []
    for seed in range(2):
        window = filled(tilting_path, 6.0, seed, truth=truth)
        found = accused(window)
        solution = solve(window.samples(0.0), TRUTH, Prior(), known(), learn=False)
        beyond = (solution.change[3] - 0.05 - 3 * 0.003) / np.sqrt(solution.covariance[3, 3])
        told.append(0.0 if found is None else found.nats)
        expected.append(0.5 * beyond**2 / 1.3**2)
    assert np.mean(told) == pytest.approx(np.mean(expected), rel=0.4)


@pytest.mark.parametrize("seed", range(3))
def test_a_calibration_at_its_limits_is_not_accused(seed: int) -> None:
    at = replace(turned(0, 2.9), scale_mm_per_px=TRUTH.scale_mm_per_px * [1.049, 0.951])
    assert accused(filled(tilting_path, 10.0, seed, truth=at)) is None


@pytest.mark.parametrize("seed", range(3))
def test_noise_that_is_heavier_and_more_alike_than_told_accuses_nobody(seed: int) -> None:
    random = np.random.default_rng(seed)
    heavy = random.standard_t(3, (302, 2)) * 2.0
    alike_px = (heavy[2:] + heavy[1:-1] + heavy[:-2]) / 3
    assert accused(pushed(filled(tilting_path, 10.0, seed), np.zeros(2), alike_px)) is None


def swayed(axial_mm: float, lateral_mm: float = 0.6) -> Callable[[Array], Array]:
    """To and fro along both axes of the picture, twice these from end to end, and turned a little."""

    def path(t_s: Array) -> Array:
        centre = np.stack([lateral_mm * np.sin(7 * t_s), axial_mm * np.sin(5 * t_s + 1), 0 * t_s], axis=1)
        return rigid(rotation_from_vector(np.stack([0 * t_s, 0 * t_s, 0.02 * np.sin(4 * t_s)], axis=1)), centre)

    return path


@pytest.mark.parametrize(("size_mm", "names"), [(0.45, frozenset[str]()), (0.6, frozenset({"scale-axial"}))])
def test_a_scale_that_skin_may_feign_is_a_sign_and_no_name(size_mm: float, names: frozenset[str]) -> None:
    """Skin drags along with a probe that hardly moves: nothing is concluded of a scale from less than 1 mm."""
    wrong = replace(TRUTH, scale_mm_per_px=TRUTH.scale_mm_per_px * [1, 1.5])
    quiet = known(0.02, 0.001)
    found = accused(filled(swayed(size_mm), 10.0, 3, position_mm=0.02, angle_deg=0.001, truth=wrong), quiet)
    assert found is not None
    assert found.nats > NAMED_NATS
    assert (found.named, [check.name for check in found.checks], found.rivals) == (names, ["scale-axial"], ())


def test_a_scale_that_skin_may_feign_stays_a_sign_beside_one_that_is_named() -> None:
    wrong = replace(TRUTH, scale_mm_per_px=TRUTH.scale_mm_per_px * [1.3, 1.5])
    path = swayed(0.45, lateral_mm=6.0)
    found = accused(filled(path, 10.0, 3, position_mm=0.02, angle_deg=0.001, truth=wrong), known(0.02, 0.001))
    assert found is not None
    assert found.named == {"scale-lateral"}
    assert {check.name for check in found.checks} == {"scale-lateral", "scale-axial"}


def test_a_body_that_creeps_is_not_called_a_scale() -> None:
    assert accused(pushed(filled(tilting_path, 6.0, 4), np.array([1.0, -0.5]))) is None


def test_motion_that_fits_nothing_is_not_named() -> None:
    """Pictures of another motion: no calibration explains them."""
    other = filled(lambda t: tilting_path(1.7 * t + 2), 6.0, 5)
    mixed = filled(tilting_path, 6.0, 5)
    again = PathWindow(TRUTH)
    again.poses = mixed.poses
    for seen in other._seen:
        again.add(seen)
    found = accused(again)
    assert found is None or not found.named
    assert found is None or {check.verdict for check in found.checks} == {VerdictKind.NOT_VERIFIED}


def test_too_little_motion_tells_nothing() -> None:
    assert accused(filled(tilting_path, 0.2, 6)) is None
    assert accused(PathWindow(TRUTH)) is None


def in_step(t_s: Array) -> Array:
    """Slid and rocked in step: each looks like the other, for any scale and the offset along the beam."""
    swing = np.sin(2.6 * t_s)
    centre = np.stack([8 * swing, 0.3 * np.sin(7 * t_s), 0 * t_s], axis=1)
    return rigid(rotation_from_vector(np.stack([0 * t_s, 0 * t_s, 0.12 * swing], axis=1)), centre)


def in_turn(t_s: Array) -> Array:
    """Slid, then rocked faster."""
    slide, rock = np.sin(2.6 * t_s), np.sin(4.1 * t_s)
    centre = np.stack([8 * slide, 0.3 * np.sin(7 * t_s), 0 * t_s], axis=1)
    return rigid(rotation_from_vector(np.stack([0 * t_s, 0 * t_s, 0.12 * rock], axis=1)), centre)


SLID = replace(TRUTH, offset_mm=np.add(TRUTH.offset_mm, [0, 12, 0]))


def test_two_classes_that_are_as_likely_are_told_with_their_margin() -> None:
    found = accused(filled(in_step, 5.0, 2, truth=SLID))
    assert found is not None
    assert found.named == frozenset()
    assert [rival.check.name for rival in found.rivals] == ["offset-axial", "scale-lateral"]
    assert found.rivals[0].behind_nats == 0.0
    assert 0 < found.rivals[1].behind_nats < 5
    assert tuple(rival.check for rival in found.rivals) == found.checks


def test_both_are_told_with_the_motion_that_tells_which() -> None:
    """As a person reads it, until one of them is shown to be in order."""
    found = accused(filled(in_step, 5.0, 2, truth=SLID))
    assert found is not None
    verification = Verification(LIMITS, StationaryTime(LIMITS, TRUTH))
    verification.accuse(found.checks, found.named, 5, found.rivals)
    verdict = judge(5, (), verification.status)
    assert (verdict.kind, verdict.rivals) == (VerdictKind.NOT_VERIFIED, found.rivals)
    assert verdict.reason == (
        f"cause undecided, {found.rivals[1].behind_nats:.1f} nat apart: offset-axial, scale-lateral; "
        "to decide: slide it sideways, 10 mm to and fro + rock it in the picture's plane, 8° each way"
    )


def test_the_motion_that_is_asked_for_tells_which() -> None:
    found = accused(filled(in_turn, 5.0, 2, truth=SLID))
    assert found is not None
    assert (found.named, found.rivals) == ({"offset-axial"}, ())
