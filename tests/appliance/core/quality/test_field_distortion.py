"""A field that bends poses with the place is told from every calibration that is wrong, and withholds the OK."""

from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.acquisition.pairing import Unpaired
from probewatch.appliance.core.line import Line
from probewatch.appliance.core.path.blocks import BREATHING
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.evidence import Evidence
from probewatch.appliance.core.quality.field_distortion import DOUBTED_NATS, NAME, FieldDistortion, distortion_nats
from probewatch.appliance.core.quality.innovations import Innovations
from probewatch.appliance.core.quality.judgement import judge
from probewatch.appliance.core.quality.verification import VerificationStatus
from probewatch.appliance.core.spread_work import run_to_end
from probewatch.appliance.limits import NAMED_NATS, Limits
from probewatch.appliance.supervision.supervisor import Durations, Inputs, Supervisor
from probewatch.appliance.types import Check, Fault, Verdict, VerdictKind
from probewatch.drivers.rigid import Array, rigid, rotation_from_vector
from probewatch.drivers.samples import Frame, Stamp
from tests.appliance.core.quality.test_sequential_test import known
from tests.support.motions import TRUTH, tilting_path
from tests.support.windows import BEFORE_S, POSE_HZ, filled

FAULT, OK, NOT_VERIFIED = VerdictKind.FAULT, VerdictKind.OK, VerdictKind.NOT_VERIFIED
SECOND_NS = 1_000_000_000


def stretched(poses: Array, per_mm: Array, turn_per_mm: Array) -> Array:
    """Another world than the study's dipoles: displaced by per_mm (3, 3) and turned by turn_per_mm (3, 3), rad/mm, of
    the way from where the path begins.
    """
    away = poses[:, :3, 3] - poses[0, :3, 3]
    bent = rigid(rotation_from_vector(away @ turn_per_mm.T), np.zeros((len(poses), 3))) @ poses
    bent[:, :3, 3] = poses[:, :3, 3] + away @ per_mm.T
    return bent


def verdicts(played: PathWindow, every: int = 10) -> list[Verdict]:
    """One for so many pictures."""
    window = PathWindow(TRUTH)
    window.poses = played.poses
    evidence, told = Evidence(TRUTH, Limits(), window), list[Verdict]()
    for index, seen in enumerate(played._seen):
        window.add(seen)
        if index % every == every - 1:
            evidence.solve(window.now_ns)
            told.append(judge(window.now_ns, evidence.checks(), evidence.status))
    return told


def brought(seed: int, per_mm: float, deg_per_mm: float) -> list[Verdict]:
    """Twelve seconds without the field and twelve with it, along random directions."""
    random = np.random.default_rng(seed)
    ways = random.normal(size=(2, 3, 3))
    ways /= np.linalg.norm(ways, axis=(1, 2), keepdims=True)

    def field(poses: Array) -> Array:
        before = round((12.0 + BEFORE_S) * POSE_HZ)
        bent = stretched(poses, per_mm * ways[0], np.deg2rad(deg_per_mm) * ways[1])
        return np.concatenate([poses[:before], bent[before:]])

    return verdicts(filled(tilting_path, 24.0, seed, field=field))


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [0, *(pytest.param(one, marks=pytest.mark.slow) for one in (2, 3))])
def test_a_field_that_no_parameter_passes_for_is_named(seed: int) -> None:
    """It may pass for a parameter at first, and is named so; on seed 1 to the end."""
    told = brought(seed, 0.1, 0.1)
    assert told[34].kind is OK
    assert told[-1].fault is Fault.FIELD_DISTORTION
    assert NAME in told[-1].reason
    assert {verdict.kind for verdict in told[-3:]} == {FAULT}


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [0, *(pytest.param(one, marks=pytest.mark.slow) for one in (1, 2, 3))])
def test_without_it_nothing_is_said(seed: int) -> None:
    told = brought(seed, 0.0, 0.0)
    assert all(check.name != NAME for verdict in told for check in verdict.checks)
    assert told[-1].kind is OK


