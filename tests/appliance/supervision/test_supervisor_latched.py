"""Halt and requested recalibration: what keeps them, across a restart too, and what ends them."""

import pytest

from probewatch.appliance.supervision.alarms import operator_text
from probewatch.appliance.supervision.supervisor import Inputs, Request, Supervisor
from probewatch.appliance.types import Fault, State, Verdict, VerdictKind
from tests.support.supervised import (
    DURATIONS,
    LATCHED,
    REQUEST_AFTER_NS,
    S_NS,
    TICK_NS,
    H,
    I,
    M,
    Q,
    Room,
    device,
    faults,
    room_in,
    unsure,
)


def test_latched_states_keep_the_fault_that_led_there() -> None:
    room = room_in(State.HALT)
    room.fault(TICK_NS, "rotation")
    assert (room.alarm.state, room.alarm.fault, room.alarm.reason) == (H, "scale", "seen")


def test_a_latched_state_names_what_is_shown_in_place_of_what_led_there() -> None:
    """It went on to name the tracker's delay, which had been set right, where the marker body had turned."""
    room = room_in(State.MONITORING)
    for _ in range(3):
        room.fault(S_NS, "latency")
    room.ask(Request.ACKNOWLEDGE)
    room.fault(TICK_NS, "rotation")
    assert (room.alarm.fault, room.alarm.acknowledged) == ("latency", True), "a word is none yet"
    room.fault(DURATIONS.halt_after_ns - 1, "rotation")
    assert room.alarm.fault == "latency"
    room.fault(1, "rotation")
    assert (room.alarm.state, room.alarm.fault, room.alarm.latched_fault) == (H, "rotation", "rotation")
    assert not room.alarm.acknowledged, "nobody has been told of it"
    room.ask(Request.ACKNOWLEDGE)
    for name in ("latency", "rotation"):
        room.fault(TICK_NS, name)
        room.fault(DURATIONS.halt_after_ns, name)
        assert (room.alarm.fault, room.alarm.acknowledged) == (name, True), "both have been acknowledged"


