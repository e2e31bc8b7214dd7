"""What was shown stays shown until something contradicts it, and comes back only from motion after that."""

from dataclasses import replace
from math import nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from probewatch.appliance.core.quality.stationary_time import StationaryTime
from probewatch.appliance.core.quality.verification import Verification
from probewatch.appliance.limits import Limits, RequiredAges
from probewatch.appliance.types import PARAMETERS, Check, Fault, Rival, VerdictKind
from tests.support.motions import TRUTH

S = 1_000_000_000
OK, FAULT, NOT_VERIFIED = VerdictKind.OK, VerdictKind.FAULT, VerdictKind.NOT_VERIFIED
LIMIT = 4.0
REQUIRED = Limits().required_age_s.names


class Rested(StationaryTime):
    """For a given time, and still."""

    def __init__(self, limits: Limits, rested_s: float = 0.0) -> None:
        super().__init__(limits, TRUTH)
        self.rested_s, self.still = rested_s, True

    def since(self, t_ns: int, *, lasting: bool = False) -> int:
        return round(self.rested_s * S) if self.still or not lasting else 0


def verifying(limits: Limits) -> Verification:
    return Verification(limits, Rested(limits))


def check(name: str, value: float = 0.2, sigma: float = 0.1, shown_s: float | None = 5.0) -> Check:
    """Judged at three sigmas."""
    room = 3 * sigma
    verdict = OK if abs(value) + room <= LIMIT else FAULT if abs(value) - room > LIMIT else NOT_VERIFIED
    return Check(
        name, name.split("-", maxsplit=1)[0], value, sigma, "mm", LIMIT, verdict, shown_s and round(shown_s * S)
    )


def weigh(verification: Verification, *checks: Check, since_s: float = 0.0) -> tuple[Check, ...]:
    return verification.weigh(checks, round(since_s * S))


def all_shown(at_s: float = 5.0) -> Verification:
    verification = verifying(Limits())
    weigh(verification, *(check(name, shown_s=at_s) for name in REQUIRED))
    return verification


def test_it_is_verified_once_every_required_parameter_was_shown_and_as_old_as_the_oldest() -> None:
    verification = verifying(Limits())
    for at_s, name in enumerate(REQUIRED, start=2):
        assert verification.status.verified_ns is None
        weigh(verification, check(name, shown_s=at_s))
    assert verification.status.verified_ns == 2 * S


def test_what_is_not_shown_again_keeps_its_age_and_nothing_makes_it_younger_but_motion() -> None:
    verification = all_shown(5.0)
    for _ in range(3):
        (seen,) = weigh(verification, check("polarity", value=nan, sigma=nan, shown_s=None))
        assert (seen.verdict, seen.shown_ns) == (NOT_VERIFIED, 5 * S)
        weigh(verification, *(check(name, shown_s=4.0) for name in REQUIRED))
    assert verification.status.verified_ns == 5 * S


@pytest.mark.parametrize("name", PARAMETERS)
def test_one_measurement_beyond_its_limit_withdraws_the_ok_at_once_whether_or_not_it_is_named(name: str) -> None:
    verification = all_shown()
    unnamed = replace(check(name, value=-28.4, sigma=1.5), verdict=NOT_VERIFIED)
    verification.contradict([unnamed], frozenset(), 6 * S)
    assert verification.status.verified_ns is None
    assert [contradiction.check.name for contradiction in verification.contradictions] == [name]


def test_what_is_beyond_its_limit_but_not_by_its_sigmas_contradicts_nothing() -> None:
    verification = all_shown()
    verification.contradict([check("offset-lateral", value=5.0, sigma=0.5)], frozenset(), 6 * S)
    assert verification.status.verified_ns == 5 * S


def test_what_names_no_parameter_contradicts_nothing() -> None:
    verification = all_shown()
    agreement = Check("motion-agreement", Fault.AGREEMENT, 1.7, 0.0, "1 − r", 0.1, NOT_VERIFIED)
    verification.contradict([agreement], frozenset(), 6 * S)
    assert verification.status.verified_ns == 5 * S


@pytest.mark.parametrize(
    ("name", "breathing_known", "was_shown", "later_motion_only"),
    [
        ("scale-axial", False, False, False),
        ("scale-axial", False, True, True),
        ("scale-axial", True, False, True),
        ("scale-lateral", False, False, True),
    ],
)
def test_a_sign_that_may_be_a_breath_is_answered_by_its_own_motion(
    name: str, breathing_known: bool, was_shown: bool, later_motion_only: bool
) -> None:
    """Its motion, from 6 to 9 s, is measured again with the breathing that was learned meanwhile."""
    verification = verifying(Limits())
    weigh(verification, *[check(name)] * was_shown)
    verification.contradict_over((check(name, value=9.0),), frozenset(), 6 * S, 9 * S, breathing_known)
    assert verification.doubted is (name != "scale-axial")
    (seen,) = weigh(verification, check(name, shown_s=8.0), since_s=6.0)
    assert (seen.verdict is NOT_VERIFIED) is later_motion_only
    (seen,) = weigh(verification, check(name, shown_s=11.0), since_s=9.1)
    assert seen.verdict is OK


