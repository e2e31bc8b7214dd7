"""Derives the state of the room from verdicts and device checks. Pure: no clock, no device; time is an argument.

Decisions that the table alone does not show:
- A calibration fault, once shown, stays active until the line reports OK; NOT_VERIFIED neither lifts it nor lets it
  escalate.
- A frozen picture is of the device kind: the contact opens at once, and monitoring resumes by itself after the
  picture moves again and the calibration has been verified again; nothing has to be done about the calibration. The
  same holds for a tracker's field that looks distorted.
- A calibration fault ends in HALT. A recalibration is requested for what motion does not recover, whether that was
  wrong from the start or was added to what motion recovers; it is then named.
- A latched state is reported as the fault that led to it until the line has shown another one in its place for as
  long as a HALT takes, or anew after an OK: then it is reported as that one, which must be acknowledged if it was
  never reported. A fault that was one of two is reported at once as what motion shows it to be. A device that is lost
  meanwhile replaces neither.
- A latched state is left only when a person has acknowledged it and the line has verified the calibration since, in
  either order, or by a recalibration that was confirmed; a recalibration that was given up returns to it.
- Damage to the alarm's memory or log opens the contact until a person has acknowledged it.
- The verification is forgotten whenever a hazard is active or the probe is out of the tracker's sight.
"""

from dataclasses import dataclass
from enum import Enum

import statemachine

from probewatch.appliance.supervision.alarms import (
    ACKNOWLEDGED,
    BEHIND,
    DISTURBED,
    HAZARDS,
    NOT_NOW,
    OUTDATED,
    operator_text,
)
from probewatch.appliance.supervision.condition import Condition
from probewatch.appliance.supervision.ledger import Ledger
from probewatch.appliance.supervision.policy import Durations
from probewatch.appliance.types import AlarmState, Check, Fault, State, Verdict, VerdictKind

__all__ = ["Durations", "Inputs", "Request", "Supervisor"]

TICK_NS = 50_000_000
"""ns between two steps of the supervisor. More finds a silent device later, beyond its `Timeouts`, and leaves less room
for a command to an output, which lives for five of them; less costs processor time. A verdict is handled without delay.
"""
LATCHED = (State.HALT, State.RECALIBRATION_REQUESTED)
_CALM = (State.SELF_TEST, State.WAITING, State.NOT_VERIFIED, State.MONITORING)


class Request(Enum):
    """Names what a person may request; the values are the events of the table."""

    ACKNOWLEDGE = "acknowledge"
    BEGIN_RECALIBRATION = "begin_recalibration"
    END_RECALIBRATION = "end_recalibration"
    ABORT_RECALIBRATION = "abort_recalibration"


@dataclass(frozen=True, slots=True)
class Inputs:
    """Holds everything that reached the supervisor since its last step.

    verdicts: of the line, in order. devices: one Check per device watcher, as of now. request: at most one.
    """

    verdicts: tuple[Verdict, ...] = ()
    devices: tuple[Check, ...] = ()
    request: Request | None = None


def _state(state: State, initial: bool = False) -> statemachine.State:
    return statemachine.State(state.value, value=state, initial=initial)


