"""Quality Control: from checks to a verdict, and from verdicts to the verdict on a session."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from probewatch.appliance.core.quality.judgement import Judgement, bounded, judge
from probewatch.appliance.core.quality.verification import Contradiction, VerificationStatus
from probewatch.appliance.limits import Limits
from probewatch.appliance.supervision.languages import translated_text
from probewatch.appliance.types import Check, Fault, Kind, PointError, Verdict, VerdictKind

OK, FAULT, NOT_VERIFIED = VerdictKind.OK, VerdictKind.FAULT, VerdictKind.NOT_VERIFIED
SECOND_NS = 1_000_000_000
REQUIRED = Limits().required_age_s.names
STATUS = VerificationStatus(REQUIRED)


def check(name: str, verdict: VerdictKind = OK, value: float = 1.0, fault: str | None = None) -> Check:
    return Check(name, Fault(fault or name.split("-", maxsplit=1)[0]), value, 0.1, "%", 5.0, verdict)


HEALTHY = (*(check(name) for name in REQUIRED), check("latency"))


def failing(name: str, value: float = 8.0, fault: str | None = None) -> tuple[Check, ...]:
    return (*(c for c in HEALTHY if c.name != name), check(name, FAULT, value, fault))


def test_all_required_checks_shown_is_ok() -> None:
    assert judge(7, HEALTHY, STATUS).kind is OK
    assert judge(7, (*HEALTHY, check("offset-axial", NOT_VERIFIED)), STATUS).kind is OK, (
        "an ordinary sweep may lack this one"
    )


@pytest.mark.parametrize("name", REQUIRED)
def test_a_required_check_that_is_not_shown_withholds_the_ok_and_is_named(name: str) -> None:
    unseen = tuple(replace(c, verdict=NOT_VERIFIED, value=np.nan) if c.name == name else c for c in HEALTHY)
    absent = tuple(c for c in HEALTHY if c.name != name)
    for checks in (unseen, absent):
        verdict = judge(7, checks, STATUS)
        assert (verdict.kind, verdict.fault) == (NOT_VERIFIED, None)
        assert name in verdict.reason


@pytest.mark.parametrize("name", [*REQUIRED, "latency", "rotation-lateral", "offset-axial"])
def test_any_failing_check_is_a_fault_with_value_and_limit(name: str) -> None:
    verdict = judge(7, failing(name), STATUS)
    assert (verdict.kind, verdict.fault) == (FAULT, name.split("-", maxsplit=1)[0])
    assert verdict.reason == f"{name} +8 %, limit 5 %"


@pytest.mark.parametrize("fault", [fault for fault in Fault if fault.kind is Kind.SIGHT])
@pytest.mark.parametrize("name", ["no-picture", "a new detector's check"])
def test_a_check_of_sight_withholds_the_ok_whatever_its_name(name: str, fault: str) -> None:
    unseen = Check(name, fault, 600.0, 0.0, "ms", 500.0, NOT_VERIFIED)
    verdict = judge(7, (*HEALTHY, unseen), replace(STATUS, verified_ns=6))
    assert (verdict.kind, verdict.fault, verdict.verified_ns) == (NOT_VERIFIED, None, None)
    assert verdict.reason == f"nothing to compare: {name}"
    assert judge(7, (*HEALTHY, replace(unseen, verdict=OK)), STATUS).kind is OK


@pytest.mark.parametrize("fault", [fault for fault in Fault if fault.kind is not Kind.SIGHT])
def test_a_check_of_another_kind_that_shows_nothing_withholds_nothing(fault: str) -> None:
    assert judge(7, (*HEALTHY, Check("a figure", fault, np.nan, np.nan, "", 1.0, NOT_VERIFIED)), STATUS).kind is OK


def test_of_several_faults_the_one_that_spoils_the_others_is_named() -> None:
    scale, latency = check("scale-axial", FAULT, 50.0), check("latency", FAULT, 6.0)
    polarity = check("polarity", FAULT, 6.0)
    frozen = check("frozen", FAULT, 6.0, "frozen-video")
    rotation = check("rotation-axial", FAULT, 20.0)
    assert judge(0, (scale, rotation), STATUS).fault == "scale"
    assert judge(0, (scale, latency), STATUS).fault == "latency"
    assert judge(0, (latency, polarity, scale), STATUS).fault == "polarity"
    assert judge(0, (polarity, frozen, latency), STATUS).fault == "frozen-video"


def session(*spans: tuple[float, tuple[Check, ...]]) -> Verdict:
    """Verdicts every tenth of a second over spans of (seconds, checks)."""
    judgement, t_ns = Judgement(REQUIRED), 0
    for seconds, checks in spans:
        for _ in range(round(seconds * 10)):
            judgement.note(judge(t_ns, checks, STATUS))
            t_ns += SECOND_NS // 10
    return judgement.overall(HEALTHY)


UNSEEN = tuple(replace(c, verdict=NOT_VERIFIED) for c in HEALTHY)


def test_a_session_verified_once_is_ok_whatever_stayed_unseen_afterwards() -> None:
    assert session((0.2, HEALTHY), (5.0, UNSEEN)).kind is OK


def test_a_fault_counts_once_it_has_lasted_a_second() -> None:
    assert session((1.0, HEALTHY), (0.9, failing("scale-axial")), (1.0, HEALTHY)).kind is OK
    verdict = session((1.0, HEALTHY), (1.2, failing("scale-axial")), (5.0, HEALTHY))
    assert (verdict.kind, verdict.fault) == (FAULT, "scale")
    failed = next(c for c in verdict.checks if c.name == "scale-axial")
    assert (failed.verdict, failed.value) == (FAULT, 8.0), "the failing check stands in the report"


def test_a_fault_that_comes_and_goes_does_not_add_up() -> None:
    flicker = ((0.5, failing("scale-axial")), (0.1, HEALTHY)) * 6
    assert session(*flicker).kind is OK


def test_of_two_lasting_faults_the_longer_one_names_the_session() -> None:
    assert session((2.0, failing("scale-axial")), (3.0, failing("rotation-elevational"))).fault == "rotation"


def test_nothing_shown_is_not_verified_with_what_was_missing() -> None:
    judgement = Judgement(REQUIRED)
    judgement.note(judge(0, UNSEEN, STATUS))
    verdict = judgement.overall(UNSEEN)
    assert verdict.kind is NOT_VERIFIED
    assert all(name in verdict.reason for name in REQUIRED)
    assert Judgement(REQUIRED).overall(HEALTHY).kind is NOT_VERIFIED, "shown in parts, never at once"


UNSHOWN = tuple(replace(one, verdict=NOT_VERIFIED, value=np.nan) for one in HEALTHY)


def agreement(value: float) -> Check:
    return Check("motion-agreement", Fault.AGREEMENT, value, 0.0, "1 − r", 0.1, OK if value <= 0.1 else NOT_VERIFIED)


@pytest.mark.parametrize("whole_session", [False, True])
def test_picture_and_tracker_that_disagree_are_told_as_such(whole_session: bool) -> None:
    checks = (*UNSHOWN, agreement(1.7))
    verdict = Judgement(REQUIRED).overall(checks) if whole_session else judge(7, checks, STATUS)
    assert verdict.kind is NOT_VERIFIED
    assert verdict.reason == "picture and tracker disagree: motion-agreement 17 × its limit"
    agreed = (*UNSHOWN, agreement(0.05))
    assert "disagree" not in (Judgement(REQUIRED).overall(agreed) if whole_session else judge(7, agreed, STATUS)).reason


@pytest.mark.parametrize(
    ("value", "sigma", "said"),
    [
        (-28.4, 1.5, "beyond its limit, not certain: offset-elevational -28.4 ± 1.5 mm, limit 4 mm"),
        (3.6, 0.2, "near its limit, not certain: offset-elevational +3.6 ± 0.2 mm, limit 4 mm"),
        (3.6, 0.6, ""),
        (6.0, 6.0, ""),
        (np.nan, 1.0, ""),
    ],
)
@pytest.mark.parametrize("rest", [HEALTHY, UNSHOWN])
def test_an_estimate_near_or_beyond_its_limit_is_named(
    value: float, sigma: float, said: str, rest: tuple[Check, ...]
) -> None:
    doubtful = Check("offset-elevational", Fault.OFFSET, value, sigma, "mm", 4.0, NOT_VERIFIED)
    clauses = judge(7, (*rest, doubtful), STATUS).reason.split("; ")
    assert [clause for clause in clauses if "its limit" in clause] == ([said] if said else [])
    assert len(clauses) == 1 + bool(said), "what is verified or missing is said as well"


def error(worst_mm: float, shown_ns: int = 5) -> PointError:
    return PointError((worst_mm / 2, worst_mm), (worst_mm / 3, worst_mm / 1.5), None, None, shown_ns)


VERIFIED = replace(STATUS, verified_ns=6, expires_ns=9)


def test_without_a_limit_the_error_of_a_point_is_told_and_nothing_else_changes() -> None:
    for checks in (HEALTHY, UNSHOWN):
        verdict = judge(7, checks, VERIFIED)
        assert bounded(verdict, error(50.0), None) == replace(verdict, point=error(50.0))
        assert bounded(verdict, None, None) == verdict


def test_an_error_within_its_limit_leaves_the_ok_which_is_as_old_as_the_error() -> None:
    verdict = bounded(judge(7, HEALTHY, VERIFIED), error(2.5, shown_ns=5), 2.5)
    assert (verdict.kind, verdict.verified_ns, verdict.expires_ns) == (OK, 5, 9)
    younger = bounded(judge(7, HEALTHY, VERIFIED), error(2.5, shown_ns=7), 2.5)
    assert younger.verified_ns == 6


@pytest.mark.parametrize(
    ("point", "said"),
    [
        (error(3.14), "error of a point 3.2 mm, limit 2.5 mm"),
        (error(2.501), "error of a point 2.6 mm, limit 2.5 mm"),
        (None, "error of a point not known, limit 2.5 mm"),
    ],
)
def test_beyond_the_limit_and_where_it_is_not_known_the_ok_is_withheld(point: PointError | None, said: str) -> None:
    verdict = bounded(judge(7, HEALTHY, VERIFIED), point, 2.5)
    assert (verdict.kind, verdict.fault, verdict.reason) == (NOT_VERIFIED, None, said)
    assert (verdict.verified_ns, verdict.expires_ns, verdict.point) == (None, None, point)
    assert translated_text(said, "de") == said.replace("error of a point", "Fehler eines Punktes").replace(
        "limit", "Grenze"
    ).replace("not known", "unbekannt")


def test_what_earlier_motion_verified_is_withheld_as_well() -> None:
    verdict = bounded(judge(7, UNSHOWN, VERIFIED), error(3.0), 2.5)
    assert (verdict.kind, verdict.verified_ns) == (NOT_VERIFIED, None)
    assert verdict.reason.endswith("; error of a point 3.0 mm, limit 2.5 mm")
    carried = bounded(judge(7, UNSHOWN, VERIFIED), error(2.0), 2.5)
    assert (carried.kind, carried.verified_ns) == (NOT_VERIFIED, 5)


POINTS = st.none() | st.builds(error, st.floats(0.0, 20.0), st.integers(0, 9))
VERDICTS_OF_CHECKS = st.lists(st.sampled_from(list(VerdictKind)), min_size=len(HEALTHY), max_size=len(HEALTHY))


@given(VERDICTS_OF_CHECKS, st.booleans(), st.booleans(), POINTS, st.floats(0.5, 50.0), st.none() | st.integers(0, 9))
def test_a_limit_in_millimetres_only_ever_withholds(
    kinds: list[VerdictKind], contradicted: bool, broke: bool, point: PointError | None, limit_mm: float, at: int | None
) -> None:
    checks = tuple(replace(one, verdict=kind) for one, kind in zip(HEALTHY, kinds, strict=True))
    contradictions = (Contradiction(HEALTHY[0], 3, named=False),) if contradicted else ()
    status = replace(STATUS, contradictions=contradictions, verified_ns=None if contradictions else at, expires_ns=at)
    without = judge(7, checks, status, broke)
    limited, plain = bounded(without, point, limit_mm), bounded(without, point, None)
    assert limited.fault == without.fault == plain.fault
    assert limited.checks == without.checks
    assert plain.kind is without.kind
    if limited.kind is OK:
        assert without.kind is OK
        assert point is not None
        assert point.worst_mm[1] <= limit_mm
    else:
        assert limited.kind in (without.kind, NOT_VERIFIED)
    if limited.verified_ns is not None:
        assert without.verified_ns is not None
        assert limited.verified_ns <= without.verified_ns
        assert limited.expires_ns == without.expires_ns
    if without.kind is FAULT:
        assert limited.point is None


def test_a_session_has_the_error_as_it_was_last_known_and_none_beside_a_fault() -> None:
    judgement = Judgement(REQUIRED)
    for t_ns, point in ((1, error(3.0)), (2, error(2.0)), (3, None)):
        judgement.note(bounded(judge(t_ns, HEALTHY, STATUS), point, None))
    assert judgement.overall(HEALTHY).point == error(2.0)
    for t_ns in (4, 4 + 2 * SECOND_NS):
        judgement.note(bounded(judge(t_ns, failing("polarity"), STATUS), error(2.0), None))
    assert judgement.overall(HEALTHY).point is None


def test_a_session_that_its_limit_of_a_point_withheld_says_so() -> None:
    """It said "verified only in parts", though every check was shown."""
    judgement = Judgement(REQUIRED)
    judgement.note(bounded(judge(1, UNSEEN, STATUS), None, 2.5))
    judgement.note(bounded(judge(2, HEALTHY, STATUS), error(3.0), 2.5))
    verdict = judgement.overall(HEALTHY)
    assert (verdict.kind, verdict.reason) == (NOT_VERIFIED, "error of a point 3.0 mm, limit 2.5 mm")