@pytest.mark.parametrize("since_s", [0.0, 6.0])
def test_motion_from_before_the_sign_or_with_it_does_not_answer_it(since_s: float) -> None:
    verification = all_shown()
    verification.contradict([check("scale-axial", value=9.0)], frozenset({"scale-axial"}), 6 * S)
    (seen,) = weigh(verification, check("scale-axial", shown_s=8.0), since_s=since_s)
    assert seen.verdict is NOT_VERIFIED
    assert verification.status.verified_ns is None


@pytest.mark.parametrize(("value", "answered"), [(2.8, True), (3.0, False)])
def test_an_ok_after_a_fault_needs_room(value: float, answered: bool) -> None:
    """|value| + 3σ within .8 of the limit, 3.2."""
    verification = all_shown()
    verification.contradict([check("scale-axial", value=9.0)], frozenset({"scale-axial"}), 6 * S)
    again = check("scale-axial", value=value, sigma=0.1, shown_s=8.0)
    assert again.verdict is OK
    (seen,) = weigh(verification, again, since_s=6.1)
    assert (seen.verdict is OK) == answered
    assert (verification.status.verified_ns is not None) == answered


@pytest.mark.parametrize(
    ("value", "sigma", "named", "answered"),
    [(2.0, 1.4, False, True), (2.0, 1.6, False, False), (4.1, 1.0, False, False), (2.0, 1.0, True, False)],
)
def test_a_sign_that_was_never_named_is_answered_by_as_sharp_a_measurement_within_the_limit(
    value: float, sigma: float, named: bool, answered: bool
) -> None:
    verification = all_shown()
    contradiction = check("offset-axial", value=9.0, sigma=1.0)
    verification.contradict([contradiction], frozenset({"offset-axial"} if named else ()), 6 * S)
    weigh(verification, check("offset-axial", value=value, sigma=sigma, shown_s=8.0), since_s=6.1)
    assert (verification.contradictions == ()) == answered


def test_what_answers_a_sign_does_not_bring_back_what_was_shown_before_it() -> None:
    """Within its limit and not shown: nothing speaks against the parameter any more, and nothing for it since."""
    verification = all_shown()
    verification.contradict([check("offset-axial", value=9.0, sigma=1.0)], frozenset(), 6 * S)
    weigh(verification, check("offset-axial", value=2.0, sigma=1.4, shown_s=8.0), since_s=6.1)
    assert verification.contradictions == ()
    assert verification.status.verified_ns is None
    weigh(verification, check("offset-axial", shown_s=9.0), since_s=6.1)
    assert verification.status.verified_ns == 5 * S


def test_a_sign_that_was_named_once_stays_named() -> None:
    verification = all_shown()
    for named in (frozenset({"offset-axial"}), frozenset()):
        verification.contradict([check("offset-axial", value=9.0, sigma=1.0)], named, 6 * S)
    assert verification.contradictions[0].named


def test_a_change_of_geometry_forgets_what_was_shown_and_keeps_the_signs() -> None:
    verification = all_shown()
    verification.contradict([check("scale-axial", value=9.0)], frozenset(), 6 * S)
    verification.restart()
    assert verification.contradictions != ()
    weigh(verification, *(check(name, shown_s=8.0) for name in REQUIRED), since_s=7.0)
    assert verification.status.verified_ns == 8 * S


def test_motion_of_the_future_shows_nothing_and_holds_nothing_up() -> None:
    verification = all_shown(500.0)
    verification.contradict([check("offset-axial", value=9.0)], frozenset(), 500 * S)
    verification.forget(6 * S)
    verification.predate(6 * S)
    assert verification.status.verified_ns is None
    assert verification.last_contradiction_ns == 6 * S - 1


