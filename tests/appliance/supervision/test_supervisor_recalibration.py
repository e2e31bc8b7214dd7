"""Recalibrations: what requests one, what one forgets, and how it ends."""

import itertools

import pytest

from probewatch.appliance.supervision.alarms import HAZARDS, operator_text
from probewatch.appliance.supervision.supervisor import Inputs, Request
from probewatch.appliance.types import Kind, State
from tests.support.supervised import (
    LATCHED,
    REQUEST_AFTER_NS,
    S_NS,
    TICK_NS,
    H,
    I,
    L,
    M,
    N,
    Q,
    R,
    W,
    device,
    faults,
    ok,
    room_in,
    unsure,
)


def test_a_recalibration_is_requested_for_what_asked_for_it_whatever_else_is_shown() -> None:
    room = room_in(State.RECALIBRATION_REQUESTED)
    for _ in range(4):
        room.fault(S_NS, "rotation")
    assert (room.alarm.state, room.alarm.fault) == (Q, "scale")


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


def test_a_scan_may_be_begun_again() -> None:
    room = room_in(State.RECALIBRATING)
    room.ask(Request.END_RECALIBRATION)
    room.ask(Request.BEGIN_RECALIBRATION)
    assert room.supervisor.refused == ""
    assert room.ok() is R, "it is of the scan"
    room.ask(Request.END_RECALIBRATION)
    assert room.supervisor.refused == ""
    assert room.ok() is M


@pytest.mark.parametrize("name", [name for name in HAZARDS if name.kind is Kind.CALIBRATION])
def test_every_calibration_class_halts_and_what_needs_a_phantom_asks_for_recalibration(name: str) -> None:
    room = room_in(State.MONITORING)
    seen = [room.fault(S_NS // 10, name) for _ in range(40)]
    assert [state for state, _ in itertools.groupby(seen)] == [W, H, *[Q] * (name in ("scale", "exchanged-probe"))]
    assert room.alarm.fault == name


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
