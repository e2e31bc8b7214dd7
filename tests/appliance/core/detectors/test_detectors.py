"""The detectors of the line: marker body, frozen picture, frozen tracker, and each parameter against its limit."""

from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.detectors.calibration_change import agreement_check, calibration_checks, latency_check
from probewatch.appliance.core.detectors.frozen_tracker import FrozenTracker
from probewatch.appliance.core.detectors.frozen_video import FrozenVideo
from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.core.detectors.polarity import weigh_polarity
from probewatch.appliance.core.detectors.pose_convention import PoseConvention
from probewatch.appliance.core.path.conventions import Convention
from probewatch.appliance.core.path.explanation import Explanation
from probewatch.appliance.core.path.latency import Latency
from probewatch.appliance.core.path.solver import Prior, Solution, solve
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import PARAMETERS, Fault, VerdictKind
from probewatch.drivers.rigid import rigid
from probewatch.drivers.samples import Pose, PoseStatus, Stamp
from tests.support.motions import TRUTH, Noise, planar_path, samples

OK, FAULT, NOT_VERIFIED = VerdictKind.OK, VerdictKind.FAULT, VerdictKind.NOT_VERIFIED
LIMITS = Limits()
MS = 1_000_000


@pytest.fixture(scope="module")
def solution() -> Solution:
    return solve(samples(planar_path, 120, 1, Noise()), TRUTH, Prior(planar=True, offset_mm=5.0, latency_s=0.001))


@pytest.mark.parametrize(
    ("value_percent", "sigma_percent", "verdict"),
    [
        (0, 1, OK),
        (4, 0.1, OK),
        (4, 0.4, NOT_VERIFIED),
        (6, 0.4, NOT_VERIFIED),
        (6, 0.1, FAULT),
        (-6, 0.1, FAULT),
        (0, 2, NOT_VERIFIED),
    ],
)
def test_three_sigma_of_room_on_either_side_of_the_limit(solution, value_percent, sigma_percent, verdict) -> None:
    change, covariance = solution.change.copy(), solution.covariance.copy()
    change[3], covariance[3, 3] = value_percent / 100, (sigma_percent / 100) ** 2
    (check,) = [
        c
        for c in calibration_checks(replace(solution, change=change, covariance=covariance), LIMITS)
        if c.name == "scale-lateral"
    ]
    assert (check.verdict, check.value) == (verdict, pytest.approx(value_percent))
    assert check.ratio == pytest.approx(abs(value_percent) / 5)


def test_what_tissue_hides_is_room_of_the_axial_scale_alone(solution) -> None:
    """Half of a hidden share of .04 is added as a sigma of 2 %."""
    before, now = (calibration_checks(replace(solution, hides=hides), LIMITS) for hides in (0.0, 0.04))
    wider = [k for k, (a, b) in enumerate(zip(before, now, strict=True)) if b.sigma > a.sigma]
    assert [now[k].name for k in wider] == ["scale-axial"]
    assert now[wider[0]].sigma == pytest.approx(np.hypot(before[wider[0]].sigma, 2.0))


def test_what_was_not_observed_has_no_value(solution) -> None:
    checks = {c.name: c for c in calibration_checks(solution, LIMITS)}
    assert np.isnan(checks["offset-elevational"].value)
    assert checks["offset-elevational"].verdict is NOT_VERIFIED
    assert set(checks) == set(PARAMETERS)


@pytest.mark.parametrize("correlation", [0.89, float("nan")])
def test_where_picture_and_tracker_disagree_nothing_is_concluded(solution, correlation) -> None:
    doubtful = replace(solution, correlation=correlation)
    assert {c.verdict for c in calibration_checks(doubtful, LIMITS)} == {NOT_VERIFIED}
    assert agreement_check(doubtful).verdict is NOT_VERIFIED
    assert agreement_check(solution).verdict is OK