@given(
    st.lists(
        st.tuples(
            st.sampled_from(REQUIRED),
            st.floats(-12, 12),
            st.floats(0.01, 3),
            st.integers(0, 20),
            st.booleans(),
        ),
        max_size=40,
    )
)
def test_verified_means_shown_and_not_contradicted_since(
    events: list[tuple[str, float, float, int, bool]],
) -> None:
    verification = verifying(Limits())
    shown: dict[str, int] = {}
    for now_s, (name, value, sigma, back_s, contradiction) in enumerate(events, start=30):
        seen = check(name, value, sigma, shown_s=now_s)
        if contradiction:
            verification.contradict([seen], frozenset(), now_s * S)
        accepted = weigh(verification, seen, since_s=now_s - back_s)[0]
        if abs(value) - 3 * sigma > LIMIT and contradiction:
            shown.pop(name, None)
        elif accepted.verdict is OK:
            assert abs(value) + 3 * sigma <= LIMIT
            shown[name] = now_s
        if verification.status.verified_ns is not None:
            assert verification.status.verified_ns <= min(shown[one] for one in REQUIRED) * S


def test_an_age_limit_of_its_own_bounds_what_was_shown_and_what_is_not_asked_for_does_not_count() -> None:
    ages = RequiredAges.model_validate(
        dict.fromkeys(REQUIRED) | {"offset-axial": 60.0, "scale-axial": 10.0, "rotation-axial": 0.0}
    )
    verification = verifying(Limits(required_age_s=ages))
    asked = set(ages.names)
    assert asked == {*REQUIRED} - {"rotation-axial"}
    weigh(verification, *(check(name, shown_s=8.0) for name in asked - {"offset-axial"}))
    assert verification.status.verified_ns is None
    weigh(verification, check("offset-axial", shown_s=3.0))
    assert (verification.status.verified_ns, verification.status.expires_ns) == (3 * S, 18 * S)
    weigh(verification, check("scale-axial", shown_s=70.0))
    assert verification.status.expires_ns == 63 * S, "three seconds and a minute"
    verification.contradict([check("rotation-axial", value=20.0)], frozenset(), 71 * S)
    assert verification.status.verified_ns is None, "not asked for, and still a contradiction"


def test_a_rest_extends_every_age_and_that_of_the_latency_only_while_it_lasts() -> None:
    limits = Limits(required_age_s=RequiredAges.model_validate(dict.fromkeys(REQUIRED, 30.0)))
    rest = Rested(limits, rested_s=12.0)
    verification = Verification(limits, rest)
    weigh(verification, *(check(name, shown_s=5.0) for name in REQUIRED))
    assert (verification.status.verified_ns, verification.status.expires_ns) == (5 * S, (5 + 30 + 12) * S)
    rest.still = False
    assert verification.status.expires_ns == (5 + 30) * S
    assert {name: verification.rested_ns(name) for name in REQUIRED} == dict.fromkeys(REQUIRED, 12 * S) | {"latency": 0}
    verification.restart()
    assert {verification.rested_ns(name) for name in REQUIRED} == {0}, "nothing is shown that could count for longer"


def test_everything_is_asked_for_by_default_and_the_offsets_count_for_longer() -> None:
    assert {*REQUIRED} == {"polarity", "latency", *PARAMETERS}
    verification = verifying(Limits())
    weigh(verification, *(check(name, shown_s=5.0) for name in REQUIRED if not name.startswith("offset")))
    assert verification.status.verified_ns is None
    weigh(verification, *(check(name, shown_s=1.0) for name in REQUIRED if name.startswith("offset")))
    assert verification.status.expires_ns == 35 * S
    weigh(verification, *(check(name, shown_s=500.0) for name in REQUIRED if not name.startswith("offset")))
    assert (verification.status.verified_ns, verification.status.expires_ns) == (S, 121 * S)


def test_an_accusation_withdraws_the_ok_whatever_its_own_sigma() -> None:
    verification = all_shown()
    blunt = check("offset-axial", 6.0, 5.0)
    verification.contradict([blunt], frozenset(), 6 * S)
    assert verification.status.verified_ns is not None, "by its sigma it says nothing"
    verification.accuse([blunt], frozenset(), 6 * S)
    assert verification.status.verified_ns is None


def test_rivals_stand_until_one_of_them_is_answered_or_named() -> None:
    two = check("offset-axial", 6.0, 5.0), check("scale-lateral", 6.0, 5.0)
    rivals = tuple(Rival(one, behind) for one, behind in zip(two, (0.0, 1.0), strict=True))
    for answer, named in ((check("offset-axial"), frozenset[str]()), (two[1], frozenset({"scale-lateral"}))):
        verification = all_shown()
        verification.accuse(two, frozenset(), 6 * S, rivals)
        assert verification.status.rivals == rivals
        if named:
            verification.contradict([check("scale-lateral", 20.0)], named, 7 * S)
        else:
            weigh(verification, answer, since_s=7.0)
        assert verification.status.rivals == ()
