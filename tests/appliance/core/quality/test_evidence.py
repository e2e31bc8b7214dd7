"""What seconds of motion show of the calibration: faults by name, nothing without motion, old and new never mixed."""

from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.evidence import Evidence
from probewatch.appliance.core.quality.examination import examine, examine_nothing
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import PARAMETERS, Calibration, Check, Fault, VerdictKind
from probewatch.drivers.rigid import Array, rigid, rotation_from_vector
from tests.support.motions import TRUTH, planar_path, tilting_path
from tests.support.windows import ORIGIN_NS, elevational_path, filled, motion

LIMITS = Limits()
OK, FAULT, NOT_VERIFIED = VerdictKind.OK, VerdictKind.FAULT, VerdictKind.NOT_VERIFIED


def by_name(checks: tuple[Check, ...]) -> dict[str, Check]:
    return {check.name: check for check in checks}


def turned(axis: int, angle_deg: float) -> Calibration:
    return replace(TRUTH, rotation=rotation_from_vector(np.deg2rad(angle_deg) * np.eye(3)[axis]) @ TRUTH.rotation)


def scaled(lateral: float, axial: float) -> Calibration:
    return replace(TRUTH, scale_mm_per_px=TRUTH.scale_mm_per_px * [lateral, axial])


def test_the_right_calibration_is_shown_within_its_limits() -> None:
    found = examine(filled(tilting_path, 8.0, 1), TRUTH, LIMITS)
    checks = by_name(found.checks)
    for name in ("polarity", "scale-lateral", "scale-axial", "rotation-elevational", "latency", "motion-agreement"):
        assert checks[name].verdict is OK, checks[name]
    assert found.failed == frozenset()


@pytest.mark.parametrize(
    ("reference", "name", "value"),
    [
        (scaled(1 / 1.1, 1), "scale-lateral", 10),
        (scaled(1, 1 / 0.9), "scale-axial", -10),
        (turned(2, -6), "rotation-elevational", 6),
        (turned(0, -8), "rotation-lateral", 8),
        (turned(1, 8), "rotation-axial", -8),
    ],
)
def test_a_wrong_parameter_fails_by_name_and_amount(reference: Calibration, name: str, value: float) -> None:
    found = examine(filled(tilting_path, 8.0, 2, reference=reference), reference, LIMITS)
    assert name in found.failed
    assert by_name(found.checks)[name].value == pytest.approx(value, abs=1.5)


@pytest.mark.parametrize("polarity", [(-1, 1), (1, -1), (-1, -1)])
def test_a_mirrored_picture_is_a_fault_of_polarity_and_of_nothing_else(polarity: tuple[int, int]) -> None:
    truth = replace(TRUTH, polarity=polarity)
    found = examine(filled(planar_path, 5.0, 3, truth=truth), TRUTH, LIMITS)
    assert found.failed == {"polarity"}
    assert by_name(found.checks)["polarity"].value == polarity.count(-1)


def test_a_late_tracker_is_a_fault_of_latency_and_of_nothing_else() -> None:
    found = examine(filled(planar_path, 6.0, 4, late_s=0.1), TRUTH, LIMITS)
    assert found.failed == {"latency"}
    assert by_name(found.checks)["latency"].value == pytest.approx(100, abs=10)


@pytest.mark.parametrize("path", [elevational_path, lambda t: planar_path(0 * t)])
def test_without_in_plane_motion_nothing_is_claimed(path) -> None:  # type: ignore[no-untyped-def]
    checks = by_name(examine(filled(path, 6.0, 5), TRUTH, LIMITS).checks)
    assert {checks[name].verdict for name in ("polarity", *PARAMETERS, "latency")} == {NOT_VERIFIED}