def test_of_several_faults_that_were_told_each_is_acknowledged() -> None:
    room = room_in(State.MONITORING)
    for _ in range(3):
        room.at(S_NS // 2, faults(room.now_ns + S_NS // 2, "rotation-lateral", "offset-axial"))
    room.ask(Request.ACKNOWLEDGE)
    room.fault(TICK_NS, "offset")
    room.fault(DURATIONS.halt_after_ns, "offset")
    assert (room.alarm.state, room.alarm.fault, room.alarm.acknowledged) == (H, "offset", True)


@LATCHED
def test_latched_states_leave_when_verified_and_then_acknowledged(state: State) -> None:
    room = room_in(state)
    assert room.ok() is state
    assert room.ok(60 * S_NS) is state
    assert room.ask(Request.ACKNOWLEDGE) is state
    assert (room.supervisor.refused, room.alarm.acknowledged, room.alarm.energised) == ("", True, False)
    assert room.ok() is M
    assert (room.alarm.latched, room.alarm.acknowledged) == (None, False)


@LATCHED
def test_latched_states_leave_when_acknowledged_and_then_verified(state: State) -> None:
    room = room_in(state)
    assert room.ask(Request.ACKNOWLEDGE) is state
    assert room.at(60 * S_NS, unsure(room.now_ns)) is state
    assert room.ok() is state
    assert room.ok(DURATIONS.probation_ns - 1) is state
    assert room.ok(1) is M


@LATCHED
def test_verification_alone_frees_no_latched_state(state: State) -> None:
    room = room_in(state)
    assert {room.ok(S_NS) for _ in range(100)} == {state}
    assert room.alarm.latched is state


@LATCHED
@pytest.mark.parametrize("other", ["", "rotation"])
def test_a_fault_that_comes_again_must_be_acknowledged_again(state: State, other: str) -> None:
    """The same one as well: to take it for acknowledged would keep it silent for good."""
    room = room_in(state)
    name = other or room.alarm.fault or ""
    room.ask(Request.ACKNOWLEDGE)
    room.ok()
    assert room.alarm.acknowledged
    room.fault(name=name)
    assert not room.alarm.acknowledged
    room.ok()
    assert room.ok(2 * S_NS) is state


def test_acknowledging_twice_says_that_it_waits() -> None:
    room = room_in(State.HALT)
    room.ask(Request.ACKNOWLEDGE)
    room.ask(Request.ACKNOWLEDGE)
    assert "verified again" in room.supervisor.refused


def test_an_escalation_must_be_acknowledged_again() -> None:
    room = room_in(State.HALT)
    room.ask(Request.ACKNOWLEDGE)
    assert room.fault(2 * S_NS, "scale") is Q
    assert not room.alarm.acknowledged


def test_an_unverified_line_does_not_free_a_latched_state() -> None:
    room = room_in(State.HALT)
    room.ask(Request.ACKNOWLEDGE)
    assert room.at(S_NS, unsure(room.now_ns)) is H
    assert room.at(60 * S_NS, unsure(room.now_ns)) is H


def test_device_silence_in_halt_stays_halt_until_verified_after_it() -> None:
    room = room_in(State.HALT)
    room.ok()
    room.ask(Request.ACKNOWLEDGE)
    assert room.at(5 * S_NS, device()) is H
    assert room.alarm.fault == "scale"
    assert room.at(5 * S_NS) is H
    assert room.ok() is H
    assert room.ok(S_NS) is M


@LATCHED
def test_a_halt_is_not_left_before_a_device_that_was_gone_has_passed_its_probation(state: State) -> None:
    room = room_in(state)
    room.ok()
    room.ask(Request.ACKNOWLEDGE)
    assert room.at(TICK_NS, device()) is state
    assert room.at(5 * S_NS, device()) is state
    back_ns = room.now_ns + TICK_NS
    assert room.at(TICK_NS) is state
    assert room.ok(DURATIONS.probation_ns - 1) is state
    assert room.now_ns == back_ns + DURATIONS.probation_ns - 1
    assert room.ok(1) is M


@LATCHED
def test_damage_found_while_latched_is_shown_after_the_release(state: State) -> None:
    room = room_in(state)
    room.ok(S_NS)
    assert room.at(2 * S_NS, device("log-damaged")) is state
    room.ask(Request.ACKNOWLEDGE)
    assert room.ok() is I, "the halt was acknowledged, the damage was not"
    assert room.alarm.fault == "log-damaged"


@LATCHED
def test_latched_state_survives_a_restart_and_stands_until_disproved(state: State) -> None:
    room = Room(state, "polarity")
    room.step()
    alarm = room.alarm
    assert (alarm.state, alarm.fault, alarm.energised, alarm.since_ns) == (state, "polarity", False, room.now_ns)
    assert (alarm.latched, alarm.latched_fault, alarm.acknowledged) == (state, "polarity", False)
    assert room.ask(Request.ACKNOWLEDGE) is state
    assert room.at(60 * S_NS) is state
    assert room.ok() is state
    assert room.ok(S_NS) is M


@LATCHED
def test_a_latch_whose_fault_is_not_known_any_more_stands_as_long(state: State) -> None:
    room = Room(state)
    room.step()
    assert (room.alarm.fault, room.alarm.reason) == (None, operator_text(state, None)[0])
    room.ask(Request.ACKNOWLEDGE)
    assert room.ok() is state
    assert room.ok(DURATIONS.probation_ns - 1) is state
    assert room.ok(1) is M


def test_a_restored_halt_escalates_by_what_is_shown_after_the_restart() -> None:
    room = Room(State.HALT, "scale")
    room.step()
    due_ns = DURATIONS.halt_after_ns + DURATIONS.recalibrate_after_ns
    assert room.fault(due_ns - 1, "scale") is H
    assert room.fault(1, "scale") is Q


def test_only_latched_states_come_back() -> None:
    with pytest.raises(AssertionError):
        Supervisor(DURATIONS, State.WARNING, "scale")


@pytest.mark.parametrize("name", [None, "offset", "rotation"])
def test_a_halt_that_comes_back_asks_for_nothing_that_is_not_shown(name: str | None) -> None:
    room = Room(State.HALT, name)
    room.step()
    for _ in range(10):
        assert room.fault(S_NS, "offset") is H
    assert room.at(TICK_NS, faults(room.now_ns + TICK_NS, "offset-elevational")) is H
    assert room.at(REQUEST_AFTER_NS, faults(room.now_ns + REQUEST_AFTER_NS, "offset-elevational")) is Q


def test_an_ok_of_motion_before_the_fault_does_not_disprove_it() -> None:
    room = room_in(State.HALT)
    room.ask(Request.ACKNOWLEDGE)
    before_ns = room.now_ns - 20 * S_NS
    for _ in range(60):
        room.at(TICK_NS, Inputs(verdicts=(Verdict(room.now_ns, VerdictKind.OK, (), verified_ns=before_ns),)))
    assert room.alarm.latched is State.RECALIBRATION_REQUESTED, "the fault stands, so it escalates"
    room.ask(Request.ACKNOWLEDGE)
    for _ in range(60):
        room.ok()
    assert room.alarm.state is State.MONITORING


def test_what_was_latched_as_one_of_two_is_told_as_what_it_turns_out_to_be() -> None:
    room = room_in(State.MONITORING)
    for _ in range(3):
        room.fault(S_NS, "undecided")
    assert (room.alarm.state, room.alarm.latched_fault) == (State.HALT, Fault.UNDECIDED)
    room.at(TICK_NS, unsure(room.now_ns + TICK_NS))
    assert room.alarm.fault is Fault.UNDECIDED
    room.fault(name="rotation")
    assert (room.alarm.fault, room.alarm.latched_fault, room.alarm.reason) == (Fault.ROTATION, Fault.ROTATION, "seen")
    room.fault(name="offset")
    assert room.alarm.energised is False
    assert room.alarm.latched_fault is not Fault.UNDECIDED


def test_a_latched_fault_that_has_a_name_keeps_it() -> None:
    room = room_in(State.HALT)
    room.fault(name="undecided")
    assert (room.alarm.fault, room.alarm.latched_fault) == (Fault.SCALE, Fault.SCALE)