class AlarmTable(statemachine.StateMachine):
    """Holds the table. Transitions of one event are tried from top to bottom; guards are properties of the Ledger."""

    allow_event_without_transition = True

    self_test = _state(State.SELF_TEST, initial=True)
    waiting = _state(State.WAITING)
    not_verified = _state(State.NOT_VERIFIED)
    monitoring = _state(State.MONITORING)
    warning = _state(State.WARNING)
    halt = _state(State.HALT)
    recalibration_requested = _state(State.RECALIBRATION_REQUESTED)
    recalibrating = _state(State.RECALIBRATING)
    device_lost = _state(State.DEVICE_LOST)
    internal_fault = _state(State.INTERNAL_FAULT)

    tick = (
        self_test.to(internal_fault, cond="integrity_broken")
        | self_test.to(waiting, cond="self_tested")
        | self_test.to(internal_fault, cond="internal_fault and self_test_overdue")
        | self_test.to(device_lost, cond="self_test_overdue")
        | waiting.to(internal_fault, cond="internal_fault")
        | waiting.to(warning, cond="calibration_fault")
        | waiting.to(device_lost, cond="device_fault and start_overdue")
        | waiting.to(not_verified, unless="device_fault")
        | not_verified.to(internal_fault, cond="internal_fault")
        | not_verified.to(warning, cond="hazard")
        | not_verified.to(monitoring, cond="verified")
        | monitoring.to(internal_fault, cond="internal_fault")
        | monitoring.to(warning, cond="hazard")
        | monitoring.to(not_verified, unless="verified")
        | warning.to(halt, cond="halting")
        | warning.to(internal_fault, cond="internal_fault")
        | warning.to(device_lost, cond="losing_device")
        | warning.to(monitoring, cond="cleared and verified")
        | warning.to(not_verified, cond="cleared")
        | halt.to(recalibration_requested, cond="recalibration_due")
        | halt.to(internal_fault, cond="disproved and integrity_broken")
        | halt.to(monitoring, cond="disproved and cleared")
        | recalibration_requested.to(internal_fault, cond="disproved and integrity_broken")
        | recalibration_requested.to(monitoring, cond="disproved and cleared")
        | device_lost.to(halt, cond="halting")
        | device_lost.to(internal_fault, cond="device_back and internal_fault")
        | device_lost.to(warning, cond="device_back and calibration_fault")
        | device_lost.to(not_verified, cond="device_back")
        | internal_fault.to(halt, cond="halting")
        | internal_fault.to(warning, cond="internal_back and hazard")
        | internal_fault.to(not_verified, cond="internal_back")
        | recalibrating.to(halt, cond="latched_halt and (losing_device or losing_internal)")
        | recalibrating.to(recalibration_requested, cond="latched_request and (losing_device or losing_internal)")
        | recalibrating.to(internal_fault, cond="losing_internal")
        | recalibrating.to(device_lost, cond="losing_device")
        | recalibrating.to(monitoring, cond="verified and !hazard")
    )
    acknowledge = (
        halt.to(halt, unless="acknowledged")
        | recalibration_requested.to(recalibration_requested, unless="acknowledged")
        | internal_fault.to(internal_fault, cond="integrity_broken")
    )
    begin_recalibration = (
        waiting.to(recalibrating)
        | not_verified.to(recalibrating)
        | monitoring.to(recalibrating)
        | warning.to(recalibrating)
        | halt.to(recalibrating)
        | recalibration_requested.to(recalibrating)
        | recalibrating.to(recalibrating)
    )
    end_recalibration = recalibrating.to(recalibrating, cond="scanning")
    abort_recalibration = (
        recalibrating.to(halt, cond="latched_halt")
        | recalibrating.to(recalibration_requested, cond="latched_request")
        | recalibrating.to(internal_fault, cond="internal_fault")
        | recalibrating.to(device_lost, cond="losing_device")
        | recalibrating.to(warning, cond="device_fault")
        | recalibrating.to(not_verified)
    )


