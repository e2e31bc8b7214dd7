"""The policy is whole, and the supervisor does what it says: each step at its time, each ending, and nothing else."""

from dataclasses import fields

import pytest

from probewatch.appliance.supervision.alarms import HAZARDS, SIGNALS
from probewatch.appliance.supervision.annunciator import Annunciator, Role
from probewatch.appliance.supervision.audio import Audio, pulses
from probewatch.appliance.supervision.faults import FAULT_ROWS
from probewatch.appliance.supervision.policy import ADVISORY, Durations, Ending, Policy
from probewatch.appliance.supervision.supervisor import Inputs, Request
from probewatch.appliance.types import Check, Fault, Kind, State, Verdict, VerdictKind
from tests.support.supervised import DURATIONS, TICK_NS, Room, room_in

S_NS = 1_000_000_000
OTHERS = Durations(
    gross_halt_after_ns=500_000_000,
    halt_after_ns=1_500_000_000,
    recalibrate_after_ns=700_000_000,
    device_lost_after_ns=2_200_000_000,
    probation_ns=400_000_000,
)
LONGER_NS = 4 * S_NS
"""Than any hazard takes to its last step."""

POLICY = {fault: row.policy for fault, row in FAULT_ROWS.items()}
ONE_OF_EACH = {(row, fault.kind): fault for fault, row in POLICY.items() if fault in HAZARDS}.values()
"""A hazard of each row."""
BY_CHECK = [(fault, name) for fault, row in POLICY.items() for step in row.steps for name in step.by]
"""Hazards with the checks of theirs that lead further than the others."""


def shown(t_ns: int, fault: Fault, check: str = "") -> Inputs:
    """A hazard as it is told: by the line where it is about the calibration, by a watcher else, while the line rests on
    what it has shown. check: by which check of the line; "" by one that has no step of its own.
    """
    if fault.kind is Kind.CALIBRATION:
        failing = Check(check or "some", fault, 2.0, 0.0, "", 1.0, VerdictKind.FAULT)
        return Inputs((Verdict(t_ns, VerdictKind.FAULT, (failing,), fault, "seen"),))
    told = VerdictKind.NOT_VERIFIED if fault.kind is Kind.SIGHT else VerdictKind.FAULT
    resting = Verdict(t_ns, VerdictKind.NOT_VERIFIED, (), verified_ns=t_ns)
    return Inputs((resting,), (Check("watcher", fault, 2.0, 0.0, "", 1.0, told),))


def keep_showing(room: Room, fault: Fault, for_ns: int = LONGER_NS, check: str = "") -> list[tuple[State, int]]:
    """(state, ns since the hazard was first shown) of each state that is entered."""
    before, changes = room.supervisor.state, []
    for since_ns in range(0, for_ns, TICK_NS):
        state = room.at(TICK_NS, shown(room.now_ns + TICK_NS, fault, check))
        changes += [(state, since_ns)] if state is not before else []
        before = state
    return changes


def gone(room: Room, for_ns: int = LONGER_NS) -> list[tuple[State, int]]:
    """The same after it is gone, while the line says OK."""
    before, changes = room.supervisor.state, []
    for since_ns in range(0, for_ns, TICK_NS):
        state = room.ok()
        changes += [(state, since_ns)] if state is not before else []
        before = state
    return changes


def monitoring(durations: Durations) -> Room:
    room = room_in(State.MONITORING)
    room.supervisor.retime(durations)
    return room


def test_every_duration_that_a_row_names_is_one_of_the_configuration() -> None:
    named = {name for row in POLICY.values() for step in (*row.steps, row.scan) if step for name in step.after}
    assert {f"{name}_ns" for name in named} <= {one.name for one in fields(Durations)}


@pytest.mark.parametrize("durations", [DURATIONS, OTHERS], ids=["shipped", "others"])
@pytest.mark.parametrize(("fault", "check"), [*((fault, "") for fault in HAZARDS), *BY_CHECK])
def test_the_supervisor_takes_each_step_at_its_time_and_no_other(
    fault: Fault, check: str, durations: Durations
) -> None:
    steps = [(step.state, step.after_ns(durations)) for step in POLICY[fault].steps if not step.by or check in step.by]
    assert keep_showing(monitoring(durations), fault, check=check) == steps


@pytest.mark.parametrize(
    ("fault", "check", "last"),
    [
        (Fault.POLARITY, "polarity", State.HALT),
        (Fault.SCALE, "scale-axial", State.RECALIBRATION_REQUESTED),
        (Fault.SCALE, "depth-ruler", State.RECALIBRATION_REQUESTED),
        (Fault.SCALE, "fan-shift", State.RECALIBRATION_REQUESTED),
        (Fault.ROTATION, "rotation-axial", State.HALT),
        (Fault.OFFSET, "offset-lateral", State.HALT),
        (Fault.OFFSET, "offset-axial", State.HALT),
        (Fault.OFFSET, "offset-elevational", State.RECALIBRATION_REQUESTED),
        (Fault.OFFSET, "marker-shift", State.HALT),
        (Fault.OFFSET, "marker-elevational", State.RECALIBRATION_REQUESTED),
        (Fault.LATENCY, "latency", State.HALT),
        (Fault.POSE_CONVENTION, "axes-swapped", State.HALT),
        (Fault.EXCHANGED_PROBE, "exchanged-probe", State.RECALIBRATION_REQUESTED),
        (Fault.UNDECIDED, "undecided", State.HALT),
        (Fault.MARKER_BODY_MOVED, "witness-turn", State.HALT),
    ],
)
def test_a_recalibration_is_requested_for_what_motion_does_not_recover_alone(
    fault: Fault, check: str, last: State
) -> None:
    assert keep_showing(monitoring(DURATIONS), fault, check=check)[-1][0] is last


