"""The table, by hand: every state × every input, and every duration one nanosecond before and at its bound."""

import itertools
from dataclasses import asdict, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from appliance.supervision.alarms import HAZARDS, operator_text
from appliance.supervision.supervisor import AlarmTable, Durations, Inputs, Request, Supervisor
from appliance.types import AlarmState, Check, Fault, Kind, State, Verdict, VerdictKind

S_NS = 1_000_000_000
TICK_NS = 50_000_000
DURATIONS = Durations()


def ok(t_ns: int) -> Inputs:
    return Inputs(verdicts=(Verdict(t_ns, VerdictKind.OK, (), verified_ns=t_ns),))


def unsure(t_ns: int) -> Inputs:
    return Inputs(verdicts=(Verdict(t_ns, VerdictKind.NOT_VERIFIED, (), reason="still"),))


def resting(t_ns: int) -> Inputs:
    """What was shown stands, and is as old as the tick before."""
    shown_ns = t_ns - TICK_NS
    return Inputs(verdicts=(Verdict(t_ns, VerdictKind.NOT_VERIFIED, (), reason="still", verified_ns=shown_ns),))


def fault(t_ns: int, name: str = "polarity") -> Inputs:
    return Inputs(verdicts=(Verdict(t_ns, VerdictKind.FAULT, (), Fault(name), "seen"),))


def scale(t_ns: int) -> Inputs:
    return fault(t_ns, "scale")


def faults(t_ns: int, *checks: str) -> Inputs:
    """Several at once, each told by the check of that name; the first names the verdict."""
    failing = tuple(Check(name, Fault(name.partition("-")[0]), 9.0, 0.1, "", 4.0, VerdictKind.FAULT) for name in checks)
    healthy = Check("scale-lateral", Fault.SCALE, 0.0, 0.1, "%", 5.0, VerdictKind.OK)
    return Inputs(
        verdicts=(Verdict(t_ns, VerdictKind.FAULT, (healthy, *failing), failing[0].fault, ", ".join(checks)),)
    )


def device(name: str = "video-lost", verdict: VerdictKind = VerdictKind.FAULT) -> Inputs:
    return Inputs(devices=(Check("watcher", Fault(name), 900.0, 0.0, "ms", 500.0, verdict),))


UNSEEN = device("line-of-sight", VerdictKind.NOT_VERIFIED)


class Room:
    """A supervisor with a clock that the test moves."""

    def __init__(self, latched: State | None = None, fault: str | None = None) -> None:
        self.supervisor = Supervisor(DURATIONS, latched, fault)
        self.now_ns = 100 * S_NS
        self.alarm: AlarmState

    def step(self, inputs: Inputs = Inputs()) -> State:  # noqa: B008  frozen value
        self.alarm = self.supervisor.step(self.now_ns, inputs)
        return self.alarm.state

    def at(self, delta_ns: int, inputs: Inputs = Inputs()) -> State:  # noqa: B008  frozen value
        self.now_ns += delta_ns
        return self.step(inputs)

    def ok(self, delta_ns: int = TICK_NS) -> State:
        return self.at(delta_ns, ok(self.now_ns + delta_ns))

    def fault(self, delta_ns: int = TICK_NS, name: str = "polarity") -> State:
        return self.at(delta_ns, fault(self.now_ns + delta_ns, name))

    def ask(self, request: Request) -> State:
        return self.at(TICK_NS, Inputs(request=request))


def room_in(state: State) -> Room:
    """A room brought into a state by the path that leads there in the clinic."""
    room = Room()
    if state is State.SELF_TEST:
        room.step(device("output-failed"))
    elif state is State.WAITING:
        room.step(device())
    elif state is State.NOT_VERIFIED:
        room.step()
        room.at(TICK_NS)
    elif state is State.INTERNAL_FAULT:
        room.step(device("memory-damaged"))
    else:
        room.step()
        room.ok()
        room.ok()
        _lead_on(room, state)
    assert room.alarm.state is state
    return room


def _lead_on(room: Room, state: State) -> None:
    if state is State.RECALIBRATING:
        room.ask(Request.BEGIN_RECALIBRATION)
    elif state is State.DEVICE_LOST:
        room.at(TICK_NS, device())
        room.at(S_NS, device())
    elif state is not State.MONITORING:
        room.fault(name="scale")
        for _ in range({State.WARNING: 0, State.HALT: 1, State.RECALIBRATION_REQUESTED: 3}[state]):
            room.fault(S_NS, "scale")


