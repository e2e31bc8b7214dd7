"""What is known of the error of a point from picture to picture: kept while it counts, and gone with what ends it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.parameters import LEFT_OUT
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.evidence import Evidence
from probewatch.appliance.core.quality.examination import Finding, examine, examine_nothing
from probewatch.appliance.core.quality.point_error import Change, Places
from probewatch.appliance.core.quality.point_watch import Pace, PointWatch
from probewatch.appliance.core.quality.verification import Contradiction, VerificationStatus
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import PARAMETERS, Check, PointError, VerdictKind
from probewatch.drivers.rigid import Array, inverse, rigid, rotation_from_vector
from tests.support.motions import TRUTH, planar_path, tilting_path
from tests.support.windows import filled

S = 1_000_000_000
LIMITS = Limits()
VERIFIED = VerificationStatus(LIMITS.required_age_s.names, verified_ns=1)
OPEN = VerificationStatus(LIMITS.required_age_s.names)
NOTED_NS = 12 * S
SENSOR_TO_PICTURE = rigid(TRUTH.rotation, TRUTH.offset_mm)


def poses(t_s: Array) -> Array:
    """(n, 4, 4) sensor → tracker of a picture that slides by 30 mm/s along its lateral axis and turns by .2 rad/s."""
    turn = np.stack([np.zeros_like(t_s), np.zeros_like(t_s), 0.2 * t_s], axis=1)
    to_tissue = rigid(rotation_from_vector(turn), np.stack([30 * t_s, 0 * t_s, 0 * t_s], axis=1))
    return np.asarray(to_tissue @ SENSOR_TO_PICTURE)


@pytest.fixture(scope="module")
def gesture() -> Finding:
    """All nine shown; its motion is of the first ten seconds."""
    found = examine(filled(tilting_path, 10.0, 1), TRUTH, Limits())
    shown = tuple(replace(check, verdict=VerdictKind.OK) for check in found.checks)
    assert found.solution is not None
    return Finding(shown, replace(found.solution, shown_ns=np.full(9, 5 * S)))


@pytest.fixture(scope="module")
def sweep() -> Finding:
    """In the plane alone: not all of it is observed."""
    found = examine(filled(planar_path, 8.0, 1), TRUTH, Limits())
    assert found.solution is not None
    assert not all(np.isfinite(check.value) for check in found.checks)
    return found


def at(watch: PointWatch, now_s: float, status: VerificationStatus = VERIFIED) -> PointError | None:
    """With a hand that holds still."""
    now_ns = round(now_s * S)
    for t_ns in (now_ns - S // 10, now_ns):
        watch.pace.step(t_ns, np.eye(4))
    return watch.now(now_ns, status)


def watching(*findings: Finding) -> PointWatch:
    watch = PointWatch(TRUTH, LIMITS)
    for finding in findings:
        watch.note(finding, NOTED_NS, VERIFIED, 0.0)
    return watch


def differing(gesture: Finding, by_sigmas: float) -> Finding:
    """A window that shows the lateral scale alone, and otherwise than the gesture did."""

    def seen(check: Check) -> Check:
        if check.name == "scale-lateral":
            return replace(check, value=check.value + by_sigmas * np.sqrt(2) * check.sigma)
        return replace(check, value=np.nan, verdict=VerdictKind.NOT_VERIFIED)

    return Finding(tuple(seen(check) for check in gesture.checks), gesture.solution)


def test_the_pace_is_the_speed_of_each_place_in_the_axes_of_the_picture() -> None:
    pace, t_s = Pace(TRUTH), np.arange(0.0, 0.5, 1 / 30)
    for t, pose in zip(t_s, poses(t_s), strict=True):
        pace.step(round(t * S), pose)
    known = pace.at(round(t_s[-1] * S))
    assert known is not None
    place = np.array([12.0, -7.0, 0.0, 1.0])
    to_tissue = poses(t_s[-4:]) @ inverse(SENSOR_TO_PICTURE)
    speed = (to_tissue[-1] - to_tissue[0]) @ place / (t_s[-1] - t_s[-4])
    assert known @ place == pytest.approx(to_tissue[-1][:3, :3].T @ speed[:3], abs=1e-6)
    assert np.linalg.norm(known @ place) == pytest.approx(np.hypot(30 * 1.0, 0.2 * 12), rel=0.1)


def test_a_speed_that_is_old_or_of_one_pose_alone_is_not_known() -> None:
    pace = Pace(TRUTH)
    assert pace.at(0) is None
    pace.step(0, np.eye(4))
    assert pace.at(0) is None
    pace.step(S // 30, np.eye(4))
    assert pace.at(S // 5) is not None
    assert pace.at(S) is None
    pace.step(2 * S, np.eye(4))
    assert pace.at(2 * S) is None, "what lies between is too long"
    pace.restart()
    assert pace.at(2 * S) is None


def test_what_a_gesture_showed_is_kept_while_less_motion_shows_less(gesture: Finding, sweep: Finding) -> None:
    shown = at(watching(gesture), 14.0)
    assert shown is not None
    assert at(watching(gesture, sweep), 14.0) == shown
    assert at(watching(gesture, sweep, examine_nothing(LIMITS)), 14.0) == shown
    assert shown.shown_ns == 5 * S


def test_it_says_less_and_less_of_now(gesture: Finding) -> None:
    watch = watching(gesture)
    told = [at(watch, now_s) for now_s in (5.0, 15.0, 35.0, 95.0)]
    bounds_mm = [one.worst_mm[1] for one in told if one is not None]
    assert len(bounds_mm) == 4
    assert bounds_mm == sorted(bounds_mm)
    squares = np.square(bounds_mm) - bounds_mm[0] ** 2
    assert squares[3] == pytest.approx(3 * squares[2], rel=0.1), "as the root of the time"
    still = Change(np.zeros(9), np.diag(np.square(LEFT_OUT)), 0.0, 0)
    grown = Places(TRUTH, LIMITS).error(still, np.zeros((3, 4))).worst_mm[1]
    assert squares[2] == pytest.approx(grown**2, rel=0.2)


def test_what_shows_all_but_less_surely_takes_its_place_only_once_it_is_too_old(gesture: Finding) -> None:
    assert gesture.solution is not None
    vague = tuple(
        replace(check, sigma=2 * check.sigma, verdict=VerdictKind.NOT_VERIFIED) if check.name in PARAMETERS else check
        for check in gesture.checks
    )
    later = Finding(vague, replace(gesture.solution, shown_ns=np.full(9, 100 * S)))
    kept, then = at(watching(gesture, later), 110.0), at(watching(gesture, later), 126.0)
    assert kept == at(watching(gesture), 110.0)
    assert then == at(watching(later), 126.0)
    assert kept is not None
    assert then is not None
    assert (kept.shown_ns, then.shown_ns) == (5 * S, 100 * S)
    assert then.worst_mm[1] > kept.worst_mm[1]


def scaled(gesture: Finding, by: float, shown_s: float) -> Finding:
    """The gesture again, so much more or less sharply, and later."""
    assert gesture.solution is not None
    checks = tuple(replace(check, sigma=by * check.sigma) for check in gesture.checks)
    covariance = by**2 * gesture.solution.covariance
    shown_ns = np.full(9, round(shown_s * S))
    return Finding(checks, replace(gesture.solution, covariance=covariance, shown_ns=shown_ns))


@pytest.mark.parametrize(("by", "newer"), [(1.3, False), (1.0, True)])
def test_of_two_that_show_everything_the_sharper_counts(gesture: Finding, by: float, newer: bool) -> None:
    told = at(watching(gesture, scaled(gesture, by, 10.0)), 13.0)
    assert told is not None
    assert told.shown_ns == (10 if newer else 5) * S


@pytest.mark.parametrize(("shown_s", "newer"), [(10, False), (90, True)])
def test_it_gives_way_to_one_that_shows_everything_less_sharply_once_that_says_more_of_now(
    gesture: Finding, shown_s: int, newer: bool
) -> None:
    watch = watching(gesture)
    watch.note(scaled(gesture, 1.2, shown_s), (shown_s + 5) * S, VERIFIED, 0.0)
    watch.note(examine_nothing(LIMITS), (shown_s + 6) * S, VERIFIED, 0.0)
    told = at(watch, shown_s + 7.0)
    assert told is not None
    assert told.shown_ns == (shown_s if newer else 5) * S


@pytest.mark.parametrize(("by_sigmas", "newer"), [(1.9, False), (2.1, True)])
def test_newer_motion_that_shows_everything_and_something_else_takes_its_place(
    gesture: Finding, by_sigmas: float, newer: bool
) -> None:
    other = tuple(
        replace(check, value=check.value + by_sigmas * np.hypot(1.3, 1) * check.sigma)
        if check.name == "scale-lateral"
        else check
        for check in gesture.checks
    )
    assert gesture.solution is not None
    later = scaled(Finding(other, gesture.solution), 1.3, 10.0)
    told = at(watching(gesture, later), 13.0)
    assert told is not None
    assert told.shown_ns == (10 if newer else 5) * S


def test_it_ends_with_the_age_that_the_offsets_may_have(gesture: Finding, sweep: Finding) -> None:
    watch = watching(gesture, sweep)
    assert at(watch, 124.0) is not None
    assert at(watch, 126.0) is None


def test_what_was_never_shown_has_no_bound(sweep: Finding) -> None:
    assert at(watching(sweep), 9.0) is None
    assert at(watching(examine_nothing(LIMITS)), 9.0) is None
    assert at(PointWatch(TRUTH, LIMITS), 9.0) is None


def test_a_sign_against_the_calibration_ends_it_until_all_is_shown_anew(gesture: Finding, sweep: Finding) -> None:
    doubted = replace(OPEN, contradictions=(Contradiction(gesture.checks[1], 11 * S, named=False),))
    watch = watching(gesture)
    assert at(watch, 11.0, doubted) is None
    watch.note(sweep, NOTED_NS, doubted, 0.0)
    assert at(watch, 12.0) is None
    watch.note(gesture, NOTED_NS, VERIFIED, 0.0)
    assert at(watch, 13.0) is not None


def test_newer_motion_that_shows_something_else_ends_it(gesture: Finding) -> None:
    alike, another = differing(gesture, 2.5), differing(gesture, 3.5)
    assert at(watching(gesture, alike), 12.0) is not None
    assert at(watching(gesture, another), 12.0) is None


def test_where_something_required_is_not_verified_any_more_only_the_latest_counts(
    gesture: Finding, sweep: Finding
) -> None:
    assert at(watching(gesture, sweep), 12.0, OPEN) is None


def test_a_restart_ends_it(gesture: Finding) -> None:
    watch = watching(gesture)
    watch.restart()
    assert at(watch, 11.0) is None


def test_without_a_speed_there_is_no_bound(gesture: Finding) -> None:
    assert watching(gesture).now(11 * S, VERIFIED) is None


def evidence_of_a_gesture() -> Evidence:
    whole = filled(tilting_path, 10.0, 6)
    evidence = Evidence(TRUTH, LIMITS, whole)
    evidence.solve(whole.now_ns)
    for step in range(5):
        evidence.points.pace.step(whole.now_ns - (4 - step) * S // 30, np.eye(4))
    return evidence


def test_evidence_knows_it_after_a_solution_and_no_more_after_a_loss_of_sight() -> None:
    evidence = evidence_of_a_gesture()
    now_ns = evidence.window.now_ns
    assert evidence.points.now(now_ns, evidence.status) is not None
    evidence.lose_sight()
    assert evidence.points.now(now_ns, evidence.status) is None


@pytest.mark.parametrize("forget", [Evidence.forget, Evidence.forget_poses])
def test_evidence_forgets_it_with_the_stamps_that_were_wrong(forget: Callable[[Evidence, int], None]) -> None:
    evidence = evidence_of_a_gesture()
    now_ns = evidence.window.now_ns
    forget(evidence, now_ns - S)
    assert evidence.points.now(now_ns, evidence.status) is None


def test_a_window_without_motion_has_none() -> None:
    evidence = Evidence(TRUTH, LIMITS, PathWindow(TRUTH))
    evidence.solve(S)
    assert evidence.points.now(S, evidence.status) is None
