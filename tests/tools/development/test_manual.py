"""The manual says what the code does."""

import re
from dataclasses import fields
from pathlib import Path

from appliance.service.control.requests import Hands, Requests
from appliance.service.control.status import alarm_fields, check_lists
from appliance.supervision.alarms import HAZARDS
from appliance.supervision.supervisor import AlarmTable
from appliance.types import AlarmState, Kind, State
from tools.development.hazards import CONTROLS, PAGE, hazards
from tools.development.manual import MANUAL, manual

DOCS = Path(__file__).parents[3] / "docs"


def test_the_page_on_alarms_is_the_one_the_code_writes() -> None:
    assert MANUAL.read_text(encoding="utf-8") == manual(), "run make docs"


def test_the_page_on_hazards_is_the_one_the_code_writes() -> None:
    assert PAGE.read_text(encoding="utf-8") == hazards(), "run make docs"


def test_every_hazard_is_found_somewhere_and_tried_by_a_test() -> None:
    rows = [line.split(" | ") for line in hazards().splitlines() if line.startswith("| `")]
    assert [row[0].split("`")[1] for row in rows] == [*HAZARDS]
    for name, finder, control, tests in rows:
        assert "`appliance/" in finder, f"nothing finds {name}"
        assert "contact" in control
        assert "`tests/" in tests, f"no test names {name}"
    assert {*CONTROLS} == {*Kind}


def test_the_page_shows_every_transition() -> None:
    rows = sum(len(state.transitions) for state in AlarmTable.states)
    assert len(re.findall(r"^\| .* \| (tick|\w+) \| .* \| .* \|$", manual().split("## Guards")[0], re.M)) - 1 == rows


def test_the_page_on_the_control_socket_lists_every_request_and_every_field_of_the_status() -> None:
    text = (DOCS / "control.md").read_text(encoding="utf-8")
    requests, status = text.split("## Status")
    hands = Hands(**{one.name: None for one in fields(Hands)})  # type: ignore[arg-type]
    assert set(re.findall(r"^\| `([a-z-]+)` \|", requests, re.M)) == set(Requests(hands).names)
    alarm = AlarmState(State.MONITORING, 0, None, "", True, None)
    known = alarm_fields(0, alarm, "en").keys() | check_lists(0, None, ()).keys()
    assert known <= set(re.findall(r"^\| `([a-z_]+)` \|", status, re.M))
