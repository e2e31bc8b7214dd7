"""Notes in the alarm log, every few minutes, what motion showed of the calibration: what a trend is made of."""

from appliance.core.quality.check_fields import number_or_none
from appliance.service.control.event_log import EventLog
from appliance.storage.alarm_chain import Event
from appliance.storage.reference import Reference
from appliance.types import PARAMETERS, AlarmState, Check, State, Verdict

_EVERY_NS = 300_000_000_000
"""Between two entries while the calibration is verified. Windows of 30 s apart are independent; a day of eight hours
makes 96 of the 40,000 entries that the log keeps. Longer sees a change later."""
_SETTLED_NS = 30_000_000_000
"""How long the contact must be closed before an entry: the longest window, which then holds verified motion alone.
Longer leaves out short examinations."""


class EstimateNotes:
    """One entry at a time: {"reference": number in the history, "checks": {name: [value, sigma, limit]}}."""

    def __init__(self, events: EventLog) -> None:
        self._events = events
        self._noted_ns: int | None = None

    def step(self, now_ns: int, alarm: AlarmState, verdict: Verdict | None, reference: Reference | None) -> None:
        """Take what is in force at this tick."""
        settled = alarm.state is State.MONITORING and now_ns - alarm.since_ns >= _SETTLED_NS
        if not settled or verdict is None or reference is None:
            return
        if self._noted_ns is not None and now_ns - self._noted_ns < _EVERY_NS:
            return
        self._noted_ns = now_ns
        checks = {check.name: _figures(check) for check in verdict.checks if check.name in (*PARAMETERS, "latency")}
        known = {name: three for name, three in checks.items() if three is not None}
        self._events.note(Event.ESTIMATE, reference=reference.entry.number, checks=known)


def _figures(check: Check) -> list[float] | None:
    """What was not seen has no value and is left out."""
    value, sigma = number_or_none(check.value), number_or_none(check.sigma)
    return None if value is None or sigma is None else [round(value, 4), round(sigma, 4), check.limit]
