"""Devices and parts that fail: from the self-test to their loss, and back."""

import itertools
from dataclasses import replace

import pytest

from probewatch.appliance.supervision.alarms import HAZARDS
from probewatch.appliance.supervision.supervisor import Inputs, Request
from probewatch.appliance.types import Check, Fault, Kind, State, Verdict, VerdictKind
from tests.support.supervised import (
    DURATIONS,
    S_NS,
    TICK_NS,
    UNSEEN,
    A,
    H,
    I,
    L,
    M,
    N,
    Room,
    T,
    W,
    device,
    fault,
    ok,
    room_in,
    scale,
    unsure,
)


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


def test_damage_that_was_acknowledged_is_not_told_as_a_part_that_is_well() -> None:
    """It was told as the estimator, which had been silent some time before."""
    room = room_in(State.MONITORING)
    room.at(TICK_NS, device("estimator-silent"))
    assert room.at(TICK_NS) is I
    assert room.at(TICK_NS, device("log-damaged")) is I
    room.at(TICK_NS, Inputs(devices=device("log-damaged").devices, request=Request.ACKNOWLEDGE))
    assert (room.alarm.state, room.alarm.fault) == (I, "log-damaged")


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


@pytest.mark.parametrize("name", [name for name in HAZARDS if name.kind is Kind.DEVICE])
def test_every_device_class_is_lost_within_its_time(name: str) -> None:
    room = room_in(State.MONITORING)
    seen = [room.at(S_NS // 4, device(name)) for _ in range(6)]
    assert [state for state, _ in itertools.groupby(seen)] == [W, L]
    assert room.alarm.fault == name


def test_damage_that_was_acknowledged_and_mended_is_another_alarm_when_it_is_found_again() -> None:
    room = room_in(State.MONITORING)
    damaged = device("log-damaged")
    room.at(TICK_NS, damaged)
    room.at(TICK_NS, replace(damaged, request=Request.ACKNOWLEDGE))
    for _ in range(3):
        assert room.at(TICK_NS, damaged) is not State.INTERNAL_FAULT, "it was seen"
    room.ok()
    assert room.at(TICK_NS, damaged) is State.INTERNAL_FAULT


def test_a_picture_without_tissue_opens_the_contact_without_an_alarm() -> None:
    room = room_in(State.MONITORING)
    blank = Check("no-picture", Fault.NO_PICTURE, 600.0, 0.0, "ms", 500.0, VerdictKind.NOT_VERIFIED)
    t_ns = room.now_ns + TICK_NS
    assert room.at(TICK_NS, Inputs(verdicts=(Verdict(t_ns, VerdictKind.OK, (blank,), verified_ns=t_ns),))) is (
        State.NOT_VERIFIED
    )
    assert room.alarm.fault == "no-picture"