@pytest.mark.parametrize(
    ("ms", "sigma_ms", "err_ms", "verdict"),
    [
        (20, 5, 0, OK),
        (20, 5, 24, OK),
        (20, 5, 26, NOT_VERIFIED),
        (100, 10, 0, FAULT),
        (-100, 10, 9, FAULT),
        (100, 10, 11, NOT_VERIFIED),
        (50, 20, 0, NOT_VERIFIED),
    ],
)
def test_latency_against_its_limit(ms, sigma_ms, err_ms, verdict) -> None:
    """Limit 60 ms, three sigma, and what the stamps may be wrong by together."""
    check = latency_check(Latency(ms / 1e3, sigma_ms / 1e3), LIMITS, err_ms / 1e3)
    assert (check.verdict, check.value) == (verdict, pytest.approx(ms))
    assert latency_check(None, LIMITS, 0.0).verdict is NOT_VERIFIED


def line(t_s: np.ndarray) -> np.ndarray:
    return rigid(np.tile(np.eye(3), (len(t_s), 1, 1)), np.stack([6 * np.sin(2.3 * t_s), 0 * t_s, 0 * t_s], axis=1))


def test_motion_along_one_axis_does_not_show_the_polarity() -> None:
    given = samples(line, 120, 1, Noise())
    _, check = weigh_polarity(given, TRUTH, solve(given, TRUTH).noise)
    assert check.verdict is NOT_VERIFIED
    given = samples(planar_path, 120, 1, Noise())
    best, check = weigh_polarity(given, TRUTH, solve(given, TRUTH).noise)
    assert (best, check.verdict) == ((1, 1), OK)


PICTURE = np.zeros((4, 4), np.uint8)


def test_a_frozen_picture_fails_past_its_limit_even_with_a_ticking_clock() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (480, 640), dtype=np.uint8)
    detector = FrozenVideo(500 * MS)
    for k in range(60):
        shown = picture.copy()
        shown[:10, :20] = (7 * k) % 256
        detector.compare(10 * k * MS, shown)
        (check,) = detector.checks()
        assert (check.verdict is FAULT) == (10 * k > 500)
    assert detector.repeats
    detector.compare(600 * MS, 255 - picture)
    assert detector.checks()[0].verdict is OK


