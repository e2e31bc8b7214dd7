"""The description of the field `language` names the fields of the status that are translated."""

import re

import pytest

from probewatch.appliance.core.quality.gesture import Gesture
from probewatch.appliance.service.control.status import alarm_fields
from probewatch.appliance.service.control.status_fields import STATUS
from probewatch.appliance.supervision.alarms import HAZARDS
from probewatch.appliance.types import AlarmState, Fault, State


def test_the_field_of_the_language_names_all_that_is_in_it() -> None:
    alarm = AlarmState(State.NOT_VERIFIED, 0, None, "reason", False, None, notices=tuple(HAZARDS)[:1])
    english, german = (alarm_fields(0, alarm, language, wanted=(Gesture.PRESS,)) for language in ("en", "de"))
    unlike = {name for name in english if english[name] != german[name]}
    (row,) = (field for field in STATUS if field.name == "language")
    assert unlike == set(re.findall(r"`(\w+)`", row.meaning)) - {"proposal"}


@pytest.mark.parametrize(("beyond_url", "names_the_url"), [(False, True), (True, False)])
@pytest.mark.parametrize("language", ["en", "de"])
def test_no_latency_is_to_be_set_that_the_url_cannot_state(
    language: str, beyond_url: bool, names_the_url: bool
) -> None:
    for state in (State.WARNING, State.HALT):
        alarm = AlarmState(state, 0, Fault.LATENCY, "reason", False, None)
        told = alarm_fields(0, alarm, language, beyond_url=beyond_url)["remedy"]
        assert ("latency_ms" in told) == names_the_url
