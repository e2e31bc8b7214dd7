"""How often each hazard was alarmed, as the supervisor's states follow one another."""

from dataclasses import replace
from unittest.mock import Mock

import pytest

from probewatch.appliance.service.control.supervision import Supervision
from probewatch.appliance.types import AlarmState, Fault, State


def alarm(fault: Fault | None, *notices: Fault, state: State = State.WARNING) -> AlarmState:
    return AlarmState(state, 0, fault, "", False, None, notices=notices)


@pytest.mark.parametrize(
    ("seen", "counted"),
    [
        ([alarm(None), alarm(None)], {}),
        ([alarm(Fault.SCALE)], {Fault.SCALE: 1}),
        ([alarm(Fault.SCALE), alarm(Fault.SCALE, state=State.HALT)], {Fault.SCALE: 1}),
        ([alarm(Fault.SCALE), alarm(None), alarm(Fault.SCALE)], {Fault.SCALE: 2}),
        ([alarm(Fault.SCALE), alarm(Fault.OFFSET)], {Fault.SCALE: 1, Fault.OFFSET: 1}),
        ([alarm(None, Fault.OVERLOADED)] * 3, {Fault.OVERLOADED: 1}),
        ([alarm(None), alarm(Fault.SCALE, Fault.OVERLOADED)], {Fault.SCALE: 1, Fault.OVERLOADED: 1}),
    ],
)
def test_a_hazard_counts_once_for_as_long_as_it_lasts(seen: list[AlarmState], counted: dict[Fault, int]) -> None:
    supervision = Supervision(None, None, None, None, 0)  # type: ignore[arg-type]  counting needs none of them
    for before, after in zip([None, *seen], seen, strict=False):
        supervision._count(before, after)
    assert supervision.alarms == counted


def test_the_log_says_once_that_the_limit_of_a_point_alone_withholds_the_ok() -> None:
    limited = "error of a point 3.1 mm, limit 2.5 mm"
    reasons = ["not shown yet: scale-axial", limited, "not shown yet: scale-axial", limited]
    alarms = [replace(alarm(None, state=State.NOT_VERIFIED), reason=reason) for reason in reasons]
    entries = Mock()
    supervision = Supervision(Mock(step=Mock(side_effect=alarms)), entries, Mock(), Mock(), 0)
    for tick in range(len(alarms)):
        supervision.step(tick, (), ())
    assert [call.args[1].reason for call in entries.state.call_args_list] == reasons[:2]
