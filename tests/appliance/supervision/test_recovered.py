"""The policy and the proposals mean the same by what motion recovers."""

import pytest

from probewatch.appliance.core.detectors.marker_slip import MarkerSlip
from probewatch.appliance.core.parameters import MEASURED, class_of
from probewatch.appliance.core.quality.proposal import Step, propose
from probewatch.appliance.limits import Limits
from probewatch.appliance.supervision.alarms import HAZARDS
from probewatch.appliance.types import Check, State, VerdictKind
from tests.support.motions import TRUTH

REQUESTS = {
    fault: step for fault, row in HAZARDS.items() if (step := row.policy.step_to(State.RECALIBRATION_REQUESTED))
}


@pytest.mark.parametrize("name", MEASURED)
def test_a_recalibration_is_requested_where_the_proposal_is_one(name: str) -> None:
    fault = class_of(name)
    proposal = propose([Check(name, fault, 9.0, 0.1, "", 3.0, VerdictKind.FAULT)], TRUTH, 50.0)
    assert proposal is not None
    requested = fault in REQUESTS and REQUESTS[fault].led_by(name)
    assert requested is (Step.RECALIBRATE in proposal.steps)


def test_the_checks_that_lead_there_are_checks_of_the_line() -> None:
    slip = {check.name for check in MarkerSlip(Limits(), TRUTH).checks()}
    assert {name for step in REQUESTS.values() for name in step.by} <= {*MEASURED, *slip}


def test_what_is_done_instead_is_told_where_a_recalibration_is_requested_and_nowhere_else() -> None:
    assert {fault for fault, hazard in HAZARDS.items() if hazard.requested} == {*REQUESTS}
