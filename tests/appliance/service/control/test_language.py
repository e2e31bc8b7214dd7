"""The description of the field `language` names the fields of the status that are translated."""

import re

from probewatch.appliance.core.quality.gesture import Gesture
from probewatch.appliance.service.control.status import alarm_fields
from probewatch.appliance.service.control.status_fields import STATUS
from probewatch.appliance.supervision.alarms import HAZARDS
from probewatch.appliance.types import AlarmState, State


def test_the_field_of_the_language_names_all_that_is_in_it() -> None:
    alarm = AlarmState(State.NOT_VERIFIED, 0, None, "reason", False, None, notices=tuple(HAZARDS)[:1])
    english, german = (alarm_fields(0, alarm, language, wanted=(Gesture.PRESS,)) for language in ("en", "de"))
    unlike = {name for name in english if english[name] != german[name]}
    (row,) = (field for field in STATUS if field.name == "language")
    assert unlike == set(re.findall(r"`(\w+)`", row.meaning)) - {"proposal"}