class Supervisor:
    """Runs the table.

    latched, fault: a latched state to start in after a restart; without one it begins with the self-test.
    """

    def __init__(self, durations: Durations, latched: State | None = None, fault: Fault | None = None) -> None:
        assert latched is None or latched in LATCHED
        start = State.SELF_TEST if latched is None else latched
        self._ledger = Ledger(durations)
        self._table = AlarmTable(self._ledger, state_field="table_state", start_value=start)
        self._since_ns: int | None = None
        self._fault, self._reason = fault, operator_text(start, fault)[0]
        self.refused = ""
        """Why the last step did not grant its request; empty when it did, or had none."""

    @property
    def state(self) -> State:
        state = self._table.current_state_value
        assert isinstance(state, State)
        return state

    def retime(self, durations: Durations) -> None:
        """Applies other durations from the next step on."""
        self._ledger.durations = durations

    def invalidate_verification(self) -> None:
        """Discards what was measured until now: it verifies nothing any more, as when the limits have changed."""
        self._ledger.forget_verification()

    def step(self, now_ns: int, inputs: Inputs) -> AlarmState:
        """Returns the state of the room at now_ns (host clock, ns, never decreasing). The caller writes the outputs."""
        before = self.state
        if self._since_ns is None:
            self._since_ns = now_ns
            self._come_back(now_ns)
        self._ledger.note(now_ns, inputs.verdicts, inputs.devices)
        self.refused = "" if inputs.request is None else self.refusal(inputs.request)
        if inputs.request is not None and not self.refused:
            self._grant(inputs.request)
        else:
            self._table.send("tick")
        if self.state is not before:
            self._since_ns = now_ns
            self._enter(before)
        self._name_what_is_shown()
        return self._alarm_state(self._since_ns)

    def refusal(self, request: Request) -> str:
        """Returns why the table does not grant this request now; empty when it does."""
        if request.value in {event.id for event in self._table.enabled_events()}:
            return ""
        if request is Request.ACKNOWLEDGE and self.state in LATCHED:
            return ACKNOWLEDGED
        return f"{NOT_NOW} {self.state.value}"

    def _come_back(self, now_ns: int) -> None:
        self._ledger.now_ns = now_ns
        if self.state in LATCHED:
            self._ledger.latch(self.state, self._fault)
            self._ledger.restore(self._reason)

    def _grant(self, request: Request) -> None:
        self._table.send(request.value)
        match request:
            case Request.ACKNOWLEDGE if self.state is State.INTERNAL_FAULT:
                self._ledger.accept_damage()
            case Request.ACKNOWLEDGE:
                self._ledger.acknowledge()
            case Request.BEGIN_RECALIBRATION:
                self._ledger.begin_recalibration()
            case Request.END_RECALIBRATION:
                self._ledger.end_recalibration()
            case Request.ABORT_RECALIBRATION:
                pass  # _enter leaves the recalibration, as it does when devices are lost

    def _enter(self, before: State) -> None:
        if before is State.RECALIBRATING:
            self._ledger.leave_recalibration()
            if self.state in LATCHED:
                return self._ledger.restore(self._reason)
        if self.state in LATCHED:
            requested = self.state is State.RECALIBRATION_REQUESTED
            cause = self._ledger.unrecovered if requested else self._ledger.calibration
            self._fault, self._reason = cause.fault, cause.reason
            self._ledger.latch(self.state, self._fault)
        elif self.state is not State.RECALIBRATING:
            self._ledger.release()
        return None

    def _name_what_is_shown(self) -> None:
        """Updates the fault that a latched state is reported as. People repair what is named, so a part that is no
        longer at fault must not be named. A state latched as undecided takes the fault that motion then shows, and
        stays acknowledged, because the person was shown both.
        """
        if self.state not in LATCHED:
            return
        shown = self._ledger.calibration
        if self._fault is Fault.UNDECIDED and shown.shown and shown.fault is not self._fault:
            self._fault, self._reason = shown.fault, shown.reason
            self._ledger.latched_fault = shown.fault
        elif (instead := self._ledger.replaced()) is not None:
            self._fault, self._reason = instead.fault, instead.reason
            self._ledger.rename(instead.fault)

    def _alarm_state(self, since_ns: int) -> AlarmState:
        ledger = self._ledger
        fault, reason = (self._fault, self._reason) if self.state in LATCHED else self._cause()
        return AlarmState(
            state=self.state,
            since_ns=since_ns,
            fault=fault,
            reason=reason,
            energised=self.state is State.MONITORING,
            verified_ns=ledger.verified_ns,
            latched=ledger.latched,
            latched_fault=ledger.latched_fault,
            acknowledged=ledger.acknowledged,
            notices=ledger.notices,
            barrier_ns=ledger.barrier_ns,
        )

    def _cause(self) -> tuple[Fault | None, str]:
        condition = self._condition()
        if condition is not None:
            return (None if self.state in _CALM else condition.fault), condition.reason
        if self.state is State.NOT_VERIFIED:
            return self._ledger.reported_sight, self._unverified_reason()
        return None, operator_text(self.state, None)[0]

    def _condition(self) -> Condition | None:
        """Returns the condition that the present state is about; in probation, the one that has just gone."""
        ledger = self._ledger
        calibration, device, internal, integrity = ledger.calibration, ledger.device, ledger.internal, ledger.integrity
        if self.state is State.SELF_TEST:
            return None
        if self.state is State.DEVICE_LOST:
            return device
        if self.state is State.INTERNAL_FAULT:
            shown = next((one for one in (integrity, internal) if one.active), None)
            return shown or max(integrity, internal, key=lambda one: one.lifted_ns or 0)
        if self.state is State.WARNING and not ledger.hazard:
            return max(calibration, device, internal, key=lambda one: one.lifted_ns or 0)
        return next((one for one in (calibration, device, internal) if one.active), None)

    def _unverified_reason(self) -> str:
        if self._ledger.reported_sight is not None:
            return HAZARDS[self._ledger.reported_sight].text
        last = self._ledger.last
        if last is not None and last.kind is VerdictKind.OK and not self._ledger.verified:
            if self._ledger.behind:
                return BEHIND
            return DISTURBED if self._ledger.verified_ns is None else OUTDATED
        if last is not None and last.kind is not VerdictKind.OK and last.reason:
            return last.reason
        return operator_text(State.NOT_VERIFIED, None)[1]
