"""The invariant is worth what it finds: an old hole, opened again in the code of today, breaks it.

One defence is taken away at a time, where its hole was; what holds the contact open elsewhere, such as the hazard of
pictures without tissue, stays. Hole 4 takes two: today a reference as wrong as it was is named before anything is
verified, and a contradiction withdraws the OK before it is named; each of them alone keeps the contact open.
"""

from collections.abc import Callable
from dataclasses import replace

import pytest

from probewatch.appliance.core.acquisition.pairing import Unpaired
from probewatch.appliance.core.acquisition.stamp_gate import StampCheck, StampGate
from probewatch.appliance.core.detectors import dissolved_picture, picture_chain
from probewatch.appliance.core.detectors.picture_chain import PictureChain
from probewatch.appliance.core.line import Line
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.confirmation import Memory, Solved, decide
from probewatch.appliance.core.quality.evidence import Evidence
from probewatch.appliance.core.quality.examination import Finding
from probewatch.appliance.core.quality.stationary_time import StationaryTime
from probewatch.appliance.core.quality.verification import Contradiction, Verification
from probewatch.appliance.core.spread_work import Steps
from probewatch.appliance.limits import Limits, RequiredAges
from probewatch.appliance.types import Check, StampedPair, Verdict, VerdictKind
from tests.invariant import test_invariant as holes
from tests.invariant.cart import Cart
from tests.invariant.circumstances import Manner, Pictures
from tests.invariant.oracle import SHIPPED, Broken
from tests.invariant.scenarios import verified_cart
from tests.invariant.world import ELSEWHERE, FLIPPED

Settled = Callable[[Line, StampedPair | Unpaired], Verdict]
SWEEPS_ALONE = RequiredAges.model_validate(dict.fromkeys(("offset-lateral", "offset-axial", "offset-elevational"), 0.0))
"""As a cart may be configured, and as every cart was when hole 4 was found; shipped, ζ itself must be shown first."""


def repeated(monkeypatch: pytest.MonkeyPatch, which: Callable[[StampedPair | Unpaired], bool]) -> None:
    """The last OK comes again with the time of these frames, as if they had shown it."""
    settled: Settled = Line._settled
    last: dict[int, Verdict] = {}

    def again(self: Line, item: StampedPair | Unpaired) -> Verdict:
        verdict = settled(self, item)
        if verdict.kind is VerdictKind.OK:
            last[id(self)] = verdict
        if not which(item) or id(self) not in last:
            return verdict
        return replace(last[id(self)], t_ns=verdict.t_ns, verified_ns=verdict.t_ns)

    monkeypatch.setattr(Line, "_settled", again)


@pytest.mark.thorough
def test_hole_1_a_frame_without_a_pose_repeats_the_last_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    repeated(monkeypatch, lambda item: isinstance(item, Unpaired))
    with pytest.raises(AssertionError):
        holes.test_hole_1_the_contact_does_not_outlive_one_good_pose_in_twelve(8)


@pytest.mark.slow
@pytest.mark.parametrize("stream", ["frame", "pose"])
def test_hole_2_a_stamp_in_the_future_is_believed(monkeypatch: pytest.MonkeyPatch, stream: str) -> None:
    def believed(self: StampGate, t_ns: int) -> StampCheck:
        if self.last_ns is not None and t_ns <= self.last_ns:
            return StampCheck.REFUSED
        self.last_ns = t_ns
        return StampCheck.IN

    monkeypatch.setattr(StampGate, "step", believed)
    with pytest.raises(AssertionError):
        holes.test_hole_2_one_stamp_in_the_future_does_not_end_pairing(stream)


@pytest.mark.slow
@pytest.mark.parametrize("pictures", [Pictures.NOISE, Pictures.BLACK])
def test_hole_3_evidence_is_dated_by_the_newest_picture(monkeypatch: pytest.MonkeyPatch, pictures: Pictures) -> None:
    """At a time when every picture was taken for tissue."""
    repeated(monkeypatch, lambda item: True)
    cart = verified_cart(1, fps=holes.SLOW, max_age_ns=8 * 10**9, discerning=False)
    cart.meet(pictures=pictures)
    with pytest.raises(AssertionError):
        cart.run(10.0)


