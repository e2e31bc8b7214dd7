"""From verdicts and device checks to the state of the room. Pure: no clock, no device; time is an argument.

Decisions that the table alone does not tell:
- A calibration fault once shown stands until the line says OK; NOT_VERIFIED neither lifts it nor lets it escalate.
- A frozen picture is of the device kind: the contact opens at once, and monitoring resumes by itself after the
  picture moves again and the calibration has been verified again; nothing about the calibration is to be done.
- A latched state keeps the fault that led to it; a device lost meanwhile does not replace it.
- Verification is forgotten whenever a hazard is active or the probe is out of the tracker's sight.
"""

from dataclasses import dataclass
from enum import Enum

import statemachine

from appliance.supervision.alarms import operator_text
from appliance.supervision.ledger import Condition, Durations, Ledger
from appliance.types import AlarmState, Check, State, Verdict

__all__ = ["Durations", "Inputs", "Request", "Supervisor"]

LATCHED = (State.HALT, State.RECALIBRATION_REQUESTED)
_CALM = (State.STARTING, State.NOT_VERIFIED, State.MONITORING)


class Request(Enum):
    """What a person may ask; the values are the events of the table."""

    ACKNOWLEDGE = "acknowledge"
    BEGIN_RECALIBRATION = "begin_recalibration"
    END_RECALIBRATION = "end_recalibration"
    ABORT_RECALIBRATION = "abort_recalibration"


@dataclass(frozen=True, slots=True)
class Inputs:
    """Everything that reached the supervisor since its last step.

    verdicts: of the line, in order. devices: one Check per device watcher, as of now. request: at most one.
    """

    verdicts: tuple[Verdict, ...] = ()
    devices: tuple[Check, ...] = ()
    request: Request | None = None


def _state(state: State, initial: bool = False) -> statemachine.State:
    return statemachine.State(state.value, value=state, initial=initial)


class AlarmTable(statemachine.StateMachine):
    """The table. Transitions of one event are tried from top to bottom; guards are properties of the Ledger."""

    allow_event_without_transition = True

    starting = _state(State.STARTING, initial=True)
    not_verified = _state(State.NOT_VERIFIED)
    monitoring = _state(State.MONITORING)
    warning = _state(State.WARNING)
    halt = _state(State.HALT)
    recalibration_requested = _state(State.RECALIBRATION_REQUESTED)
    recalibrating = _state(State.RECALIBRATING)
    device_lost = _state(State.DEVICE_LOST)

    tick = (
        starting.to(warning, cond="calibration_fault")
        | starting.to(device_lost, cond="device_fault and start_overdue")
        | starting.to(not_verified, unless="device_fault")
        | not_verified.to(warning, cond="hazard")
        | not_verified.to(monitoring, cond="verified")
        | monitoring.to(warning, cond="hazard")
        | monitoring.to(not_verified, unless="verified")
        | warning.to(halt, cond="halting")
        | warning.to(device_lost, cond="losing_device")
        | warning.to(monitoring, cond="cleared and verified")
        | warning.to(not_verified, cond="cleared")
        | halt.to(recalibration_requested, cond="recalibration_due")
        | device_lost.to(halt, cond="halting")
        | device_lost.to(warning, cond="device_back and calibration_fault")
        | device_lost.to(not_verified, cond="device_back")
        | recalibrating.to(device_lost, cond="losing_device")
        | recalibrating.to(monitoring, cond="confirming and verified and !hazard")
    )
    acknowledge = halt.to(not_verified, unless="hazard") | recalibration_requested.to(not_verified, unless="hazard")
    begin_recalibration = (
        starting.to(recalibrating)
        | not_verified.to(recalibrating)
        | monitoring.to(recalibrating)
        | warning.to(recalibrating)
        | halt.to(recalibrating)
        | recalibration_requested.to(recalibrating)
        | recalibrating.to(recalibrating)
    )
    end_recalibration = recalibrating.to(recalibrating, cond="scanning")
    abort_recalibration = recalibrating.to(not_verified)


class Supervisor:
    """start: a latched state to come back in after a restart; anything else begins at STARTING."""

    def __init__(self, durations: Durations, start: State = State.STARTING, fault: str | None = None) -> None:
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

    def step(self, now_ns: int, inputs: Inputs) -> AlarmState:
        """State of the room at now_ns (host clock, ns, never going back). The caller writes outputs afterwards."""
        before = self.state
        if self._since_ns is None:
            self._since_ns = now_ns
            self._restore(now_ns)
        self._ledger.note(now_ns, inputs.verdicts, inputs.devices)
        self.refused = "" if inputs.request is None else self.refusal(inputs.request)
        if inputs.request is not None and not self.refused:
            self._grant(inputs.request)
        else:
            self._table.send("tick")
        if self.state is not before:
            self._since_ns = now_ns
            self._enter(before)
        return self._alarm_state(self._since_ns)

    def _restore(self, now_ns: int) -> None:
        """What latched before the restart stands until the line disproves it."""
        if self._fault is not None and self.state in LATCHED:
            self._ledger.calibration.show(now_ns, self._fault, self._reason)
            self._ledger.calibration.stand()

    def refusal(self, request: Request) -> str:
        """Why the table does not grant this request now; empty when it does."""
        if request.value in {event.id for event in self._table.enabled_events()}:
            return ""
        if request is Request.ACKNOWLEDGE and self.state in LATCHED:
            return f"the cause still stands ({self._ledger.calibration.fault or self._ledger.device.fault})"
        return f"not possible while {self.state.value}"

    def _grant(self, request: Request) -> None:
        self._table.send(request.value)
        if request is Request.BEGIN_RECALIBRATION:
            self._ledger.begin_recalibration()
        elif request is Request.END_RECALIBRATION:
            self._ledger.end_recalibration()
        elif request is Request.ABORT_RECALIBRATION:
            self._ledger.abort_recalibration()

    def _enter(self, before: State) -> None:
        if before is State.RECALIBRATING:
            self._ledger.leave_recalibration()
        if self.state in LATCHED:
            self._fault, self._reason = self._ledger.calibration.fault, self._ledger.calibration.reason

    def _alarm_state(self, since_ns: int) -> AlarmState:
        if self.state not in LATCHED:
            self._fault, self._reason = self._cause()
        energised = self.state is State.MONITORING
        return AlarmState(self.state, since_ns, self._fault, self._reason, energised, self._ledger.verified_ns)

    def _cause(self) -> tuple[str | None, str]:
        condition = self._condition()
        if condition is not None:
            return (None if self.state in _CALM else condition.fault), condition.reason
        if self.state is State.NOT_VERIFIED:
            return None, self._unverified_reason()
        return None, operator_text(self.state, None)[0]

    def _condition(self) -> Condition | None:
        """The condition that the present state is about; in probation it is the one that has just gone."""
        calibration, device = self._ledger.calibration, self._ledger.device
        if self.state is State.DEVICE_LOST:
            return device
        if self.state is State.WARNING and not self._ledger.hazard:
            return max(calibration, device, key=lambda one: one.lifted_ns or 0)
        return next((one for one in (calibration, device) if one.active), None)

    def _unverified_reason(self) -> str:
        if self._ledger.unverified:
            return self._ledger.unverified
        last = self._ledger.last
        if last is not None and last.reason:
            return last.reason
        return operator_text(State.NOT_VERIFIED, None)[1]