T, A, N, M, W, H, Q, R, L, I = (  # noqa: E741  one letter a state keeps the table readable
    State.SELF_TEST,
    State.WAITING,
    State.NOT_VERIFIED,
    State.MONITORING,
    State.WARNING,
    State.HALT,
    State.RECALIBRATION_REQUESTED,
    State.RECALIBRATING,
    State.DEVICE_LOST,
    State.INTERNAL_FAULT,
)
INPUTS = {
    "nothing": lambda _: Inputs(),
    "ok": ok,
    "unsure": unsure,
    "resting": resting,
    "fault": fault,
    "frozen": lambda t_ns: fault(t_ns, "frozen-video"),
    "device": lambda _: device(),
    "output": lambda _: device("output-failed"),
    "estimator": lambda _: device("estimator-silent"),
    "damage": lambda _: device("memory-damaged"),
    "log": lambda _: device("log-not-written"),
    "unseen": lambda _: UNSEEN,
    "acknowledge": lambda _: Inputs(request=Request.ACKNOWLEDGE),
    "begin": lambda _: Inputs(request=Request.BEGIN_RECALIBRATION),
    "end": lambda _: Inputs(request=Request.END_RECALIBRATION),
    "abort": lambda _: Inputs(request=Request.ABORT_RECALIBRATION),
}
ONE_TICK_LATER = {
    # nothing, ok, unsure, resting, fault, frozen, device, output, estimator, damage, log, unseen,
    # acknowledge, begin, end, abort
    T: (A, A, A, A, A, A, A, T, T, I, A, A, A, A, A, A),
    A: (N, N, N, N, W, A, A, A, I, I, N, N, N, R, N, N),
    N: (N, M, N, M, W, W, W, W, I, I, N, N, N, R, N, N),
    M: (M, M, N, M, W, W, W, W, I, I, M, N, M, R, M, M),
    W: (W, W, W, W, W, W, W, W, I, I, W, W, W, R, W, W),
    H: (H, H, H, H, H, H, H, H, H, H, H, H, H, R, H, H),
    Q: (Q, Q, Q, Q, Q, Q, Q, Q, Q, Q, Q, Q, Q, R, Q, Q),
    R: (R, R, R, R, R, R, R, R, R, R, R, R, R, R, R, N),
    L: (L, L, L, L, L, L, L, L, L, L, L, L, L, L, L, L),
    I: (I, I, I, I, I, I, I, I, I, I, I, I, I, I, I, I),
}


@pytest.mark.parametrize(("state", "kind"), list(itertools.product(ONE_TICK_LATER, INPUTS)))
def test_every_state_with_every_input(state: State, kind: str) -> None:
    room = room_in(state)
    expected = ONE_TICK_LATER[state][list(INPUTS).index(kind)]
    assert room.at(TICK_NS, INPUTS[kind](room.now_ns + TICK_NS)) is expected
    assert room.alarm.energised == (expected is State.MONITORING)


def test_the_table_names_every_state() -> None:
    assert set(ONE_TICK_LATER) == set(State) == set(AlarmTable.states_map)


def test_every_request_is_an_event_of_the_table() -> None:
    assert {event.id for event in AlarmTable.events} == {request.value for request in Request} | {"tick"}


BOUNDS = {
    # name: (state before, inputs that keep coming, time of the bound after entering the state, state at the bound)
    "halt": (W, scale, DURATIONS.halt_after_ns, H),
    "recalibration": (H, scale, DURATIONS.recalibrate_after_ns, Q),
}


@pytest.mark.parametrize("name", BOUNDS)
def test_calibration_fault_escalates_at_its_bound(name: str) -> None:
    before, make, bound_ns, after = BOUNDS[name]
    room = room_in(before)
    entered_ns = room.now_ns
    assert room.at(bound_ns - 1, make(room.now_ns)) is before
    assert room.at(1, make(room.now_ns)) is after
    assert room.alarm.since_ns == entered_ns + bound_ns


def test_device_is_lost_at_its_bound_and_back_after_probation_and_verification() -> None:
    room = room_in(State.MONITORING)
    assert room.at(TICK_NS, device()) is W
    assert room.at(DURATIONS.device_lost_after_ns - 1, device()) is W
    assert room.at(1, device()) is L
    assert room.alarm.fault == "video-lost"
    assert room.at(S_NS) is L
    assert room.at(DURATIONS.probation_ns - 1) is L
    assert room.at(1) is N
    assert room.at(10 * S_NS) is N
    assert room.ok() is M


def test_what_was_measured_before_the_device_came_back_verifies_nothing() -> None:
    room = room_in(State.DEVICE_LOST)
    measured_while_lost = ok(room.now_ns)
    room.at(S_NS)
    assert room.at(S_NS, measured_while_lost) is N
    assert room.at(TICK_NS) is N


