"""What motion showed is noted while it is verified, and not more often than it is worth."""

from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from probewatch.appliance.service.control.estimate_notes import EstimateNotes
from probewatch.appliance.service.control.event_log import EventLog
from probewatch.appliance.service.host.recorder import Recorder
from probewatch.appliance.storage.alarm_chain import Event, read_log
from probewatch.appliance.storage.reference import Reference
from probewatch.appliance.types import AlarmState, Check, Fault, State, Verdict, VerdictKind
from probewatch.drivers.clock.host_clock import HostClock
from tests.support.polling import until
from tests.support.stores import first_reference, log

__all__ = ["log"]
pytestmark = pytest.mark.usefixtures("log")
S = 1_000_000_000


def verdict(shown_s: float = 20.0, value: float = 0.51234567) -> Verdict:
    """Of what motion showed at that time."""
    return Verdict(
        0,
        VerdictKind.OK,
        (
            Check("scale-axial", Fault.SCALE, value, 0.5, "%", 5.0, VerdictKind.OK, round(shown_s * S)),
            Check("offset-axial", Fault.OFFSET, nan, 2.0, "mm", 4.0, VerdictKind.NOT_VERIFIED),
            Check("no-picture", Fault.NO_PICTURE, 0.0, 0.0, "ms", 500.0, VerdictKind.OK),
        ),
    )


VERDICT = verdict()


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
    assert found == [{"reference": 1, "checks": {"scale-axial": [0.5123, 0.5, 5.0]}, "windows": {"scale-axial": 1}}]


def test_one_entry_in_five_minutes_after_half_a_minute_of_the_contact_closed(
    tmp_path: Path, reference: Reference
) -> None:
    every_tick = [(k / 2, alarm(), verdict(k / 2 - 15)) for k in range(2 * 700)]
    assert len(noted(tmp_path / "a", reference, *every_tick)) == 3
    assert noted(tmp_path / "b", reference, (29.9, alarm(), VERDICT)) == []
    broken = ((30.0, alarm(), verdict(15.0)), (400.0, alarm(since_s=390.0), verdict(395.0)))
    assert len(noted(tmp_path / "c", reference, *broken)) == 1


@pytest.mark.parametrize("state", [state for state in State if state is not State.MONITORING])
def test_nothing_is_noted_of_what_is_not_verified(tmp_path: Path, reference: Reference, state: State) -> None:
    assert noted(tmp_path, reference, (100.0, alarm(state), VERDICT)) == []


def test_nothing_is_noted_without_a_verdict_or_a_reference(tmp_path: Path, reference: Reference) -> None:
    assert noted(tmp_path / "a", reference, (100.0, alarm(), None)) == []
    assert noted(tmp_path / "b", None, (100.0, alarm(), VERDICT)) == []


def test_windows_that_share_no_motion_are_averaged(tmp_path: Path, reference: Reference) -> None:
    """Ten in five minutes, of which the first entry has one."""
    ticks = [(k / 2, alarm(), verdict(k / 2 - 15, value=k / 2 / 100)) for k in range(60, 2 * 331)]
    first, second = noted(tmp_path, reference, *ticks)
    assert (first["windows"], second["windows"]) == ({"scale-axial": 1}, {"scale-axial": 10})
    value, sigma, _ = second["checks"]["scale-axial"]
    assert value == pytest.approx(np.mean([0.3 + 0.3 * k for k in range(1, 11)]), abs=1e-3)
    assert 0.3 < sigma < 0.5


def test_what_was_shown_once_is_noted_once(tmp_path: Path, reference: Reference) -> None:
    rests = [(float(now_s), alarm(), verdict(20.0)) for now_s in range(30, 1000)]
    assert len(noted(tmp_path, reference, *rests)) == 1


@pytest.mark.parametrize("state", [state for state in State if state is not State.MONITORING])
def test_nothing_is_averaged_across_what_may_have_changed_the_calibration(
    tmp_path: Path, reference: Reference, state: State
) -> None:
    """Across motion that was not verified it is: lifting the probe changes nothing."""
    steps = [(30.0, alarm(), verdict(15.0)), (61.0, alarm(), verdict(46.0, 1.0)), (92.0, alarm(state, 91.0), VERDICT)]
    steps += [(340.0, alarm(since_s=300.0), verdict(325.0, 2.0))]
    value = noted(tmp_path, reference, *steps)[1]["checks"]["scale-axial"][0]
    assert value == (1.5 if state is State.NOT_VERIFIED else 2.0)
