"""A proposal waits for whoever comes to the cart, until the calibration is verified or replaced; it is noted once."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from probewatch.appliance.service.control.event_log import EventLog
from probewatch.appliance.service.control.proposals import Proposals
from probewatch.appliance.service.host.recorder import Recorder
from probewatch.appliance.storage.alarm_chain import Event, read_log
from probewatch.appliance.storage.reference import Reference
from probewatch.appliance.types import AlarmState, Check, Fault, Rival, State, Verdict, VerdictKind
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.tools.shared.recovered import recovered
from tests.support.polling import until
from tests.support.stores import first_reference, log

__all__ = ["log"]
pytestmark = pytest.mark.usefixtures("log")
FAULT, NOT_VERIFIED = VerdictKind.FAULT, VerdictKind.NOT_VERIFIED
TURNED = Check("rotation-axial", Fault.ROTATION, 8.0, 0.4, "deg", 3.0, FAULT)
SCALED = Check("scale-axial", Fault.SCALE, 8.0, 0.4, "%", 5.0, FAULT)
BENT = Verdict(0, FAULT, (TURNED,), Fault.ROTATION)
NOTHING = Verdict(1, NOT_VERIFIED, ())
CHOICE = Verdict(2, NOT_VERIFIED, (), reason="which", rivals=(Rival(SCALED, 0.0), Rival(TURNED, 2.0)))


def alarm(state: State) -> AlarmState:
    return AlarmState(state, 0, None, "", state is State.MONITORING, 0)


HALT, SAFE = alarm(State.HALT), alarm(State.MONITORING)


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Reference:
    return first_reference(tmp_path_factory.mktemp("store"))


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Recorder]:
    recorder = Recorder(tmp_path, HostClock())
    yield recorder
    recorder.close()


def noted(recorder: Recorder, folder: Path) -> list[tuple[str, dict[str, Any]]]:
    until(lambda: recorder.waiting == 0)
    return [
        (entry.event, entry.data)
        for entry in read_log(folder).entries
        if entry.event in (Event.PROPOSAL, Event.UNDECIDED)
    ]


def test_it_stays_while_the_probe_is_laid_aside_and_goes_with_the_next_verification(
    recorder: Recorder, tmp_path: Path, reference: Reference
) -> None:
    proposals = Proposals(EventLog(recorder, ()))
    assert proposals.fields("en") is None
    for state, verdict in ((HALT, BENT), (HALT, NOTHING), (HALT, None), (HALT, BENT)):
        proposals.step(state, verdict, reference, 0.0)
        fields = proposals.fields("en")
        assert fields is not None
        assert fields["values"] == [{"name": "rotation-axial", "was": 0.0, "now": 8.0, "sigma": 0.4, "unit": "deg"}]
        assert fields["steps"] == ["take-x"]
    assert [event for event, _ in noted(recorder, tmp_path)] == ["proposal"]
    german = proposals.fields("de")
    assert german is not None
    assert german["text"].startswith("Drehung axial ist jetzt 8.0 ± 0.4 Grad")
    proposals.step(SAFE, NOTHING, reference, 0.0)
    assert proposals.fields("en") is None


def test_another_reference_ends_it(recorder: Recorder, reference: Reference) -> None:
    proposals = Proposals(EventLog(recorder, ()))
    proposals.step(HALT, BENT, reference, 0.0)
    proposals.step(HALT, BENT, None, 0.0)
    assert proposals.fields("en") is None


def test_a_choice_is_noted_once(recorder: Recorder, tmp_path: Path, reference: Reference) -> None:
    proposals = Proposals(EventLog(recorder, ()))
    for _ in range(3):
        proposals.step(HALT, CHOICE, reference, 0.0)
        proposals.step(HALT, NOTHING, reference, 0.0)
    assert noted(recorder, tmp_path) == [("undecided", {"text": "which", "names": ["rotation-axial", "scale-axial"]})]


def test_what_is_written_down_is_the_reference_turned(recorder: Recorder, reference: Reference) -> None:
    proposals = Proposals(EventLog(recorder, ()))
    proposals.step(HALT, BENT, reference, 0.0)
    before = reference.calibration
    size, polarity = list(before.image_size_px), list(before.polarity)
    status = {
        "proposal": proposals.fields("en"),
        "reference": {"image_size_px": size, "polarity": polarity, "simulated": False},
        "simulated": ["sim:/run/x"],
    }
    found = recovered(status)
    angle = (found.rotation @ before.rotation.T)[0, 0]
    assert angle == pytest.approx(0.9903, abs=1e-4), "cos 8°"
    assert found.simulated, "no real cart may take it"
    assert found.offset_mm == pytest.approx(before.offset_mm)