@pytest.mark.parametrize("fault", [fault for fault in HAZARDS if fault.kind is not Kind.SIGHT])
def test_during_a_scan_the_row_says_what_ends_it(fault: Fault) -> None:
    scan = POLICY[fault].scan
    expected = [] if scan is None else [(scan.state, scan.after_ns(OTHERS))]
    room = room_in(State.RECALIBRATING)
    room.supervisor.retime(OTHERS)
    assert keep_showing(room, fault) == expected


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("fault", ONE_OF_EACH)
def test_from_no_state_does_a_hazard_lead_beyond_its_row(fault: Fault, state: State) -> None:
    """Beside it the contact only opens: what was left as it ended, or never began, is not verified."""
    row, room = POLICY[fault], room_in(state)
    before = room.now_ns
    entered = {one for one, _ in keep_showing(room, fault)}
    own = {step.state for step in (*row.steps, row.scan) if step is not None}
    assert entered <= own | {State.WAITING, State.NOT_VERIFIED} | ({State.MONITORING} if row is ADVISORY else set())
    assert not row.steps or not room.alarm.energised
    assert room.now_ns == before + LONGER_NS


@pytest.mark.parametrize("durations", [DURATIONS, OTHERS], ids=["shipped", "others"])
@pytest.mark.parametrize("fault", ONE_OF_EACH)
def test_what_ends_a_hazard_is_what_its_row_says(fault: Fault, durations: Durations) -> None:
    room = monitoring(durations)
    keep_showing(room, fault)
    last, ending = room.supervisor.state, POLICY[fault].ending
    after = [state for state, _ in gone(room)]
    if ending in (Ending.VERIFIED, Ending.ACKNOWLEDGED):
        assert after == []
        room.ask(Request.ACKNOWLEDGE)
        after = [state for state, _ in gone(room)]
    assert after[-1:] == ([] if ending is Ending.NONE else [State.MONITORING])
    own = [step.state for step in POLICY[fault].steps if not step.by]
    assert last is (own[-1] if own else State.MONITORING)


@pytest.mark.parametrize(
    "fault", [fault for fault, row in POLICY.items() if row.ending in (Ending.VERIFIED, Ending.BACK)]
)
def test_what_is_not_latched_is_left_after_probation(fault: Fault) -> None:
    room = monitoring(OTHERS)
    keep_showing(room, fault, TICK_NS)
    assert gone(room)[0][1] == OTHERS.probation_ns


def test_only_what_is_tested_holds_the_self_test() -> None:
    for fault in HAZARDS:
        room = Room()
        assert (room.step(shown(room.now_ns, fault)) is not State.WAITING) == POLICY[fault].tested, fault


def sounded(fault: Fault) -> bool:
    """Whether the tone was driven at any time while the hazard was shown and after it."""
    room, annunciator, silent = room_in(State.MONITORING), Annunciator(), True
    for k in range(200):
        t_ns = room.now_ns + TICK_NS
        sound = Verdict(t_ns, VerdictKind.OK, (), verified_ns=t_ns)
        room.at(TICK_NS, shown(t_ns, fault) if k < 60 else Inputs((sound,)))
        silent &= annunciator.step(room.now_ns, room.alarm)[Role.TONE]
    return not silent


def test_a_pause_by_the_user_opens_the_contact_without_a_tone_and_ends_with_the_first_verification() -> None:
    assert not sounded(Fault.USER_FREEZE)
    assert sounded(Fault.NO_PICTURE)
    room = room_in(State.MONITORING)
    keep_showing(room, Fault.USER_FREEZE)
    assert (room.alarm.fault, room.alarm.energised) == (Fault.USER_FREEZE, False)
    assert room.ok() is State.MONITORING


def test_a_silent_row_is_silent_in_its_own_states_alone() -> None:
    for state in State:
        for fault, row in POLICY.items():
            own = state in {step.state for step in row.steps}
            assert pulses(state, fault) == (0 if row.silent and own else SIGNALS[state].pulses)
        assert pulses(state, None) == SIGNALS[state].pulses
    assert [fault for fault, row in POLICY.items() if row.silent] == [Fault.USER_FREEZE]


def test_a_row_without_steps_leads_nowhere() -> None:
    assert all(Policy((), Ending.NONE).step_to(state) is None for state in State)


def test_a_sound_is_silenced_by_a_pause_or_switched_off_and_by_nothing_else() -> None:
    paused, off = Audio(), Audio()
    assert not paused.silenced
    paused.pause(0, S_NS)
    assert paused.silenced
    paused.on()
    assert not paused.silenced
    off.off("theatre recording")
    assert off.silenced
