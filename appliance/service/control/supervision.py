"""Runs the supervisor in the service: holds the last verdict and the state in force, and acts on a change of state."""

from collections import Counter
from collections.abc import Callable

from probewatch.appliance.service.control.event_log import EventLog
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.service.host.log import get_log
from probewatch.appliance.service.host.overload_watch import OverloadWatch
from probewatch.appliance.service.host.recorder import Recorder
from probewatch.appliance.storage.alarm_chain import Latch
from probewatch.appliance.supervision.alarms import HAZARDS
from probewatch.appliance.supervision.supervisor import LATCHED, Durations, Inputs, Request, Supervisor
from probewatch.appliance.supervision.turns import Turns
from probewatch.appliance.types import AlarmState, Check, Fault, State, Verdict

Follow = Callable[[State, State], None]
"""Takes (state before, state after) of every step but the first."""


class Supervision:
    """Runs the supervisor, tick by tick.

    now_ns: time of the tick; before the first tick, that of the start, started_ns. verdict: that of the line, None
    while the estimator does not report. heard_ns: time of the last report of the present estimator process. devices:
    checks of the device watchers. alarm: the state in force, None before the first step. follow: is called with every
    step. alarms: how often each hazard came to cause the state, or to be a notice beside it.
    """

    def __init__(
        self, supervisor: Supervisor, events: EventLog, overload: OverloadWatch, recorder: Recorder, now_ns: int
    ) -> None:
        self.started_ns = self.now_ns = now_ns
        self.heard_ns: int | None = None
        self.verdict: Verdict | None = None
        self.devices: tuple[Check, ...] = ()
        self.alarm: AlarmState | None = None
        self.follow: Follow | None = None
        self.alarms = Counter[Fault]()
        self._supervisor, self._events, self._overload, self._recorder = supervisor, events, overload, recorder
        self._turns, self._log = Turns(), get_log()

    @property
    def recalibrating(self) -> bool:
        return self.alarm is not None and self.alarm.state is State.RECALIBRATING

    def hear(self, now_ns: int, heard: bool, speaking: bool, verdicts: tuple[Verdict, ...]) -> None:
        """Takes what the estimator reported since the last tick; reports of a process that has died are forgotten."""
        if heard or not speaking:
            self.heard_ns = now_ns if heard else None
            self.verdict = self.verdict if heard else None
        self.verdict = verdicts[-1] if verdicts else self.verdict

    def step(self, now_ns: int, verdicts: tuple[Verdict, ...], devices: tuple[Check, ...]) -> AlarmState:
        """Performs one tick of the supervisor."""
        self.now_ns, self.devices = now_ns, devices
        return self._step(Inputs(verdicts, devices))

    def ask(self, request: Request) -> AlarmState | None:
        """Passes a person's request to the supervisor, without delay. Returns the alarm that was in force then, None
        before the first step. Raises ControlRefused.
        """
        before = self.alarm
        self._step(Inputs(devices=self.devices, request=request))
        if self._supervisor.refused:
            raise ControlRefused(self._supervisor.refused)
        if request is Request.ACKNOWLEDGE:
            self._recorder.accept_damage(None if before is None else before.fault)
        else:
            self.verdict = None
        self._log.info("request granted", request=request.value)
        return before

    def _step(self, inputs: Inputs) -> AlarmState:
        before = self.alarm
        self.alarm = self._events.alarm = alarm = self._supervisor.step(self.now_ns, inputs)
        begins = self._turns.begins(alarm.state, alarm.fault, alarm.reason)
        if begins and self._overload.worth_an_entry(before, alarm):
            self._events.state(before, alarm)
        self._count(before, alarm)
        if before is not None and self.follow is not None:
            self.follow(before.state, alarm.state)
        return alarm

    def _count(self, before: AlarmState | None, alarm: AlarmState) -> None:
        """Counts the hazards that are new; one that rises from warning to halt counts once."""
        known = () if before is None else (before.fault, *before.notices)
        for hazard in dict.fromkeys((alarm.fault, *alarm.notices)):
            if hazard is not None and hazard not in known:
                self.alarms[hazard] += 1


def supervisor_after(latch: Latch | None, durations: Durations) -> Supervisor:
    """Returns the supervisor in the state that the last run left latched, HALT where this version does not know it."""
    if latch is None:
        return Supervisor(durations)
    state = next((state for state in LATCHED if state.value == latch.state), State.HALT)
    fault = Fault(latch.fault) if latch.fault in HAZARDS else None
    return Supervisor(durations, state, fault)
