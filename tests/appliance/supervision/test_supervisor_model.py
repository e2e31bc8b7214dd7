"""The supervisor against a model of what safety asks, written without looking at its table."""

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from probewatch.appliance.supervision.alarms import HAZARDS
from probewatch.appliance.supervision.supervisor import Durations, Inputs, Request, Supervisor
from probewatch.appliance.types import AlarmState, Check, Fault, Kind, State, Verdict, VerdictKind

MS_NS = 1_000_000
D = Durations()
STEPS_NS = st.sampled_from([50, 50, 50, 300, 950, 1000, 2000, 31_000]).map(lambda ms: ms * MS_NS)
CALIBRATION = [name for name in HAZARDS if name.kind is Kind.CALIBRATION]
WATCHED = [name for name in HAZARDS if name.kind in (Kind.DEVICE, Kind.INTERNAL) and name != "frozen-video"]
DAMAGE = [name for name in HAZARDS if name.kind is Kind.INTEGRITY]
UNRECOVERED = (
    Check("scale-axial", Fault.SCALE, 9, 0.1, "%", 5, VerdictKind.FAULT),
    Check("offset-elevational", Fault.OFFSET, 9, 0.1, "mm", 4, VerdictKind.FAULT),
)
BESIDE = [
    (),
    (Check("offset-axial", Fault.OFFSET, 9, 0.1, "mm", 4, VerdictKind.FAULT),),
    (Check("scale-axial", Fault.SCALE, 0, 0.1, "%", 5, VerdictKind.OK),),
    *((check,) for check in UNRECOVERED),
]
RECALIBRATION = [Request.BEGIN_RECALIBRATION, Request.END_RECALIBRATION, Request.ABORT_RECALIBRATION]
LATCHED = {State.HALT, State.RECALIBRATION_REQUESTED}
ALARMED = LATCHED | {State.DEVICE_LOST, State.INTERNAL_FAULT, State.SELF_TEST, State.WAITING}