def test_an_empty_window_has_every_check_undecided() -> None:
    names = {check.name for check in examine(filled(planar_path, 5.0, 1), TRUTH, LIMITS).checks}
    for nothing in (examine(PathWindow(TRUTH), TRUTH, LIMITS), examine_nothing(LIMITS)):
        assert {check.name for check in nothing.checks} == names
        assert nothing.shown == 0


def fed(
    evidence: Evidence, whole: PathWindow, start_s: float, stop_s: float, scale: float = 1.0, lateral: bool = True
) -> list[frozenset[str]]:
    """Pictures of `whole` between two times, mirrored into `evidence` with a solution each third of a second."""
    shown = []
    for index, seen in enumerate(whole._seen):
        t_s = (seen.stamp.t_ns - whole._seen[0].stamp.t_ns) / 1e9
        if not start_s <= t_s < stop_s:
            continue
        evidence.window.add(
            motion(
                t_s,
                index,
                seen.path_px / (scale if lateral else np.array([1.0, scale])),
                seen.path_rad,
                chain=1 if scale == 1.0 else 2,
            )
        )
        if index % 10 == 9:
            evidence.solve(evidence.window.now_ns)
            shown.append(frozenset(c.name for c in evidence.checks() if c.verdict is FAULT))
    return shown


def watched(duration_s: float = 16.0) -> tuple[Evidence, PathWindow]:
    whole = filled(tilting_path, duration_s, 6)
    window = PathWindow(TRUTH)
    window.poses = whole.poses
    return Evidence(TRUTH, LIMITS, window), whole


@pytest.mark.thorough
def test_a_change_of_scale_is_named_within_four_seconds_and_only_by_its_name() -> None:
    evidence, whole = watched(20.0)
    assert set().union(*fed(evidence, whole, 0, 12)) == set()
    assert evidence.shows("scale")
    after = fed(evidence, whole, 12, 19, scale=1.15)
    named = [index for index, names in enumerate(after) if names]
    assert named
    assert named[0] <= 11, "a solution comes each third of a second"
    assert set().union(*after) <= {"scale-lateral", "scale-axial"}
    assert after[-1] >= {"scale-lateral", "scale-axial"}
    value = by_name(evidence.checks())["scale-axial"].value
    assert value == pytest.approx(15, abs=4), "what came before the change is not mixed in"


@pytest.mark.thorough
def test_before_breathing_is_known_a_wrong_axial_scale_is_named_where_no_breath_explains_it() -> None:
    evidence, whole = watched()
    assert set().union(*fed(evidence, whole, 0, 9, scale=1.15, lateral=False)) == {"scale-axial"}
    assert evidence.status.verified_ns is None


def breathing_path(t_s: Array) -> Array:
    """4 mm along the axis in 4 s, quicker in than out, below `tilting_path`."""
    rise = np.stack([0 * t_s, 4 * np.cos(np.pi * (t_s + 1) / 4) ** 4, 0 * t_s], axis=1)
    return rigid(np.tile(np.eye(3), (len(t_s), 1, 1)), rise) @ tilting_path(t_s)


@pytest.mark.thorough
def test_before_breathing_is_known_a_breath_is_not_named() -> None:
    still, breathing = filled(tilting_path, 9.0, 6), filled(breathing_path, 9.0, 6)
    window = PathWindow(TRUTH)
    window.poses = still.poses
    evidence = Evidence(TRUTH, LIMITS, window)
    assert set().union(*fed(evidence, breathing, 0, 9)) == set()
    assert evidence.status.verified_ns is None or evidence.shows("scale")


@pytest.mark.parametrize("was_shown", [True, False])
def test_a_sign_that_may_be_a_breath_bars_the_motion_before_it_where_it_withdraws_an_ok(was_shown: bool) -> None:
    evidence = Evidence(TRUTH, LIMITS, filled(tilting_path, 2.0, 6))
    good = Check("scale-axial", Fault.SCALE, 0.0, 0.5, "%", 5.0, VerdictKind.OK, evidence.window.start_ns)
    if was_shown:
        evidence._verification.weigh((good,), 0)
    wrong = replace(good, value=12.0, verdict=VerdictKind.FAULT, shown_ns=None)
    for _ in range(2):
        evidence._contradict((wrong,), frozenset(), evidence.window)
        (contradiction,) = evidence.status.contradictions
        assert contradiction.until_ns == (evidence.window.now_ns if was_shown else evidence.window.start_ns - 1)


