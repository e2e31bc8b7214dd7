"""The table, by hand: every state × every input, and every duration one nanosecond before and at its bound."""

import itertools
from dataclasses import asdict, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from probewatch.appliance.supervision.alarms import BEHIND, operator_text
from probewatch.appliance.supervision.policy import CAUGHT_UP_NS
from probewatch.appliance.supervision.supervisor import AlarmTable, Inputs, Request
from probewatch.appliance.types import State, Verdict, VerdictKind
from tests.support.supervised import (
    DURATIONS,
    INPUTS,
    S_NS,
    TICK_NS,
    A,
    H,
    I,
    L,
    M,
    N,
    Q,
    R,
    Room,
    T,
    W,
    device,
    ok,
    resting,
    room_in,
    scale,
    unsure,
)

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


def test_what_comes_after_an_ok_is_named_at_once() -> None:
    room = room_in(State.HALT)
    room.ok()
    room.fault(name="rotation")
    assert (room.alarm.state, room.alarm.fault, room.alarm.latched_fault) == (H, "rotation", "rotation")


def test_a_mirrored_picture_halts_sooner_than_a_drift() -> None:
    room = room_in(State.MONITORING)
    assert room.fault() is W
    assert room.fault(DURATIONS.gross_halt_after_ns - 1) is W
    assert room.fault(1) is H
    assert room.fault(60 * S_NS) is H, "it is mended at the scanner"


def carried(t_ns: int, shown_ns: int, expires_ns: int | None = None) -> Inputs:
    """The line still says OK, of what was shown then."""
    return Inputs((Verdict(t_ns, VerdictKind.OK, (), verified_ns=shown_ns, expires_ns=expires_ns),))


def test_verification_expires_at_its_bound() -> None:
    room = room_in(State.MONITORING)
    shown_ns, last_ns = room.now_ns, room.now_ns + DURATIONS.max_verification_age_ns
    assert room.at(last_ns - shown_ns, carried(last_ns, shown_ns)) is M
    assert room.at(1) is N
    assert not room.alarm.energised


def test_what_has_an_age_limit_of_its_own_expires_before_the_others() -> None:
    room = room_in(State.MONITORING)
    shown_ns, expires_ns = room.now_ns, room.now_ns + 2 * S_NS
    assert room.at(0, carried(shown_ns, shown_ns, expires_ns)) is M
    assert room.at(2 * S_NS, carried(expires_ns, shown_ns, expires_ns)) is M
    assert room.at(1) is N


def test_an_age_limit_of_its_own_never_lengthens_a_verification() -> None:
    room = room_in(State.MONITORING)
    shown_ns, expires_ns, last_ns = room.now_ns, room.now_ns + 600 * S_NS, DURATIONS.max_verification_age_ns + 1
    assert room.at(0, carried(shown_ns, shown_ns, expires_ns)) is M
    assert room.at(last_ns, carried(shown_ns + last_ns, shown_ns, expires_ns)) is N


def test_other_durations_count_from_the_next_step() -> None:
    room = room_in(State.WARNING)
    room.supervisor.retime(replace(DURATIONS, halt_after_ns=5 * S_NS))
    assert room.fault(S_NS, "scale") is W
    assert room.fault(4 * S_NS, "scale") is H


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
        "behind": 1000,  # no key of the configuration
    }
    assert asdict(DURATIONS) == {f"{name}_ns": value * 1_000_000 for name, value in ms.items()}


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
    old_ns, last_ns = room.now_ns, room.now_ns + DURATIONS.max_verification_age_ns + TICK_NS
    said = replace(said, t_ns=last_ns, verified_ns=old_ns)
    assert room.at(last_ns - old_ns, Inputs((said,))) is N
    assert room.alarm.reason == "the last verification is too old; move the probe over tissue"
    room.supervisor.invalidate_verification()
    assert room.at(TICK_NS, Inputs((said,))) is N
    assert room.alarm.reason == "verified only before a disturbance; move the probe over tissue"


@pytest.mark.parametrize("state", [State.MONITORING, State.WARNING])
def test_a_verdict_of_a_time_long_gone_verifies_nothing(state: State) -> None:
    """As where the times of the pictures stand still: what was shown would stay young for ever."""
    room = room_in(state)
    shown_ns = room.now_ns
    for _ in range(2 * DURATIONS.probation_ns // TICK_NS):
        t_ns = room.now_ns + TICK_NS - DURATIONS.behind_ns - 1
        found = room.at(TICK_NS, Inputs(verdicts=(Verdict(t_ns, VerdictKind.OK, (), verified_ns=shown_ns),)))
    assert found is {State.MONITORING: N, State.WARNING: H}[state], "the fault that was shown stands"
    assert (room.alarm.reason == BEHIND) is (found is N)


def test_times_about_as_late_as_may_be_switch_the_contact_once() -> None:
    """A cart at 15 Hz that was late by .95 s switched it 79 times in 8 s."""
    room = room_in(State.MONITORING)
    shown_ns = room.now_ns

    def late_by(lag_ns: int) -> State:
        said = Verdict(room.now_ns + TICK_NS - lag_ns, VerdictKind.OK, (), verified_ns=shown_ns)
        return room.at(TICK_NS, Inputs(verdicts=(said,)))

    lags_ns = (DURATIONS.behind_ns, DURATIONS.behind_ns + 1, DURATIONS.behind_ns - CAUGHT_UP_NS + 1) * 3
    assert [late_by(lag_ns) for lag_ns in lags_ns] == [M, *[N] * 8]
    assert late_by(DURATIONS.behind_ns - CAUGHT_UP_NS) is M
    assert late_by(DURATIONS.behind_ns) is M


def test_a_verdict_may_be_behind_by_as_much_as_is_known() -> None:
    room = room_in(State.MONITORING)
    shown_ns = room.now_ns
    known_ns = 3 * S_NS
    room.supervisor.retime(replace(DURATIONS, behind_ns=DURATIONS.behind_ns + known_ns))
    for _ in range(100):
        late = Verdict(room.now_ns + TICK_NS - known_ns, VerdictKind.OK, (), verified_ns=shown_ns)
        assert room.at(TICK_NS, Inputs(verdicts=(late,))) is M
