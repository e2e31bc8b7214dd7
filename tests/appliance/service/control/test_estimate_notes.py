"""What motion showed is noted while it is verified, and not more often than it is worth."""

from math import nan
from pathlib import Path
from typing import Any

import pytest

from appliance.service.control.estimate_notes import EstimateNotes
from appliance.service.control.event_log import EventLog
from appliance.service.host.recorder import Recorder
from appliance.storage.alarm_chain import Event, read_log
from appliance.storage.reference import Reference
from appliance.types import AlarmState, Check, Fault, State, Verdict, VerdictKind
from drivers.clock.host_clock import HostClock
from tests.support.polling import until
from tests.support.stores import first_reference, log

__all__ = ["log"]
pytestmark = pytest.mark.usefixtures("log")
S = 1_000_000_000
CHECKS = (
    Check("scale-axial", Fault.SCALE, 0.51234567, 0.3, "%", 5.0, VerdictKind.OK, 1),
    Check("offset-axial", Fault.OFFSET, nan, 2.0, "mm", 4.0, VerdictKind.NOT_VERIFIED),
    Check("no-picture", Fault.NO_PICTURE, 0.0, 0.0, "ms", 500.0, VerdictKind.OK),
)
VERDICT = Verdict(0, VerdictKind.OK, CHECKS)


def alarm(state: State = State.MONITORING, since_s: float = 0.0) -> AlarmState:
    return AlarmState(state, round(since_s * S), None, "", state is State.MONITORING, 0)


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Reference:
    """The first of a new cart."""
    return first_reference(tmp_path_factory.mktemp("store"))


Step = tuple[float, AlarmState, Verdict | None]


def noted(folder: Path, reference: Reference | None, *steps: Step) -> list[dict[str, Any]]:
    """What the alarm log holds after these ticks."""
    recorder = Recorder(folder, HostClock())
    estimates = EstimateNotes(EventLog(recorder, ()))
    for now_s, state, verdict in steps:
        estimates.step(round(now_s * S), state, verdict, reference)
    until(lambda: recorder.waiting == 0)
    recorder.close()
    return [entry.data for entry in read_log(folder).entries if entry.event == Event.ESTIMATE]


def test_an_entry_has_the_parameters_that_have_a_value_and_the_reference(tmp_path: Path, reference: Reference) -> None:
    found = noted(tmp_path, reference, (30.0, alarm(), VERDICT))
    assert found == [{"reference": 1, "checks": {"scale-axial": [0.5123, 0.3, 5.0]}}]


def test_one_entry_in_five_minutes_after_half_a_minute_of_the_contact_closed(
    tmp_path: Path, reference: Reference
) -> None:
    every_tick = [(k / 2, alarm(), VERDICT) for k in range(2 * 700)]
    assert len(noted(tmp_path / "a", reference, *every_tick)) == 3
    assert noted(tmp_path / "b", reference, (29.9, alarm(), VERDICT)) == []
    broken = ((30.0, alarm(), VERDICT), (400.0, alarm(since_s=390.0), VERDICT))
    assert len(noted(tmp_path / "c", reference, *broken)) == 1


@pytest.mark.parametrize("state", [state for state in State if state is not State.MONITORING])
def test_nothing_is_noted_of_what_is_not_verified(tmp_path: Path, reference: Reference, state: State) -> None:
    assert noted(tmp_path, reference, (100.0, alarm(state), VERDICT)) == []


def test_nothing_is_noted_without_a_verdict_or_a_reference(tmp_path: Path, reference: Reference) -> None:
    assert noted(tmp_path / "a", reference, (100.0, alarm(), None)) == []
    assert noted(tmp_path / "b", None, (100.0, alarm(), VERDICT)) == []