@pytest.mark.thorough
def test_a_bend_amid_motion_is_named_and_what_was_before_it_is_dropped() -> None:
    evidence, whole = watched(16.0)
    fed(evidence, whole, 0, 10)
    assert evidence.shows("rotation")
    bent = filled(tilting_path, 16.0, 6, truth=turned(0, 8))
    poses_s = np.arange(10, 16, 1 / 60)
    evidence.window.poses.forget(ORIGIN_NS + 10_000_000_000)
    for t_s, pose in zip(poses_s, bent.poses.at(poses_s, ORIGIN_NS)[0], strict=True):
        evidence.window.poses.add(ORIGIN_NS + round(t_s * 1e9), pose)
    named = []
    for index, seen in enumerate(bent._seen):
        t_s = index / 30
        if t_s >= 10:
            evidence.window.add(motion(t_s, index, seen.path_px, seen.path_rad, chain=2))
            if index % 10 == 9:
                evidence.solve(evidence.window.now_ns)
                named.append({check.name for check in evidence.checks() if check.verdict is FAULT})
    assert set().union(*named) == {"rotation-lateral"}
    assert next(k for k, names in enumerate(named) if names) <= 12, "a solution comes each third of a second"
    assert by_name(evidence.checks())["rotation-lateral"].value == pytest.approx(8, abs=1)


def test_one_solution_alone_accuses_nobody() -> None:
    evidence, whole = watched()
    for seen in list(whole._seen)[:150]:
        t_s = (seen.stamp.t_ns - whole._seen[0].stamp.t_ns) / 1e9
        evidence.window.add(motion(t_s, 0, seen.path_px / 1.15, seen.path_rad))
    evidence.solve(evidence.window.now_ns)
    assert all(check.verdict is not FAULT for check in evidence.checks())
    evidence.solve(evidence.window.now_ns)
    assert any(check.verdict is FAULT for check in evidence.checks())


def test_after_a_restart_nothing_stands() -> None:
    evidence, whole = watched()
    fed(evidence, whole, 0, 6)
    assert evidence.shows("polarity")
    evidence.restart()
    assert not evidence.shows("polarity")
    assert all(check.verdict is NOT_VERIFIED for check in evidence.checks())


def test_the_final_answer_keeps_the_best_that_was_known() -> None:
    evidence, whole = watched()
    fed(evidence, whole, 0, 10)
    final = by_name(evidence.final(evidence.finish()))
    assert final["scale-axial"].verdict is OK
    assert evidence.estimate is not None
    assert evidence.motions > 100
    np.testing.assert_allclose(evidence.estimate.scale_mm_per_px, TRUTH.scale_mm_per_px, rtol=0.02)


def late(late_s: float, seconds: float = 8.0) -> Evidence:
    """A tracker that is so much too late from the start, asked each third of a second from the fifth on."""
    whole = filled(tilting_path, seconds, 6, late_s=late_s)
    window = PathWindow(TRUTH)
    window.poses = whole.poses
    evidence = Evidence(TRUTH, LIMITS, window)
    for index, seen in enumerate(whole._seen):
        window.add(seen)
        if index >= 150 and index % 10 == 9:
            evidence.solve(window.now_ns)
    return evidence


@pytest.mark.parametrize("late_s", [0.45, -0.45])
def test_a_tracker_later_than_the_fine_search_reaches_is_named_with_its_lag(late_s: float) -> None:
    evidence = late(late_s, 6.0)
    assert {check.name for check in evidence.checks() if check.verdict is FAULT} == {"latency"}
    assert by_name(evidence.checks())["latency"].value == pytest.approx(1e3 * late_s, abs=30)
    assert evidence.status.verified_ns is None


