"""The table, by hand: every state × every input, and every duration one nanosecond before and at its bound."""

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from appliance.supervision.alarms import HAZARDS, Kind
from appliance.supervision.supervisor import AlarmTable, Durations, Inputs, Request, Supervisor
from appliance.types import AlarmState, Check, State, Verdict, VerdictKind

S_NS = 1_000_000_000
TICK_NS = 50_000_000
DURATIONS = Durations()


def ok(t_ns: int) -> Inputs:
    return Inputs(verdicts=(Verdict(t_ns, VerdictKind.OK, ()),))


def unsure(t_ns: int) -> Inputs:
    return Inputs(verdicts=(Verdict(t_ns, VerdictKind.NOT_VERIFIED, (), reason="still"),))


def fault(t_ns: int, name: str = "polarity") -> Inputs:
    return Inputs(verdicts=(Verdict(t_ns, VerdictKind.FAULT, (), name, "seen"),))


def device(name: str = "video-lost", verdict: VerdictKind = VerdictKind.FAULT) -> Inputs:
    return Inputs(devices=(Check("watcher", name, 900.0, 0.0, "ms", 500.0, verdict),))


UNSEEN = device("line-of-sight", VerdictKind.NOT_VERIFIED)


class Room:
    """A supervisor with a clock that the test moves."""

    def __init__(self) -> None:
        self.supervisor = Supervisor(DURATIONS)
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
    if state is State.STARTING:
        room.step(device())
        return room
    room.step()
    if state is State.NOT_VERIFIED:
        return room
    room.ok()
    if state is State.RECALIBRATING:
        room.ask(Request.BEGIN_RECALIBRATION)
    elif state is State.DEVICE_LOST:
        room.at(TICK_NS, device())
        room.at(S_NS, device())
    elif state is not State.MONITORING:
        room.fault()
        for _ in range({State.WARNING: 0, State.HALT: 1, State.RECALIBRATION_REQUESTED: 3}[state]):
            room.fault(S_NS)
    assert room.alarm.state is state
    return room