def screens(mark: tuple[int, int, int, int], grey: int = 230) -> tuple[FrozenVideo, list[str]]:
    """Three seconds of live tissue on a black screen with a clock of seconds, then a frozen second with a mark; mark:
    (row, column, height, width). Returns the names of the checks that were not OK.
    """
    random = np.random.default_rng(0)
    detector, told = FrozenVideo(500 * MS), list[str]()
    picture = np.zeros((480, 640), np.uint8)
    for k in range(120):
        if k < 90:
            picture[40:440, 120:520] = random.integers(0, 256, (400, 400), dtype=np.uint8)
        shown = picture.copy()
        shown[450:460, :16] = 200 * (k // 30 % 2)
        if k >= 90:
            row, column, height, width = mark
            shown[row : row + height, column : column + width] = grey
        detector.compare(round(k * 1e9 / 30), shown)
        told += [check.name for check in detector.checks() if check.verdict is not OK]
    return detector, told


@pytest.mark.parametrize("mark", [(5, 600, 12, 12), (200, 560, 20, 60), (462, 100, 6, 440)])
def test_a_mark_beside_the_picture_tells_the_freeze_key_from_a_dead_grabber(mark) -> None:
    detector, told = screens(mark)
    assert set(told) == {"user-freeze"}
    assert {check.verdict for check in detector.checks()} == {NOT_VERIFIED}


@pytest.mark.parametrize(
    ("mark", "grey"),
    [
        pytest.param((0, 0, 0, 0), 0, id="nothing but the clock"),
        pytest.param((5, 600, 4, 4), 230, id="too small"),
        pytest.param((5, 600, 20, 20), 20, id="a codec's ripple"),
        pytest.param((100, 200, 60, 60), 0, id="in the tissue alone"),
        pytest.param((0, 0, 480, 110), 230, id="a menu over a sixth of the screen"),
    ],
)
def test_without_a_mark_a_picture_that_stands_is_a_fault(mark, grey) -> None:
    assert set(screens(mark, grey)[1]) == {"frozen-video"}


def test_a_live_picture_ends_the_pause() -> None:
    detector, _ = screens((5, 600, 12, 12))
    detector.compare(5_000 * MS, np.random.default_rng(1).integers(0, 256, (480, 640), dtype=np.uint8))
    (check,) = detector.checks()
    assert (check.name, check.verdict) == ("frozen-video", OK)


def test_pictures_of_another_size_forget_the_screen() -> None:
    detector, _ = screens((5, 600, 12, 12))
    for k in range(30):
        detector.compare(round((5 + k / 30) * 1e9), np.full((240, 320), 9, np.uint8))
    assert [(check.name, check.verdict) for check in detector.checks()] == [("frozen-video", FAULT)]


def test_a_live_picture_of_a_resting_probe_is_not_frozen() -> None:
    random = np.random.default_rng(0)
    still = random.integers(20, 200, (480, 640)).astype(np.int16)
    detector = FrozenVideo(500 * MS)
    for k in range(80):
        noisy = (still + random.integers(-4, 5, still.shape)).astype(np.uint8)
        detector.compare(20 * k * MS, noisy)
        assert detector.checks()[0].verdict is OK


def pose(t_ms: int, x_mm: float) -> Pose:
    return Pose(Stamp(t_ms * MS, 0), t_ms, rigid(np.eye(3), np.array([x_mm, 0, 0])), 0.1, PoseStatus.OK)


@pytest.mark.parametrize(("moves_mm", "verdict"), [(0.1, FAULT), (0.0, OK)])
def test_equal_poses_are_stale_only_while_the_picture_moves(moves_mm, verdict) -> None:
    detector = FrozenTracker(500 * MS)
    for k in range(40):
        detector.pose(pose(20 * k, 1.0))
        detector.see(
            Observation(20 * k * MS, PICTURE, repeated=False, followed=True, step_mm=np.array([moves_mm, 0.0]))
        )
    assert detector.checks()[0].verdict is verdict
    detector.pose(pose(800, 1.5))
    assert detector.checks()[0].verdict is OK


def convention(*found: Explanation | None) -> tuple[PoseConvention, list[tuple[str, ...]]]:
    """The detector, and the names of what it says after each of these explanations."""
    latest: list[Explanation | None] = [None]
    detector, said = PoseConvention(lambda: latest[0]), []
    for k, one in enumerate(found):
        latest[0] = one
        for again in range(3):
            detector.see(Observation((3 * k + again) * 33 * MS, np.zeros((4, 4), np.uint8), repeated=False))
        said.append(tuple(check.name for check in detector.checks()))
    return detector, said


def explained(as_read: Convention) -> Explanation:
    return Explanation(as_read, 0.0, 30.0)


@pytest.mark.parametrize("wrong", [one for one in Convention if one not in (Convention.AGREED, Convention.FLIPPED)])
def test_a_wrong_pose_convention_is_named_once_two_searches_say_the_same(wrong: Convention) -> None:
    detector, said = convention(None, explained(wrong), explained(wrong), explained(wrong))
    assert said == [(), (), (wrong.value,), (wrong.value,)]
    (check,) = detector.checks()
    assert (check.verdict, check.fault.value, check.value) == (FAULT, "pose-convention", 30.0)


def test_one_search_a_flip_or_the_agreed_convention_name_none() -> None:
    inverted, swapped = explained(Convention.INVERTED), explained(Convention.SWAPPED)
    assert convention(inverted, swapped, None, inverted)[1] == [(), (), (), ()]
    flips = [explained(Convention.FLIPPED) for _ in range(3)]
    assert convention(*flips, explained(Convention.AGREED))[1] == [(), (), (), ()]


def test_a_pose_convention_is_withdrawn_when_the_agreed_one_explains_the_motion_or_the_rotations_are_shown() -> None:
    wrong = [explained(Convention.INVERTED) for _ in range(2)]
    assert convention(*wrong, explained(Convention.AGREED))[1] == [(), ("poses-inverted",), ()]
    detector, said = convention(*wrong)
    detector.on_verified(lambda fault: fault is not Fault.ROTATION, 0)
    assert detector.checks()
    detector.on_verified(lambda fault: fault is Fault.ROTATION, 0)
    assert (said[-1], detector.checks()) == (("poses-inverted",), ())
