"""Another probe than the calibration's: body and picture are wrong at once, and the latency is not to blame."""

from collections.abc import Mapping
from math import nan

import pytest

from probewatch.appliance.core.detectors.exchanged_probe import ExchangedProbe
from probewatch.appliance.core.parameters import CLASSES, MEASURED, QUANTITIES
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Check, Fault, VerdictKind

LIMITS = Limits()
EXCHANGED = {"rotation-axial": -20.0, "offset-elevational": 15.0, "scale-lateral": -20.0}


def finding(values: Mapping[str, float], late: VerdictKind = VerdictKind.OK, limits: Limits = LIMITS) -> list[Check]:
    """Of a window that measures each parameter with a sigma of a tenth of its limit, and these to be so."""
    checks = []
    for name, fault in zip(MEASURED, CLASSES, strict=True):
        quantity = QUANTITIES[fault]
        limit = quantity.limit(limits)
        value = values.get(name, 0.0)
        kind = late if name == "latency" else VerdictKind.NOT_VERIFIED
        checks.append(Check(name, fault, value, limit / 10, quantity.unit, limit, kind))
    return checks


def told(*found: list[Check]) -> list[bool]:
    """Whether it is named after each."""
    latest: list[list[Check]] = [[]]
    said = []
    detector = ExchangedProbe(lambda: latest[0], LIMITS.confidence_sigma)
    for one in found:
        latest[0] = one
        detector.on_verified(lambda fault: False, 0)
        said.append(bool(detector.checks()))
    return said


def test_body_and_picture_that_are_far_off_are_another_probe_at_once() -> None:
    latest = finding(EXCHANGED)
    detector = ExchangedProbe(lambda: latest, LIMITS.confidence_sigma)
    assert detector.checks() == ()
    detector.on_verified(lambda fault: False, 0)
    (check,) = detector.checks()
    assert (check.fault, check.verdict, check.limit) == (Fault.EXCHANGED_PROBE, VerdictKind.FAULT, 1.0)
    assert check.value == pytest.approx(15 / 4 - 0.3)


def test_just_beyond_the_limits_it_takes_two_findings_in_a_row() -> None:
    near = finding({"rotation-lateral": 5.0, "offset-axial": -6.0, "scale-axial": 8.0})
    assert told(near) == [False]
    assert told(near, near) == [False, True]
    assert told(near, finding({}), near) == [False, False, False]


def test_what_tighter_limits_call_wrong_is_no_other_probe_yet() -> None:
    fine = Limits(profile="fine")
    bent = finding({"rotation-axial": -2.5, "offset-elevational": 3.5, "scale-lateral": -4.5}, limits=fine)
    assert all(check.ratio > 2 for check in bent if check.name in ("rotation-axial", "scale-lateral"))
    assert told(bent, bent) == [False, False]
    exchanged = finding(EXCHANGED, limits=fine)
    assert told(exchanged) == [True]


@pytest.mark.parametrize("left_out", EXCHANGED)
def test_two_classes_alone_are_two_faults(left_out: str) -> None:
    two = finding({name: value for name, value in EXCHANGED.items() if name != left_out})
    assert told(two, two, two) == [False, False, False]


@pytest.mark.parametrize("late", [VerdictKind.NOT_VERIFIED, VerdictKind.FAULT])
def test_beside_a_latency_that_is_not_shown_nothing_is_another_probe(late: VerdictKind) -> None:
    assert told(*[finding(EXCHANGED, late)] * 3) == [False, False, False]


def test_what_was_not_measured_is_not_beyond_anything() -> None:
    nothing = finding(dict.fromkeys(EXCHANGED, nan))
    assert told([], nothing, nothing) == [False, False, False]
    assert told(finding(EXCHANGED), nothing) == [True, True], "what is named stands until a class is shown"


@pytest.mark.parametrize("shown", [Fault.ROTATION, Fault.OFFSET, Fault.SCALE])
def test_it_is_withdrawn_as_soon_as_any_of_its_classes_is_shown_to_be_in_order(shown: Fault) -> None:
    latest = finding(EXCHANGED)
    detector = ExchangedProbe(lambda: latest, LIMITS.confidence_sigma)
    detector.on_verified(lambda fault: False, 0)
    detector.on_verified(lambda fault: fault is Fault.POLARITY, 0)
    assert detector.checks()
    detector.on_verified(lambda fault: fault is shown, 0)
    assert detector.checks() == ()