def test_short_device_silence_warns_and_recovers_without_loss() -> None:
    room = room_in(State.MONITORING)
    assert room.at(TICK_NS, device("tracker-lost")) is W
    assert room.alarm.fault == "tracker-lost"
    room.at(S_NS // 2)
    assert room.ok(S_NS // 4) is W
    assert room.alarm.fault == "tracker-lost", "in probation the cause is still named"
    assert room.ok(DURATIONS.probation_ns - S_NS // 4) is M


def test_a_warning_that_nothing_verifies_ends_unverified() -> None:
    room = room_in(State.MONITORING)
    assert room.at(TICK_NS, device()) is W
    assert room.at(TICK_NS) is W
    assert room.at(DURATIONS.probation_ns - 1) is W
    assert room.at(1) is N
    assert room.ok() is M


def test_warning_leaves_at_the_end_of_probation_not_before() -> None:
    room = room_in(State.WARNING)
    assert room.ok() is W
    assert room.ok(DURATIONS.probation_ns - 1) is W
    assert room.ok(1) is M


def test_flicker_restarts_probation_and_escalation() -> None:
    room = room_in(State.WARNING)
    for _ in range(20):
        assert room.ok(S_NS // 2) is W
        assert room.fault(S_NS // 2) is W


def test_not_verified_neither_lifts_a_fault_nor_escalates_it() -> None:
    room = room_in(State.WARNING)
    for _ in range(20):
        assert room.at(S_NS, unsure(room.now_ns)) is W
    assert room.fault(name="scale") is H


def test_a_fault_of_another_calibration_class_continues_the_same_condition() -> None:
    room = room_in(State.WARNING)
    assert room.fault(S_NS, "rotation") is H
    assert room.alarm.fault == "rotation"
    assert room.fault(10 * S_NS, "offset") is H


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


def test_what_comes_after_an_ok_is_named_at_once() -> None:
    room = room_in(State.HALT)
    room.ok()
    room.fault(name="rotation")
    assert (room.alarm.state, room.alarm.fault, room.alarm.latched_fault) == (H, "rotation", "rotation")


def test_of_several_faults_that_were_told_each_is_acknowledged() -> None:
    room = room_in(State.MONITORING)
    for _ in range(3):
        room.at(S_NS // 2, faults(room.now_ns + S_NS // 2, "rotation-lateral", "offset-axial"))
    room.ask(Request.ACKNOWLEDGE)
    room.fault(TICK_NS, "offset")
    room.fault(DURATIONS.halt_after_ns, "offset")
    assert (room.alarm.state, room.alarm.fault, room.alarm.acknowledged) == (H, "offset", True)


def test_a_recalibration_is_requested_for_what_asked_for_it_whatever_else_is_shown() -> None:
    room = room_in(State.RECALIBRATION_REQUESTED)
    for _ in range(4):
        room.fault(S_NS, "rotation")
    assert (room.alarm.state, room.alarm.fault) == (Q, "scale")


def test_damage_that_was_acknowledged_is_not_told_as_a_part_that_is_well() -> None:
    """It was told as the estimator, which had been silent some time before."""
    room = room_in(State.MONITORING)
    room.at(TICK_NS, device("estimator-silent"))
    assert room.at(TICK_NS) is I
    assert room.at(TICK_NS, device("log-damaged")) is I
    room.at(TICK_NS, Inputs(devices=device("log-damaged").devices, request=Request.ACKNOWLEDGE))
    assert (room.alarm.state, room.alarm.fault) == (I, "log-damaged")


LATCHED = pytest.mark.parametrize("state", [State.HALT, State.RECALIBRATION_REQUESTED])


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
def test_a_fault_that_comes_again_must_be_acknowledged_again(state: State) -> None:
    room = room_in(state)
    room.ask(Request.ACKNOWLEDGE)
    room.ok()
    assert room.alarm.acknowledged
    room.fault(name="rotation")
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


def test_damage_stands_until_acknowledged() -> None:
    room = room_in(State.INTERNAL_FAULT)
    assert room.at(60 * S_NS, device("memory-damaged")) is I
    assert room.at(S_NS, Inputs(devices=device("memory-damaged").devices, request=Request.ACKNOWLEDGE)) is I
    assert room.at(S_NS, device("memory-damaged")) is N
    assert room.at(S_NS, device("log-damaged")) is I, "another damage is another alarm"


def test_a_silent_estimator_is_internal_and_comes_back_after_probation_and_verification() -> None:
    room = room_in(State.MONITORING)
    assert room.at(TICK_NS, device("estimator-silent")) is I
    assert (room.alarm.fault, room.alarm.energised) == ("estimator-silent", False)
    assert room.at(TICK_NS) is I
    assert room.at(DURATIONS.probation_ns - 1) is I
    assert room.at(1) is N
    assert room.at(60 * S_NS) is N
    assert room.ok() is M


def test_a_fault_still_shown_halts_although_the_memory_is_damaged() -> None:
    room = room_in(State.WARNING)
    both = Inputs(scale(room.now_ns).verdicts, device("memory-damaged").devices)
    assert room.at(TICK_NS, both) is I
    assert room.at(S_NS, both) is H


def test_an_internal_fault_gives_way_to_a_device_that_is_gone() -> None:
    room = room_in(State.MONITORING)
    room.at(TICK_NS, device("estimator-silent"))
    room.at(TICK_NS, device())
    assert room.at(DURATIONS.probation_ns, device()) is W
    assert room.at(TICK_NS, device()) is L
    assert room.at(TICK_NS, device("estimator-silent")) is L
    assert room.at(DURATIONS.probation_ns, device("estimator-silent")) is I


def test_an_advisory_leaves_the_contact_closed() -> None:
    room = room_in(State.MONITORING)
    assert room.at(TICK_NS, device("log-not-written")) is M
    assert (room.alarm.notices, room.alarm.energised) == (("log-not-written",), True)


def test_what_a_device_and_the_line_tell_at_once_is_both_told() -> None:
    room = room_in(State.MONITORING)
    frozen = fault(room.now_ns + TICK_NS, "frozen-video")
    assert room.at(TICK_NS, Inputs(frozen.verdicts, device("log-not-written").devices)) is W
    assert (room.alarm.fault, room.alarm.notices) == ("frozen-video", ("log-not-written",))


def test_a_mirrored_picture_halts_sooner_than_a_drift() -> None:
    room = room_in(State.MONITORING)
    assert room.fault() is W
    assert room.fault(DURATIONS.gross_halt_after_ns - 1) is W
    assert room.fault(1) is H
    assert room.fault(60 * S_NS) is H, "it is mended at the scanner"


def test_a_stale_fault_does_not_escalate_while_the_device_is_gone() -> None:
    room = room_in(State.WARNING)
    assert room.at(TICK_NS, device()) is W
    assert room.at(2 * S_NS, device()) is L


def test_a_fault_that_is_still_shown_halts_although_an_output_is_broken() -> None:
    room = room_in(State.DEVICE_LOST)
    for _ in range(2):
        room.now_ns += S_NS
        room.step(Inputs(fault(room.now_ns).verdicts, device("output-failed").devices))
    assert room.alarm.state is H


def test_verification_expires_at_its_bound() -> None:
    room = room_in(State.MONITORING)
    assert room.at(DURATIONS.max_verification_age_ns) is M
    assert room.at(1) is N
    assert not room.alarm.energised


def test_what_has_an_age_limit_of_its_own_expires_before_the_others() -> None:
    room = room_in(State.MONITORING)
    expires_ns = room.now_ns + 2 * S_NS
    verified = Verdict(room.now_ns, VerdictKind.OK, (), verified_ns=room.now_ns, expires_ns=expires_ns)
    assert room.at(0, Inputs((verified,))) is M
    assert room.at(2 * S_NS) is M
    assert room.at(1) is N


def test_an_age_limit_of_its_own_never_lengthens_a_verification() -> None:
    room = room_in(State.MONITORING)
    verified = Verdict(room.now_ns, VerdictKind.OK, (), verified_ns=room.now_ns, expires_ns=room.now_ns + 600 * S_NS)
    assert room.at(0, Inputs((verified,))) is M
    assert room.at(DURATIONS.max_verification_age_ns + 1) is N


def test_start_waits_for_devices_and_gives_up_at_its_bound() -> None:
    room = room_in(State.WAITING)
    assert room.at(DURATIONS.starting_ns - 1, device()) is A
    assert room.alarm.fault is None
    assert room.at(1, device()) is L


def test_devices_that_are_there_at_last_are_waited_for_no_longer() -> None:
    room = room_in(State.WAITING)
    assert room.at(DURATIONS.starting_ns) is N


def test_a_device_that_comes_back_to_a_wrong_calibration_warns_at_once() -> None:
    room = room_in(State.WARNING)
    room.at(TICK_NS, device())
    assert room.at(S_NS, device()) is L
    assert room.at(TICK_NS) is L
    assert room.at(DURATIONS.probation_ns) is W


@pytest.mark.parametrize(("name", "after"), [("output-failed", L), ("estimator-silent", I)])
def test_the_self_test_gives_up_at_its_bound(name: str, after: State) -> None:
    room = Room()
    assert room.step(device(name)) is T
    assert room.at(DURATIONS.self_test_ns - 1, device(name)) is T
    assert not room.alarm.energised
    assert room.at(1, device(name)) is after
    assert room.alarm.fault == name


def test_the_self_test_takes_what_has_come_to_life() -> None:
    room = room_in(State.SELF_TEST)
    assert room.at(TICK_NS) is A
    assert room.at(TICK_NS) is N


def test_unseen_probe_is_not_verified_and_needs_verification_again() -> None:
    room = room_in(State.MONITORING)
    assert room.at(TICK_NS, UNSEEN) is N
    assert room.alarm.reason == HAZARDS["line-of-sight"].text
    assert room.at(TICK_NS) is N
    assert room.ok() is M


@pytest.mark.parametrize("fault", ["line-of-sight", "no-picture"])
def test_what_flickers_out_of_sight_is_told_as_one_episode_and_withholds_no_ok(fault: str) -> None:
    """A log and lamps follow state and fault: a sight that comes and goes for an hour changes them twice."""
    room = room_in(State.MONITORING)
    told = []
    for _ in range(5):
        for delta_ns, inputs in ((TICK_NS, device(fault, VerdictKind.NOT_VERIFIED)), (TICK_NS, Inputs())):
            room.at(delta_ns, inputs)
            told.append((room.alarm.state, room.alarm.fault, room.alarm.reason))
        room.at(DURATIONS.probation_ns - 2 * TICK_NS)
    assert set(told) == {(N, fault, HAZARDS[fault].text)}
    room.at(2 * TICK_NS - 1)
    assert room.alarm.fault == fault
    room.at(1)
    assert room.alarm.fault is None
    room.at(TICK_NS, device(fault, VerdictKind.NOT_VERIFIED))
    assert room.ok() is M, "seen and verified again, at once"


def test_what_a_tracker_does_not_tell_withholds_nothing() -> None:
    room = room_in(State.NOT_VERIFIED)
    untold = device("marker-body", VerdictKind.NOT_VERIFIED)
    assert room.at(TICK_NS, Inputs(ok(room.now_ns + TICK_NS).verdicts, untold.devices)) is M
    assert room.at(TICK_NS, Inputs((), (*untold.devices, *UNSEEN.devices))) is N
    assert room.alarm.reason == HAZARDS["line-of-sight"].text


def test_frozen_picture_is_lost_like_a_device_and_recovers_by_itself() -> None:
    room = room_in(State.MONITORING)
    assert room.fault(TICK_NS, "frozen-video") is W
    assert room.fault(S_NS, "frozen-video") is L
    assert room.at(TICK_NS, unsure(room.now_ns)) is L
    assert room.at(S_NS, unsure(room.now_ns)) is N
    assert room.ok() is M


def test_a_frozen_picture_stays_frozen_while_the_line_says_nothing() -> None:
    room = room_in(State.MONITORING)
    assert room.fault(TICK_NS, "frozen-video") is W
    assert room.at(S_NS) is L


def test_recalibration_ends_only_with_the_new_reference_confirmed() -> None:
    room = room_in(State.RECALIBRATING)
    assert room.fault(S_NS) is R, "the scan itself proves nothing"
    assert room.ok() is R
    in_flight = ok(room.now_ns)
    assert room.ask(Request.END_RECALIBRATION) is R
    assert room.at(TICK_NS, in_flight) is R, "measured before the new reference"
    assert room.fault(5 * S_NS) is R
    assert room.alarm.fault == "polarity"
    assert room.ok() is M
    assert room.at(TICK_NS) is M, "its verification counts"


def test_what_was_shown_before_or_during_the_scan_is_forgotten() -> None:
    room = room_in(State.WARNING)
    assert room.ask(Request.BEGIN_RECALIBRATION) is R
    assert (room.alarm.fault, room.alarm.verified_ns) == (None, None)
    assert room.fault() is R
    assert room.alarm.fault is None
    assert room.ok() is R
    assert room.alarm.verified_ns is None
    assert room.ask(Request.ABORT_RECALIBRATION) is N
    assert room.at(TICK_NS) is N, "the fault before the scan has to show again"
    assert room.fault() is W


def test_what_the_new_reference_showed_is_forgotten_when_it_is_given_up() -> None:
    room = room_in(State.RECALIBRATING)
    room.ask(Request.END_RECALIBRATION)
    assert room.fault() is R
    assert room.ask(Request.ABORT_RECALIBRATION) is N
    assert room.at(TICK_NS) is N


def test_damage_found_meanwhile_keeps_a_recalibration_from_its_end() -> None:
    room = room_in(State.RECALIBRATING)
    room.ask(Request.END_RECALIBRATION)
    assert room.at(TICK_NS, Inputs(ok(room.now_ns + TICK_NS).verdicts, device("log-damaged").devices)) is R


def test_a_reason_from_before_the_scan_is_not_given_after_it() -> None:
    room = room_in(State.NOT_VERIFIED)
    room.at(TICK_NS, unsure(room.now_ns))
    assert room.alarm.reason == "still"
    room.ask(Request.BEGIN_RECALIBRATION)
    room.ask(Request.ABORT_RECALIBRATION)
    assert room.alarm.reason == operator_text(State.NOT_VERIFIED, None)[1]


def test_end_of_recalibration_is_granted_once() -> None:
    room = room_in(State.RECALIBRATING)
    room.ask(Request.END_RECALIBRATION)
    room.ask(Request.END_RECALIBRATION)
    assert room.supervisor.refused


def test_aborted_recalibration_needs_verification() -> None:
    room = room_in(State.RECALIBRATING)
    assert room.ask(Request.ABORT_RECALIBRATION) is N
    assert room.at(S_NS) is N
    assert room.ok() is M


@pytest.mark.parametrize(
    ("name", "lost_ns", "expected"), [("video-lost", 0, W), ("video-lost", S_NS, L), ("estimator-silent", 0, I)]
)
def test_a_recalibration_given_up_shows_at_once_what_failed_meanwhile(name: str, lost_ns: int, expected: State) -> None:
    room = room_in(State.MONITORING)
    if lost_ns:
        assert room.at(TICK_NS, device(name)) is W
        assert room.at(lost_ns - 2 * TICK_NS, device(name)) is W
    failing = device(name).devices
    assert room.at(TICK_NS, Inputs(devices=failing, request=Request.BEGIN_RECALIBRATION)) is R
    assert room.at(TICK_NS, Inputs(devices=failing, request=Request.ABORT_RECALIBRATION)) is expected


def test_device_loss_ends_a_recalibration() -> None:
    room = room_in(State.RECALIBRATING)
    assert room.at(TICK_NS, device()) is R
    assert room.at(S_NS, device()) is L
    assert room.at(S_NS) is L
    assert room.at(S_NS) is N
    assert room.ok() is M, "after the loss the line counts again"


@LATCHED
def test_a_recalibration_given_up_comes_back_to_the_latched_state(state: State) -> None:
    room = room_in(state)
    assert room.ask(Request.BEGIN_RECALIBRATION) is R
    assert (room.alarm.latched, room.alarm.latched_fault) == (state, "scale")
    assert room.ask(Request.ABORT_RECALIBRATION) is state
    assert (room.alarm.fault, room.alarm.energised) == ("scale", False)
    assert room.ask(Request.ACKNOWLEDGE) is state
    assert room.at(60 * S_NS) is state
    room.ok()
    assert room.ok(S_NS) is M


@LATCHED
@pytest.mark.parametrize("name", ["video-lost", "estimator-silent"])
def test_a_recalibration_that_loses_its_devices_comes_back_to_the_latched_state(state: State, name: str) -> None:
    room = room_in(state)
    room.ask(Request.BEGIN_RECALIBRATION)
    assert room.at(TICK_NS, device(name)) is R
    assert room.at(S_NS - 1, device(name)) is R
    assert room.at(1, device(name)) is state
    assert room.alarm.fault == "scale"


def test_a_silent_estimator_ends_a_recalibration() -> None:
    room = room_in(State.RECALIBRATING)
    assert room.at(TICK_NS, device("estimator-silent")) is R
    assert room.at(S_NS, device("estimator-silent")) is I


@LATCHED
def test_a_recalibration_that_is_confirmed_frees_the_latched_state(state: State) -> None:
    room = room_in(state)
    room.ask(Request.BEGIN_RECALIBRATION)
    room.ask(Request.END_RECALIBRATION)
    assert room.ok() is M
    assert room.alarm.latched is None


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


def test_other_durations_count_from_the_next_step() -> None:
    room = room_in(State.WARNING)
    room.supervisor.retime(replace(DURATIONS, halt_after_ns=5 * S_NS))
    assert room.fault(S_NS, "scale") is W
    assert room.fault(4 * S_NS, "scale") is H


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


def test_a_scan_may_be_begun_again() -> None:
    room = room_in(State.RECALIBRATING)
    room.ask(Request.END_RECALIBRATION)
    room.ask(Request.BEGIN_RECALIBRATION)
    assert room.supervisor.refused == ""
    assert room.ok() is R, "it is of the scan"
    room.ask(Request.END_RECALIBRATION)
    assert room.supervisor.refused == ""
    assert room.ok() is M


def test_what_is_refused_says_why() -> None:
    room = room_in(State.MONITORING)
    room.ask(Request.END_RECALIBRATION)
    assert room.supervisor.refused == "not possible while monitoring"
    room.ask(Request.ACKNOWLEDGE)
    assert room.supervisor.refused == "not possible while monitoring"
    halted = room_in(State.HALT)
    halted.ask(Request.ABORT_RECALIBRATION)
    assert halted.supervisor.refused == "not possible while halt"


def test_each_state_tells_its_own_cause() -> None:
    room = room_in(State.MONITORING)
    room.at(TICK_NS, resting(room.now_ns))
    assert room.alarm.reason == operator_text(State.MONITORING, None)[0]
    testing = Room()
    testing.step(device("estimator-silent"))
    assert (testing.alarm.fault, testing.alarm.reason) == (None, operator_text(State.SELF_TEST, None)[0])
    lost = room_in(State.DEVICE_LOST)
    lost.at(TICK_NS)
    assert lost.alarm.fault == "video-lost", "in probation too"
    lost.fault()
    assert lost.alarm.fault == "video-lost", "the calibration comes after it"


def test_the_durations_are_those_of_the_manual() -> None:
    ms = {
        "gross_halt_after": 300,
        "halt_after": 1000,
        "recalibrate_after": 2000,
        "device_lost_after": 1000,
        "probation": 1000,
        "max_verification_age": 120_000,
        "self_test": 20_000,
        "starting": 10_000,
    }
    assert asdict(DURATIONS) == {f"{name}_ns": value * 1_000_000 for name, value in ms.items()}


def test_only_latched_states_come_back() -> None:
    with pytest.raises(AssertionError):
        Supervisor(DURATIONS, State.WARNING, "scale")


@pytest.mark.parametrize("name", [name for name in HAZARDS if name.kind is Kind.CALIBRATION])
def test_every_calibration_class_halts_and_what_needs_a_phantom_asks_for_recalibration(name: str) -> None:
    room = room_in(State.MONITORING)
    seen = [room.fault(S_NS // 10, name) for _ in range(40)]
    assert [state for state, _ in itertools.groupby(seen)] == [W, H, *[Q] * (name in ("scale", "exchanged-probe"))]
    assert room.alarm.fault == name


REQUEST_AFTER_NS = DURATIONS.halt_after_ns + DURATIONS.recalibrate_after_ns
UNRECOVERED = pytest.mark.parametrize(
    ("check", "named"), [("scale-axial", "scale"), ("offset-elevational", "offset"), ("offset-axial", None)]
)


@UNRECOVERED
@pytest.mark.parametrize("first", ["polarity", "rotation-axial", "offset-lateral", "latency"])
def test_what_motion_does_not_recover_counts_from_when_it_joins_what_it_does(
    first: str, check: str, named: str
) -> None:
    room = room_in(State.MONITORING)
    for _ in range(60):
        room.at(S_NS, faults(room.now_ns + S_NS, first))
    assert (room.alarm.state, room.alarm.latched_fault) == (H, first.partition("-")[0])
    room.ask(Request.ACKNOWLEDGE)
    assert room.at(TICK_NS, faults(room.now_ns + TICK_NS, first, check)) is H
    assert room.at(REQUEST_AFTER_NS - 1, faults(room.now_ns + REQUEST_AFTER_NS - 1, first, check)) is H
    assert room.alarm.acknowledged
    if named is None:
        assert room.at(60 * S_NS, faults(room.now_ns + 60 * S_NS, first, check)) is H
        return
    assert room.at(1, faults(room.now_ns + 1, first, check)) is Q
    assert (room.alarm.fault, room.alarm.latched_fault, room.alarm.acknowledged) == (named, named, False)
    assert room.alarm.reason == f"{first}, {check}"
    assert room.at(60 * S_NS, faults(room.now_ns + 60 * S_NS, first)) is Q, "it is latched"


@UNRECOVERED
def test_it_counts_from_the_start_where_it_was_there_from_the_start(check: str, named: str | None) -> None:
    room = room_in(State.MONITORING)
    assert room.at(TICK_NS, faults(room.now_ns + TICK_NS, "polarity", check)) is W
    assert room.at(S_NS, faults(room.now_ns + S_NS, "polarity", check)) is H
    assert room.at(2 * S_NS, faults(room.now_ns + 2 * S_NS, "polarity", check)) is (H if named is None else Q)


def test_what_is_not_shown_any_more_asks_for_no_recalibration() -> None:
    room = room_in(State.MONITORING)
    room.at(TICK_NS, faults(room.now_ns + TICK_NS, "rotation-axial", "scale-axial"))
    for _ in range(20):
        room.at(S_NS, faults(room.now_ns + S_NS, "rotation-axial"))
        room.at(TICK_NS, unsure(room.now_ns + TICK_NS))
        assert room.at(S_NS, device()) is H
    assert room.at(TICK_NS, faults(room.now_ns + TICK_NS, "rotation-axial", "scale-axial")) is Q, "it stood"


@pytest.mark.parametrize("how", ["verified", "scanned"])
def test_what_was_disproved_begins_anew(how: str) -> None:
    room = room_in(State.HALT)
    if how == "verified":
        room.ok()
    else:
        room.ask(Request.BEGIN_RECALIBRATION)
        room.ask(Request.END_RECALIBRATION)
        room.fault(name="rotation")
        room.ask(Request.ABORT_RECALIBRATION)
        room.ok()
    for _ in range(10):
        assert room.fault(S_NS, "rotation") is H
    began_ns = room.now_ns + TICK_NS
    room.fault(name="scale")
    assert room.fault(REQUEST_AFTER_NS - 1, "scale") is H
    assert room.fault(1, "scale") is Q
    assert room.now_ns == began_ns + REQUEST_AFTER_NS


def test_a_scan_forgets_what_asked_for_a_recalibration() -> None:
    room = room_in(State.MONITORING)
    room.fault(name="scale")
    room.ask(Request.BEGIN_RECALIBRATION)
    assert room.ask(Request.ABORT_RECALIBRATION) is N
    for _ in range(10):
        room.fault(S_NS, "rotation")
    assert room.fault(name="scale") is H
    assert room.fault(REQUEST_AFTER_NS - 1, "scale") is H


@pytest.mark.parametrize("name", [None, "offset", "rotation"])
def test_a_halt_that_comes_back_asks_for_nothing_that_is_not_shown(name: str | None) -> None:
    room = Room(State.HALT, name)
    room.step()
    for _ in range(10):
        assert room.fault(S_NS, "offset") is H
    assert room.at(TICK_NS, faults(room.now_ns + TICK_NS, "offset-elevational")) is H
    assert room.at(REQUEST_AFTER_NS, faults(room.now_ns + REQUEST_AFTER_NS, "offset-elevational")) is Q


@pytest.mark.parametrize("name", [name for name in HAZARDS if name.kind is Kind.DEVICE])
def test_every_device_class_is_lost_within_its_time(name: str) -> None:
    room = room_in(State.MONITORING)
    seen = [room.at(S_NS // 4, device(name)) for _ in range(6)]
    assert [state for state, _ in itertools.groupby(seen)] == [W, L]
    assert room.alarm.fault == name


EVENTS = st.lists(st.tuples(st.sampled_from(list(INPUTS)), st.sampled_from([TICK_NS, S_NS, 121 * S_NS])), max_size=60)


@settings(max_examples=150, deadline=None)
@given(events=EVENTS)
def test_no_sequence_energises_with_a_hazard_or_without_fresh_verification(events: list[tuple[str, int]]) -> None:
    room = Room()
    for kind, delta_ns in events:
        before = room.supervisor.state
        state = room.at(delta_ns, INPUTS[kind](room.now_ns + delta_ns))
        if room.alarm.energised:
            assert kind not in {"fault", "frozen", "device", "output", "estimator", "damage", "unseen"}
            assert room.alarm.verified_ns is not None
            assert room.now_ns - room.alarm.verified_ns <= DURATIONS.max_verification_age_ns
        if before in {H, Q} and state not in {H, Q, R}:
            assert "acknowledge" in {past for past, _ in events}


def test_what_was_verified_within_other_limits_verifies_nothing() -> None:
    room = room_in(State.MONITORING)
    doubted_ns = room.now_ns
    room.supervisor.invalidate_verification()
    assert room.at(TICK_NS) is N
    assert not room.alarm.energised
    assert room.at(TICK_NS, ok(doubted_ns)) is N
    assert room.ok() is M


def test_not_verified_never_says_calibration_verified() -> None:
    """The line's last word was OK; what is told is why that does not count."""
    said = Verdict(100 * S_NS, VerdictKind.OK, (), reason="calibration verified")
    room = Room()
    room.step()
    room.at(TICK_NS, Inputs((replace(said, t_ns=room.now_ns, verified_ns=room.now_ns),)))
    assert room.at(TICK_NS, Inputs((replace(said, t_ns=room.now_ns, verified_ns=room.now_ns),))) is M
    old_ns = room.now_ns
    assert (
        room.at(DURATIONS.max_verification_age_ns + TICK_NS, Inputs((replace(said, t_ns=old_ns, verified_ns=old_ns),)))
        is N
    )
    assert room.alarm.reason == "the last verification is too old; move the probe over tissue"
    room.supervisor.invalidate_verification()
    assert room.at(TICK_NS, Inputs((replace(said, t_ns=old_ns, verified_ns=old_ns),))) is N
    assert room.alarm.reason == "verified only before a disturbance; move the probe over tissue"


def test_damage_that_was_acknowledged_and_mended_is_another_alarm_when_it_is_found_again() -> None:
    room = room_in(State.MONITORING)
    damaged = device("log-damaged")
    room.at(TICK_NS, damaged)
    room.at(TICK_NS, replace(damaged, request=Request.ACKNOWLEDGE))
    for _ in range(3):
        assert room.at(TICK_NS, damaged) is not State.INTERNAL_FAULT, "it was seen"
    room.ok()
    assert room.at(TICK_NS, damaged) is State.INTERNAL_FAULT


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


def test_a_picture_without_tissue_opens_the_contact_without_an_alarm() -> None:
    room = room_in(State.MONITORING)
    blank = Check("no-picture", Fault.NO_PICTURE, 600.0, 0.0, "ms", 500.0, VerdictKind.NOT_VERIFIED)
    t_ns = room.now_ns + TICK_NS
    assert room.at(TICK_NS, Inputs(verdicts=(Verdict(t_ns, VerdictKind.OK, (blank,), verified_ns=t_ns),))) is (
        State.NOT_VERIFIED
    )
    assert room.alarm.fault == "no-picture"


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