def test_one_pose_far_away_is_no_evidence() -> None:
    """More than a hundred standard deviations, as a place and as the way that slopes are counted by."""

    def leaping(poses: Array) -> Array:
        poses = poses.copy()
        poses[len(poses) // 2, 0, 3] += 50.0
        return poses

    for seed in range(3):
        window = filled(tilting_path, 9.0, seed, field=leaping)
        nats = run_to_end(distortion_nats(Innovations(window, TRUTH, known(), 0.0)))
        assert nats is not None
        assert nats < 2.0


def test_over_less_than_a_breath_nothing_is_told_from_a_breath() -> None:
    """The probe covers 20 mm and more."""
    bent = filled(tilting_path, 9.0, 1, field=lambda poses: stretched(poses, 0.2 * np.eye(3)[::-1], np.zeros((3, 3))))

    def told(breathing_mm: float) -> float | None:
        variances = known().variances.copy()
        variances[1, BREATHING] = breathing_mm**2
        return run_to_end(distortion_nats(Innovations(bent, TRUTH, replace(known(), variances=variances), 0.0)))

    assert (told(2.0) or 0.0) > DOUBTED_NATS
    assert told(30.0) is None


def noted(*nats: float | None, explained: bool = False, window_s: float = 0.5) -> list[VerdictKind | None]:
    """A solution each second, of so long a window."""
    watched, verdicts = FieldDistortion(NAMED_NATS), list[VerdictKind | None]()
    for second, one in enumerate(nats):
        now_ns = second * SECOND_NS
        watched.note(one, now_ns - round(window_s * SECOND_NS), now_ns, explained)
        verdicts.append(None if watched.check is None else watched.check.verdict)
    return verdicts


def test_evidence_must_last_to_name_it_and_end_to_forgive_it() -> None:
    assert noted(0.0, DOUBTED_NATS, NAMED_NATS, 40.0, NAMED_NATS - 1, DOUBTED_NATS - 1, 40.0) == [
        None, NOT_VERIFIED, NOT_VERIFIED, FAULT, FAULT, None, NOT_VERIFIED,
    ]  # fmt: skip


def test_only_a_window_wholly_after_it_forgives_it() -> None:
    assert noted(40.0, 40.0, 0.0, 0.0, 0.0, 0.0, window_s=2.5) == [NOT_VERIFIED, FAULT, FAULT, FAULT, None, None]


def test_one_bad_window_names_nothing() -> None:
    assert set(noted(0.0, 40.0, 0.0, 40.0, 0.0, 40.0)) == {None, NOT_VERIFIED}


def test_a_probe_that_rests_forgives_nothing() -> None:
    """Nobody can tell whether the metal is gone."""
    assert noted(DOUBTED_NATS, None, None, 0.0) == [NOT_VERIFIED, NOT_VERIFIED, NOT_VERIFIED, None]
    assert noted(40.0, 40.0, None, 0.0) == [NOT_VERIFIED, FAULT, FAULT, None]
    assert noted(40.0, None, 40.0) == [NOT_VERIFIED] * 3, "not shown to have lasted"


def test_beside_a_calibration_that_is_named_it_is_seen_and_not_named() -> None:
    assert noted(40.0, 40.0, 40.0, explained=True) == [NOT_VERIFIED] * 3


def test_once_a_calibration_is_named_it_is_not_named_any_more() -> None:
    watched = FieldDistortion(NAMED_NATS)
    for second in range(3):
        watched.note(40.0, 0, second * SECOND_NS, explained=False)
    assert watched.check is not None
    assert watched.check.verdict is FAULT
    watched.note(40.0, 0, 3 * SECOND_NS, explained=True)
    assert watched.check.verdict is NOT_VERIFIED


def test_it_is_asked_for_each_second_and_always_while_there_is_something() -> None:
    watched = FieldDistortion(NAMED_NATS)
    assert watched.due(0)
    watched.note(1.0, 0, 0, explained=False)
    assert [watched.due(now_ns) for now_ns in (SECOND_NS // 3, SECOND_NS, -SECOND_NS)] == [False, True, True]
    watched.note(8.0, 0, SECOND_NS, explained=False)
    assert watched.due(SECOND_NS + 1)


def test_what_is_seen_of_it_withholds_the_ok_and_nothing_but_motion_answers_it() -> None:
    window = filled(tilting_path, 9.0, 1)
    evidence = Evidence(TRUTH, Limits(), window)
    evidence.solve(window.now_ns)
    assert judge(window.now_ns, evidence.checks(), evidence.status).kind is OK
    evidence.distortion.note(DOUBTED_NATS, window.start_ns, window.now_ns, explained=False)
    verdict = judge(window.now_ns, evidence.checks(), evidence.status)
    assert (verdict.kind, verdict.verified_ns) == (NOT_VERIFIED, None)
    assert verdict.reason == "field-distortion +13.5 nat, limit 18.5 nat: waiting for it to be confirmed"
    evidence.solve(window.now_ns)
    assert evidence.status.verified_ns is None, "this window holds motion from before"
    evidence.forget(window.now_ns)
    assert evidence.status.contradictions, "a step of the clock forgives nothing"
    evidence.lose_sight()
    assert evidence.status.contradictions, "nor does a hand before the markers"
    assert any(check.name == NAME for check in evidence.final(evidence.finish()))


def test_a_picture_that_is_refused_closes_no_contact_over_it() -> None:
    """Such a verdict tells how old the verification is, and has no checks of motion."""
    window = filled(tilting_path, 9.0, 1)
    line, supervisor = Line(TRUTH, Limits()), Supervisor(Durations())
    line._evidence = Evidence(TRUTH, Limits(), window)
    line._evidence.solve(window.now_ns)
    line._sighted_ns = window.now_ns
    stamp = Stamp(window.now_ns + SECOND_NS // 30, 0)
    unreadable = Unpaired(Frame(stamp, 1, np.zeros((480, 640), np.uint16)), "")  # type: ignore[arg-type]
    line._evidence.distortion.note(DOUBTED_NATS, window.start_ns, window.now_ns, explained=False)
    now_ns = window.now_ns
    for verdict in (line._judged(now_ns, line._checks()), line._settled(unreadable)):
        for _ in range(40):
            now_ns += SECOND_NS // 50
            assert not supervisor.step(now_ns, Inputs((verdict,), ())).energised


@pytest.mark.thorough
def test_what_answered_it_shows_nothing_of_the_motion_before() -> None:
    """An OK is of motion wholly after what looked bent."""
    played, window = filled(tilting_path, 24.0, 1), PathWindow(TRUTH)
    window.poses = played.poses
    evidence, told, doubted_ns = Evidence(TRUTH, Limits(), window), list[Verdict](), 0
    for index, seen in enumerate(played._seen):
        window.add(seen)
        if index % 10 == 9:
            evidence.solve(window.now_ns)
        if index == 270:
            doubted_ns = window.now_ns
            evidence.distortion.note(DOUBTED_NATS, window.start_ns, doubted_ns, explained=False)
        if index % 10 == 9 and index > 270:
            told.append(judge(window.now_ns, evidence.checks(), evidence.status))
    back = next(verdict for verdict in told if verdict.kind is OK)
    assert back.t_ns > doubted_ns + 10 * SECOND_NS, "ten seconds is the window"
    assert back.verified_ns is not None
    assert back.verified_ns > doubted_ns


@pytest.mark.parametrize("other", [Fault.ROTATION, Fault.EXCHANGED_PROBE, Fault.FROZEN_VIDEO])
def test_any_other_fault_is_told_before_it(other: Fault) -> None:
    """It mends by itself, and must not hide what a person has to answer."""
    checks = tuple(Check(fault.value, fault, 40.0, 0.0, "", 1.0, FAULT) for fault in (Fault.FIELD_DISTORTION, other))
    verdict = judge(0, checks, VerificationStatus(()))
    assert verdict.fault is other
    assert NAME in verdict.reason