@pytest.mark.thorough
def test_a_rest_that_nobody_saw_lets_the_contact_outlive_its_evidence(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = RequiredAges.model_validate(dict.fromkeys(SHIPPED.ages_s, 8.0))
    cart = verified_cart(1, fps=holes.SLOW, asked=asked, at_rest_s=4.0)
    cart.meet(moving=False)
    monkeypatch.setattr(StationaryTime, "since", lambda self, t_ns, lasting=False: 60 * 10**9)
    with pytest.raises(Broken, match="the last motion that showed"):
        cart.run(20.0)


def never_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Confirmation waits for ever: neither the long window nor the sequential test names what is wrong."""

    def nothing(self: Evidence, finding: Finding, whole: PathWindow, now_ns: int) -> Steps[None]:
        yield from ()

    def doubtful(memory: Memory, solved: Solved, limits: Limits) -> tuple[Memory, frozenset[str]]:
        return decide(memory, solved, limits)[0], solved.finding.failed

    monkeypatch.setattr("probewatch.appliance.core.quality.evidence.decide", doubtful)
    monkeypatch.setattr(Evidence, "_accused", nothing)


def sign_ignored(monkeypatch: pytest.MonkeyPatch) -> None:
    """A check beyond its limit by its own sigmas withdraws nothing."""
    monkeypatch.setattr(Verification, "_add", lambda self, check, named, until_ns: None)


def verify_elsewhere() -> None:
    """Long enough for a healthy sweep to close the contact; asked for is that nothing contradicts what is closed."""
    Cart(1, change=ELSEWHERE, fps=holes.SLOW, enforced="b", asked=SWEEPS_ALONE).run(15.0)


@pytest.mark.thorough
def test_hole_4_what_contradicts_the_reference_waits_to_be_named(monkeypatch: pytest.MonkeyPatch) -> None:
    never_named(monkeypatch)
    sign_ignored(monkeypatch)
    with pytest.raises(Broken, match="offset-elevational reads"):
        verify_elsewhere()


@pytest.mark.slow
@pytest.mark.parametrize("taken_away", [never_named, sign_ignored])
def test_hole_4_either_defence_alone_keeps_the_contact_open(
    monkeypatch: pytest.MonkeyPatch, taken_away: Callable[[pytest.MonkeyPatch], None]
) -> None:
    taken_away(monkeypatch)
    verify_elsewhere()


@pytest.mark.slow
def test_hole_5_any_measurement_answers_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    def at_once(self: Verification, check: Check, contradiction: Contradiction, since_ns: int) -> bool:
        return check.verdict is not VerdictKind.FAULT

    monkeypatch.setattr(Verification, "_resolved", at_once)
    with pytest.raises(AssertionError):
        holes.test_hole_5_a_fault_that_is_still_there_does_not_go_back_to_ok()


@pytest.mark.thorough
@pytest.mark.parametrize("cut", [False, True])
def test_a_picture_that_need_not_go_on_with_those_before_closes_the_contact_on_another(
    monkeypatch: pytest.MonkeyPatch, cut: bool
) -> None:
    """After .2 s of black, at rest: clause g finds it."""
    cart = verified_cart(1, fps=holes.SLOW)
    cart.meet(moving=False)
    cart.run(2.0)
    assert cart.closed
    if cut:
        monkeypatch.setattr(
            PictureChain, "linked", property(lambda self: True, lambda self, value: None), raising=False
        )
        for module in (picture_chain, dissolved_picture):
            monkeypatch.setattr(module, "flip_or_zoom_of", lambda before, now: None)
    cart.break_picture(FLIPPED, Manner.BLACK, 0.2)
    if cut:
        with pytest.raises(Broken, match="flipped laterally"):
            cart.run(3.0)
    else:
        cart.run(3.0)