class Room(RuleBasedStateMachine):
    """Everything a room can do to the supervisor, in any order and at any time."""

    steps = 0

    @initialize()
    def begin(self) -> None:
        self.now_ns = 10**12
        self.supervisor = Supervisor(D)
        self.watched: set[str] = set()
        self.damage: set[str] = set()
        self.unseen = self.frozen = False
        self.alarm: AlarmState
        self.ok_ns: int | None = None  # measured, of the newest OK that speaks of the reference in force
        self.fault_since_ns: int | None = None  # shown in every step since, without interruption
        self.faulty = False  # the last word that was no shrug said FAULT
        self.watched_since_ns: int | None = None
        self.acknowledged = self.disproved = self.confirmed = False
        self.unrecovered = False  # shown since the contact was closed last: a scale, or an offset across the picture
        self.step(50 * MS_NS)

    def silence(self, delta_ns: int) -> int:
        """All of it but one tick, which is what remains: the service ticks all the while, not once in 31 s."""
        if delta_ns > 50 * MS_NS:
            self.step(delta_ns - 50 * MS_NS)
        return 50 * MS_NS

    def step(self, delta_ns: int, verdict: Verdict | None = None, request: Request | None = None) -> None:
        Room.steps += 1
        self.now_ns += delta_ns
        failing = [Check(name, name, 2, 0, "", 1, VerdictKind.FAULT) for name in sorted(self.watched | self.damage)]
        sight = VerdictKind.NOT_VERIFIED if self.unseen else VerdictKind.OK
        checks = (*failing, Check("sight", Fault.LINE_OF_SIGHT, 2, 0, "", 1, sight))
        if self.watched and self.watched_since_ns is None:
            self.watched_since_ns = self.now_ns
        elif not self.watched:
            self.watched_since_ns = None
        before = None if not hasattr(self, "alarm") else self.alarm.state
        self.alarm = self.supervisor.step(self.now_ns, Inputs(() if verdict is None else (verdict,), checks, request))
        self._after(before)

    def _after(self, before: State | None) -> None:
        if before in LATCHED and self.alarm.state not in LATCHED and self.alarm.state is not State.RECALIBRATING:
            assert self.acknowledged, "nobody acknowledged it"
            assert self.disproved, "nothing disproved it"
        if self.alarm.state is State.RECALIBRATION_REQUESTED:
            assert self.unrecovered, "motion recovers it"
        self.unrecovered = self.unrecovered and not self.alarm.energised
        if self.alarm.state in LATCHED and before not in LATCHED | {State.RECALIBRATING}:
            self.acknowledged = self.disproved = False

    @rule(delta_ns=STEPS_NS)
    def nothing_is_said(self, delta_ns: int) -> None:
        self.fault_since_ns = None
        self.step(delta_ns)

    @rule(delta_ns=STEPS_NS)
    def line_says_ok(self, delta_ns: int) -> None:
        delta_ns = self.silence(delta_ns)
        self.fault_since_ns, self.faulty, self.disproved, self.frozen = None, False, True, False
        self.ok_ns = self.now_ns + delta_ns
        self.step(delta_ns, Verdict(self.ok_ns, VerdictKind.OK, (), verified_ns=self.ok_ns))

    @rule(delta_ns=STEPS_NS)
    def line_shrugs(self, delta_ns: int) -> None:
        delta_ns = self.silence(delta_ns)
        self.fault_since_ns, self.frozen = None, False
        self.step(delta_ns, Verdict(self.now_ns + delta_ns, VerdictKind.NOT_VERIFIED, (), verified_ns=self.ok_ns))

    @rule(delta_ns=STEPS_NS, fault=st.sampled_from(CALIBRATION), beside=st.sampled_from(BESIDE))
    def line_says_fault(self, delta_ns: int, fault: Fault, beside: tuple[Check, ...]) -> None:
        delta_ns = self.silence(delta_ns)
        since_ns = self.now_ns + delta_ns if self.fault_since_ns is None else self.fault_since_ns
        self.unrecovered |= fault in (Fault.SCALE, Fault.EXCHANGED_PROBE) or any(
            check in UNRECOVERED for check in beside
        )
        self.step(delta_ns, Verdict(self.now_ns + delta_ns, VerdictKind.FAULT, beside, fault))
        self.fault_since_ns, self.faulty, self.frozen = since_ns, True, False
        self.ok_ns = None

    @rule(delta_ns=STEPS_NS)
    def line_says_that_the_picture_is_frozen(self, delta_ns: int) -> None:
        delta_ns = self.silence(delta_ns)
        self.fault_since_ns, self.ok_ns, self.frozen = None, None, True
        self.step(delta_ns, Verdict(self.now_ns + delta_ns, VerdictKind.FAULT, (), Fault.FROZEN_VIDEO))

    @rule()
    def limits_change(self) -> None:
        self.supervisor.invalidate_verification()
        self.ok_ns = None
        self.step(50 * MS_NS)

    @rule(name=st.sampled_from(WATCHED))
    def part_fails(self, name: str) -> None:
        self.watched.add(name)
        self.step(50 * MS_NS)

    @rule()
    def parts_come_back(self) -> None:
        self.watched.clear()
        self.step(50 * MS_NS)

    @rule(hidden=st.booleans())
    def probe_is_hidden_or_seen(self, hidden: bool) -> None:
        self.unseen = hidden
        self.step(50 * MS_NS)

    @rule(name=st.sampled_from(DAMAGE))
    def memory_is_found_damaged(self, name: str) -> None:
        self.damage.add(name)
        self.step(50 * MS_NS)

    @rule()
    def person_acknowledges(self) -> None:
        seen = self.alarm
        self.step(50 * MS_NS, request=Request.ACKNOWLEDGE)
        if not self.supervisor.refused and seen.state in LATCHED:
            self.acknowledged = True
        elif not self.supervisor.refused:
            self.damage.discard(str(seen.fault))
            self.step(50 * MS_NS)

    @rule(request=st.sampled_from(RECALIBRATION))
    def person_recalibrates(self, request: Request) -> None:
        self.step(50 * MS_NS, request=request)
        if not self.supervisor.refused:
            self.ok_ns, self.faulty, self.fault_since_ns, self.disproved = None, False, None, False
            self.frozen = False

    @rule()
    def power_fails(self) -> None:
        latched = self.alarm.latched
        self.supervisor = Supervisor(D, latched, self.alarm.latched_fault)
        self.ok_ns, self.fault_since_ns, self.watched_since_ns = None, None, None
        self.faulty = self.acknowledged = self.disproved = self.frozen = False
        del self.alarm
        self.step(50 * MS_NS)
        assert latched is None or self.alarm.state is latched

    @invariant()
    def energised_only_when_verified_and_nothing_is_wrong(self) -> None:
        if self.alarm.energised:
            assert not self.watched
            assert not self.damage
            assert not self.unseen
            assert not self.frozen
            assert not self.faulty
            assert self.ok_ns is not None
            assert self.now_ns - self.ok_ns <= D.max_verification_age_ns

    @invariant()
    def no_deadline_is_missed(self) -> None:
        state = self.alarm.state
        if self.watched_since_ns is not None and self.now_ns - self.watched_since_ns >= D.device_lost_after_ns:
            assert state in ALARMED | {State.WARNING, State.RECALIBRATING}
        shown_ns = 0 if self.fault_since_ns is None else self.now_ns - self.fault_since_ns
        if shown_ns >= D.halt_after_ns + 2 * D.device_lost_after_ns and state is not State.RECALIBRATING:
            assert state in ALARMED, "a fault shown this long has halted"
        assert state is not State.HALT or self.alarm.latched is State.HALT

    @invariant()
    def a_latched_state_is_remembered(self) -> None:
        if self.alarm.state in LATCHED:
            assert self.alarm.latched is self.alarm.state
            assert self.alarm.latched_fault is not None

    def teardown(self) -> None:
        """No deadlock: with everything well again and a person at hand, monitoring comes back."""
        if not hasattr(self, "alarm"):
            return
        self.watched.clear()
        self.unseen = False
        self.step(50 * MS_NS, request=Request.ABORT_RECALIBRATION)
        for _ in range(3):
            self.person_acknowledges()
            for _ in range(30):
                self.line_says_ok(100 * MS_NS)
        assert self.alarm.state is State.MONITORING


def run(examples: int, steps: int) -> int:
    """How many steps the supervisor took."""
    Room.steps = 0
    patient = settings(deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
    run_state_machine_as_test(Room, settings=settings(patient, max_examples=examples, stateful_step_count=steps))
    return Room.steps


def test_no_path_is_unsafe() -> None:
    assert run(30, 50) > 1500


@pytest.mark.thorough
def test_no_path_of_thousands_of_steps_is_unsafe() -> None:
    assert run(60, 50) > 3000


@pytest.mark.slow
def test_no_path_of_a_hundred_thousand_steps_is_unsafe() -> None:
    assert run(1000, 100) >= 100_000
