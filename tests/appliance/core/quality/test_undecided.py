"""One of two: an alarm with both names, by the evidence that names a fault and no less."""

from collections.abc import Callable
from copy import deepcopy

import pytest

from probewatch.appliance.core.quality.evidence import Evidence
from probewatch.appliance.core.quality.judgement import Judgement, judge
from probewatch.appliance.core.quality.sequential_test import Accusation
from probewatch.appliance.core.quality.undecided import Choice, undecided
from probewatch.appliance.core.quality.verification import Contradiction, VerificationStatus
from probewatch.appliance.limits import NAMED_NATS, Limits
from probewatch.appliance.supervision.languages import translated_text
from probewatch.appliance.types import Check, Fault, Rival, VerdictKind
from probewatch.drivers.rigid import Array
from tests.appliance.core.quality.test_sequential_test import SLID, in_step, in_turn
from tests.support.motions import TRUTH, tilting_path
from tests.support.windows import filled

NOT_VERIFIED = VerdictKind.NOT_VERIFIED
SCALED = Check("scale-lateral", Fault.SCALE, 12.0, 3.0, "%", 5.0, NOT_VERIFIED)
SLIPPED = Check("offset-axial", Fault.OFFSET, 9.0, 2.0, "mm", 4.0, NOT_VERIFIED)
TWO = Rival(SCALED, 0.0), Rival(SLIPPED, 2.1)
STATUS = VerificationStatus(
    (), contradictions=(Contradiction(SCALED, 0, False), Contradiction(SLIPPED, 0, False)), rivals=TWO
)


def accusation(nats: float, rivals: tuple[Rival, ...] = TWO) -> Accusation:
    return Accusation(0, nats, tuple(rival.check for rival in rivals), rivals)


def choice() -> Check:
    found = undecided(accusation(40.0), frozenset())
    assert found is not None
    return found


def test_two_that_are_as_likely_are_a_fault_from_the_evidence_on_that_names_one() -> None:
    check = undecided(accusation(NAMED_NATS), frozenset())
    assert check is not None
    assert (check.fault, check.verdict, check.ratio) == (Fault.UNDECIDED, VerdictKind.FAULT, 1.0)
    assert undecided(accusation(NAMED_NATS - 0.1), frozenset()) is None


def test_one_alone_or_one_that_may_be_a_breath_is_no_choice() -> None:
    assert undecided(accusation(99.0, ()), frozenset()) is None
    assert undecided(accusation(99.0), frozenset({"scale-lateral"})) is None
    assert undecided(accusation(99.0), frozenset({"scale-axial"})) is not None


def test_the_verdict_is_a_fault_that_tells_both_names_and_the_motion_that_tells_which() -> None:
    verdict = judge(5, (choice(),), STATUS)
    assert (verdict.kind, verdict.fault, verdict.rivals) == (VerdictKind.FAULT, Fault.UNDECIDED, TWO)
    assert verdict.reason == (
        "cause undecided, 2.1 nat apart: scale-lateral, offset-axial; "
        "to decide: slide it sideways, 10 mm to and fro + rock it in the picture's plane, 8° each way"
    )
    assert translated_text(verdict.reason, "de").startswith(
        "Ursache unentschieden, 2.1 nat auseinander: Maßstab lateral, Versatz"
    )


@pytest.mark.parametrize("named", ["rotation-axial", "polarity", "latency", "frozen-video"])
def test_what_has_a_name_is_told_first(named: str) -> None:
    fault = Fault(named.split("-", maxsplit=1)[0] if named.startswith("rotation") else named)
    failed = Check(named, fault, 4.0, 0.1, "deg", 3.0, VerdictKind.FAULT)
    verdict = judge(5, (choice(), failed), STATUS)
    assert (verdict.fault, verdict.rivals) == (fault, TWO)
    assert verdict.reason.startswith(f"{named} +4 deg, limit 3 deg; cause undecided")


def test_a_recording_in_which_it_lasted_is_told_as_that() -> None:
    judgement = Judgement(())
    for t_ns in (0, 2_000_000_000):
        judgement.note(judge(t_ns, (choice(),), STATUS))
    whole = judgement.overall(())
    assert (whole.kind, whole.fault, whole.rivals) == (VerdictKind.FAULT, Fault.UNDECIDED, TWO)


def evidence_of(path: Callable[[Array], Array], seconds: float) -> Evidence:
    """Of a body that has slipped while nothing was in sight, after healthy motion that showed the noise."""
    evidence = Evidence(TRUTH, Limits(), filled(tilting_path, 10.0, 1))
    evidence.solve(evidence.window.now_ns)
    evidence.window = filled(path, seconds, 2, truth=SLID)
    for after_ns in (0, 1_000_000_000):
        evidence.solve(evidence.window.now_ns + after_ns)
    return evidence


def test_motion_that_hides_which_it_is_raises_the_alarm_and_motion_that_tells_names_it() -> None:
    hidden, shown = evidence_of(in_step, 5.5), evidence_of(in_turn, 5.5)
    assert [check.name for check in hidden.checks() if check.verdict is VerdictKind.FAULT] == ["undecided"]
    assert judge(0, hidden.checks(), hidden.status).fault is Fault.UNDECIDED
    assert Fault.UNDECIDED not in {check.fault for check in shown.checks()}
    assert judge(0, shown.checks(), shown.status).fault is Fault.OFFSET


def test_a_choice_that_lasts_for_less_than_a_second_is_none() -> None:
    kept = Choice()
    for t_ns, check, told_of in (
        (0, choice(), False),
        (999_999_999, choice(), False),
        (1_000_000_000, choice(), True),
        (1_300_000_000, None, False),
        (1_600_000_000, choice(), False),
    ):
        kept.note(check, t_ns)
        assert (kept.check is not None) is told_of


def test_it_goes_with_the_motion_that_it_was_of() -> None:
    raised = evidence_of(in_step, 5.5)
    for forget in (Evidence.restart, Evidence.lose_sight, lambda evidence: evidence.forget(0)):
        evidence = deepcopy(raised)
        forget(evidence)
        assert Fault.UNDECIDED not in {check.fault for check in evidence.checks()}
        assert evidence.status.verified_ns is None
