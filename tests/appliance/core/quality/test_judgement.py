"""Quality Control: from checks to a verdict, and from verdicts to the verdict on a session."""

from dataclasses import replace

import numpy as np
import pytest

from appliance.core.quality.judgement import Judgement, judge
from appliance.core.quality.verification import Standing
from appliance.limits import Limits
from appliance.types import Check, Fault, Kind, Verdict, VerdictKind

OK, FAULT, NOT_VERIFIED = VerdictKind.OK, VerdictKind.FAULT, VerdictKind.NOT_VERIFIED
SECOND_NS = 1_000_000_000
REQUIRED = Limits().required_age_s.names
STANDING = Standing(REQUIRED)


def check(name: str, verdict: VerdictKind = OK, value: float = 1.0, fault: str | None = None) -> Check:
    return Check(name, Fault(fault or name.split("-", maxsplit=1)[0]), value, 0.1, "%", 5.0, verdict)


HEALTHY = (*(check(name) for name in REQUIRED), check("latency"))


def failing(name: str, value: float = 8.0, fault: str | None = None) -> tuple[Check, ...]:
    return (*(c for c in HEALTHY if c.name != name), check(name, FAULT, value, fault))


def test_all_required_checks_shown_is_ok() -> None:
    assert judge(7, HEALTHY, STANDING).kind is OK
    assert judge(7, (*HEALTHY, check("offset-axial", NOT_VERIFIED)), STANDING).kind is OK, (
        "an ordinary sweep may lack this one"
    )


@pytest.mark.parametrize("name", REQUIRED)
def test_a_required_check_that_is_not_shown_withholds_the_ok_and_is_named(name: str) -> None:
    unseen = tuple(replace(c, verdict=NOT_VERIFIED, value=np.nan) if c.name == name else c for c in HEALTHY)
    absent = tuple(c for c in HEALTHY if c.name != name)
    for checks in (unseen, absent):
        verdict = judge(7, checks, STANDING)
        assert (verdict.kind, verdict.fault) == (NOT_VERIFIED, None)
        assert name in verdict.reason


@pytest.mark.parametrize("name", [*REQUIRED, "latency", "rotation-lateral", "offset-axial"])
def test_any_failing_check_is_a_fault_with_value_and_limit(name: str) -> None:
    verdict = judge(7, failing(name), STANDING)
    assert (verdict.kind, verdict.fault) == (FAULT, name.split("-", maxsplit=1)[0])
    assert verdict.reason == f"{name} +8 %, limit 5 %"


@pytest.mark.parametrize("fault", [fault for fault in Fault if fault.kind is Kind.SIGHT])
@pytest.mark.parametrize("name", ["no-picture", "a new detector's check"])
def test_a_check_of_sight_withholds_the_ok_whatever_its_name(name: str, fault: str) -> None:
    unseen = Check(name, fault, 600.0, 0.0, "ms", 500.0, NOT_VERIFIED)
    verdict = judge(7, (*HEALTHY, unseen), replace(STANDING, verified_ns=6))
    assert (verdict.kind, verdict.fault, verdict.verified_ns) == (NOT_VERIFIED, None, None)
    assert verdict.reason == f"nothing to compare: {name}"
    assert judge(7, (*HEALTHY, replace(unseen, verdict=OK)), STANDING).kind is OK


@pytest.mark.parametrize("fault", [fault for fault in Fault if fault.kind is not Kind.SIGHT])
def test_a_check_of_another_kind_that_shows_nothing_withholds_nothing(fault: str) -> None:
    assert judge(7, (*HEALTHY, Check("a figure", fault, np.nan, np.nan, "", 1.0, NOT_VERIFIED)), STANDING).kind is OK


def test_of_several_faults_the_one_that_spoils_the_others_is_named() -> None:
    scale, latency = check("scale-axial", FAULT, 50.0), check("latency", FAULT, 6.0)
    polarity = check("polarity", FAULT, 6.0)
    frozen = check("frozen", FAULT, 6.0, "frozen-video")
    rotation = check("rotation-axial", FAULT, 20.0)
    assert judge(0, (scale, rotation), STANDING).fault == "scale"
    assert judge(0, (scale, latency), STANDING).fault == "latency"
    assert judge(0, (latency, polarity, scale), STANDING).fault == "polarity"
    assert judge(0, (polarity, frozen, latency), STANDING).fault == "frozen-video"


def session(*spans: tuple[float, tuple[Check, ...]]) -> Verdict:
    """Verdicts every tenth of a second over spans of (seconds, checks)."""
    judgement, t_ns = Judgement(REQUIRED), 0
    for seconds, checks in spans:
        for _ in range(round(seconds * 10)):
            judgement.note(judge(t_ns, checks, STANDING))
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
    judgement.note(judge(0, UNSEEN, STANDING))
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
    verdict = Judgement(REQUIRED).overall(checks) if whole_session else judge(7, checks, STANDING)
    assert verdict.kind is NOT_VERIFIED
    assert verdict.reason == "picture and tracker disagree: motion-agreement 17 × its limit"
    agreed = (*UNSHOWN, agreement(0.05))
    assert (
        "disagree" not in (Judgement(REQUIRED).overall(agreed) if whole_session else judge(7, agreed, STANDING)).reason
    )


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
    clauses = judge(7, (*rest, doubtful), STANDING).reason.split("; ")
    assert [clause for clause in clauses if "its limit" in clause] == ([said] if said else [])
    assert len(clauses) == 1 + bool(said), "what is verified or missing is said as well"