def test_a_lag_that_the_fine_search_does_not_confirm_may_be_a_fault_but_no_ok() -> None:
    whole = filled(tilting_path, 4.0, 6, late_s=0.45)
    short = whole.since(whole.now_ns - 1_000_000_000)
    assert short.latency(0.45) is None
    verdicts = [
        by_name(examine(short, TRUTH, limits, about_s=0.45).checks)["latency"].verdict
        for limits in (LIMITS, Limits(latency_ms=900))
    ]
    assert verdicts == [FAULT, NOT_VERIFIED]


@pytest.mark.thorough
def test_a_far_latency_that_is_mended_comes_back_to_ok() -> None:
    evidence = late(0.45)
    good = filled(tilting_path, 30.0, 6)
    evidence.window.poses = good.poses
    for index, seen in enumerate(good._seen):
        if index < 240:
            continue
        evidence.window.add(seen)
        if index % 10 == 9:
            evidence.solve(evidence.window.now_ns)
    assert by_name(evidence.checks())["latency"].verdict is OK
    assert evidence.status.verified_ns is not None


@pytest.mark.thorough
@pytest.mark.parametrize("late_s", [0.1, 0.45])
def test_a_lag_that_begins_amid_motion_is_named_with_its_value_within_two_seconds(late_s: float) -> None:
    whole = filled(tilting_path, 14.0, 6)
    window = PathWindow(TRUTH)
    evidence = Evidence(TRUTH, LIMITS, window)
    onset_ns = whole.start_ns + 10_000_000_000
    whole.poses.arrays(0)
    asked_ns = whole.poses._times_ns - np.where(whole.poses._times_ns >= onset_ns, round(late_s * 1e9), 0)
    poses, _ = whole.poses.at((asked_ns - whole.start_ns) / 1e9, whole.start_ns)
    track = list(zip(whole.poses._times_ns, poses, strict=True))
    named_s = None
    for index, seen in enumerate(whole._seen):
        window.add(seen)
        while track and track[0][0] <= window.now_ns:
            t_ns, pose = track.pop(0)
            window.poses.add(int(t_ns), pose)
        if index % 10 == 9:
            evidence.solve(window.now_ns)
            latency = by_name(evidence.checks())["latency"]
            assert latency.verdict is not FAULT or window.now_ns > onset_ns
            if latency.verdict is FAULT and named_s is None:
                named_s = (window.now_ns - onset_ns) / 1e9
                assert latency.value == pytest.approx(1e3 * late_s, abs=30)
    assert named_s is not None
    assert named_s < 2.0


@pytest.mark.thorough
def test_a_latency_that_drifts_is_named_before_its_window_has_passed_the_limit() -> None:
    whole = filled(tilting_path, 24.0, 6)
    window = PathWindow(TRUTH)
    evidence = Evidence(TRUTH, LIMITS, window)
    whole.poses.arrays(0)
    late_ns = [round(max(t_ns - whole.start_ns - 12e9, 0) * 0.01) for t_ns in whole.poses._times_ns]
    poses = whole.poses.at((whole.poses._times_ns - whole.start_ns) / 1e9, whole.start_ns)[0]
    for t_ns, late, pose in zip(whole.poses._times_ns, late_ns, poses, strict=True):
        window.poses.add(int(t_ns) + late, pose)
    named_s = []
    for index, seen in enumerate(whole._seen):
        window.add(seen)
        if index % 10 == 9:
            evidence.solve(window.now_ns)
            if by_name(evidence.checks())["latency"].verdict is FAULT:
                named_s.append((window.now_ns - whole.start_ns) / 1e9)
    assert named_s
    assert 60 < 10 * (named_s[0] - 12) < 80