N, M, W, H, Q, R, L, S = (
    State.NOT_VERIFIED,
    State.MONITORING,
    State.WARNING,
    State.HALT,
    State.RECALIBRATION_REQUESTED,
    State.RECALIBRATING,
    State.DEVICE_LOST,
    State.STARTING,
)
INPUTS = {
    "nothing": lambda _: Inputs(),
    "ok": ok,
    "unsure": unsure,
    "fault": fault,
    "frozen": lambda t_ns: fault(t_ns, "frozen-video"),
    "device": lambda _: device(),
    "unseen": lambda _: UNSEEN,
    "acknowledge": lambda _: Inputs(request=Request.ACKNOWLEDGE),
    "begin": lambda _: Inputs(request=Request.BEGIN_RECALIBRATION),
    "end": lambda _: Inputs(request=Request.END_RECALIBRATION),
    "abort": lambda _: Inputs(request=Request.ABORT_RECALIBRATION),
}
ONE_TICK_LATER = {
    # from  nothing, ok, unsure, fault, frozen, device, unseen, acknowledge, begin, end, abort
    S: (N, N, N, W, S, S, N, N, R, N, N),
    N: (N, M, N, W, W, W, N, N, R, N, N),
    M: (M, M, M, W, W, W, N, M, R, M, M),
    W: (W, W, W, W, W, W, W, W, R, W, W),
    H: (H, H, H, H, H, H, H, H, R, H, H),
    Q: (Q, Q, Q, Q, Q, Q, Q, Q, R, Q, Q),
    R: (R, R, R, R, R, R, R, R, R, R, N),
    L: (L, L, L, L, L, L, L, L, L, L, L),
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
    "halt": (W, fault, DURATIONS.halt_after_ns, H),
    "recalibration": (H, fault, DURATIONS.recalibrate_after_ns, Q),
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
    assert room.fault() is H


def test_a_fault_of_another_calibration_class_continues_the_same_condition() -> None:
    room = room_in(State.WARNING)
    assert room.fault(S_NS, "rotation") is H
    assert room.alarm.fault == "rotation"
    assert room.fault(2 * S_NS, "offset") is Q


def test_latched_states_keep_the_fault_that_led_there() -> None:
    room = room_in(State.HALT)
    room.fault(TICK_NS, "scale")
    assert (room.alarm.state, room.alarm.fault, room.alarm.reason) == (H, "polarity", "seen")


@pytest.mark.parametrize("state", [State.HALT, State.RECALIBRATION_REQUESTED])
def test_latched_states_leave_by_acknowledge_after_the_line_disproved_the_fault(state: State) -> None:
    room = room_in(state)
    assert room.ask(Request.ACKNOWLEDGE) is state
    assert "still stands" in room.supervisor.refused
    assert room.ok() is state
    assert room.ok(60 * S_NS) is state
    assert room.ask(Request.ACKNOWLEDGE) is N
    assert room.supervisor.refused == ""
    assert not room.alarm.energised
    assert room.ok() is M


def test_an_unverified_line_does_not_free_a_latched_state() -> None:
    room = room_in(State.HALT)
    room.at(S_NS, unsure(room.now_ns))
    assert room.ask(Request.ACKNOWLEDGE) is H


def test_device_silence_in_halt_stays_halt_and_forbids_acknowledging() -> None:
    room = room_in(State.HALT)
    room.ok()
    assert room.at(5 * S_NS, device()) is H
    assert room.at(TICK_NS, Inputs(devices=device().devices, request=Request.ACKNOWLEDGE)) is H
    assert room.alarm.fault == "polarity"


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


def test_start_waits_for_devices_and_gives_up_at_its_bound() -> None:
    room = room_in(State.STARTING)
    assert room.at(DURATIONS.starting_ns - 1, device()) is S
    assert room.alarm.fault is None
    assert room.at(1, device()) is L


def test_unseen_probe_is_not_verified_and_needs_verification_anew() -> None:
    room = room_in(State.MONITORING)
    assert room.at(TICK_NS, UNSEEN) is N
    assert room.alarm.reason == "probe not seen by the tracker"
    assert room.at(TICK_NS) is N
    assert room.ok() is M


def test_frozen_picture_is_lost_like_a_device_and_recovers_by_itself() -> None:
    room = room_in(State.MONITORING)
    assert room.fault(TICK_NS, "frozen-video") is W
    assert room.fault(S_NS, "frozen-video") is L
    assert room.at(TICK_NS, unsure(room.now_ns)) is L
    assert room.at(S_NS, unsure(room.now_ns)) is N
    assert room.ok() is M


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


def test_device_loss_ends_a_recalibration() -> None:
    room = room_in(State.RECALIBRATING)
    assert room.at(TICK_NS, device()) is R
    assert room.at(S_NS, device()) is L
    assert room.at(S_NS) is L
    assert room.at(S_NS) is N
    assert room.ok() is M, "after the loss the line counts again"


def test_recalibration_clears_a_latched_fault() -> None:
    room = room_in(State.RECALIBRATION_REQUESTED)
    assert room.ask(Request.BEGIN_RECALIBRATION) is R
    assert room.ask(Request.ABORT_RECALIBRATION) is N


@pytest.mark.parametrize("state", [State.HALT, State.RECALIBRATION_REQUESTED])
def test_latched_state_survives_a_restart_and_stands_until_disproved(state: State) -> None:
    supervisor = Supervisor(DURATIONS, start=state, fault="polarity")
    alarm = supervisor.step(S_NS, Inputs())
    assert (alarm.state, alarm.fault, alarm.energised, alarm.since_ns) == (state, "polarity", False, S_NS)
    supervisor.step(2 * S_NS, Inputs(request=Request.ACKNOWLEDGE))
    assert supervisor.state is state
    supervisor.step(3 * S_NS, ok(3 * S_NS))
    assert supervisor.step(4 * S_NS, Inputs(request=Request.ACKNOWLEDGE)).state is State.NOT_VERIFIED


@pytest.mark.parametrize("name", [name for name, row in HAZARDS.items() if row.kind is Kind.CALIBRATION])
def test_every_calibration_class_walks_the_whole_way(name: str) -> None:
    room = room_in(State.MONITORING)
    seen = [room.fault(S_NS // 4, name) for _ in range(14)]
    assert [state for state, _ in itertools.groupby(seen)] == [W, H, Q]
    assert room.alarm.fault == name


@pytest.mark.parametrize("name", [name for name, row in HAZARDS.items() if row.kind is Kind.DEVICE])
def test_every_device_class_is_lost_within_its_time(name: str) -> None:
    room = room_in(State.MONITORING)
    seen = [room.at(S_NS // 4, device(name)) for _ in range(6)]
    assert [state for state, _ in itertools.groupby(seen)] == [W, L]
    assert room.alarm.fault == name


def test_an_unknown_fault_class_is_our_bug_and_crashes() -> None:
    with pytest.raises(KeyError):
        room_in(State.MONITORING).fault(name="gremlins")


EVENTS = st.lists(st.tuples(st.sampled_from(list(INPUTS)), st.sampled_from([TICK_NS, S_NS, 31 * S_NS])), max_size=60)


@settings(max_examples=150, deadline=None)
@given(events=EVENTS)
def test_no_sequence_energises_with_a_hazard_or_without_fresh_verification(events: list[tuple[str, int]]) -> None:
    room = Room()
    for kind, delta_ns in events:
        before = room.supervisor.state
        state = room.at(delta_ns, INPUTS[kind](room.now_ns + delta_ns))
        if room.alarm.energised:
            assert kind not in {"fault", "frozen", "device", "unseen"}
            assert room.alarm.verified_ns is not None
            assert room.now_ns - room.alarm.verified_ns <= DURATIONS.max_verification_age_ns
        if before in {H, Q} and state not in {H, Q}:
            assert kind in {"acknowledge", "begin"}
