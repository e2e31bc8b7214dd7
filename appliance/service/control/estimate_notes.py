"""Writes to the alarm log, every few minutes, what motion showed of the calibration; trends are computed from this."""

from collections import defaultdict
from dataclasses import dataclass, field

from probewatch.appliance.core.parameters import MEASURED, QUANTITIES, class_of
from probewatch.appliance.core.quality.accumulation import pooled
from probewatch.appliance.core.quality.check_fields import number_or_none
from probewatch.appliance.service.control.event_log import EventLog
from probewatch.appliance.storage.alarm_chain import Event
from probewatch.appliance.storage.reference import Reference
from probewatch.appliance.types import AlarmState, Check, State, Verdict

_EVERY_NS = 300_000_000_000
"""ns, the time between two entries while the calibration is verified. A day of eight hours makes 96 of the 40,000
entries that the log keeps. A longer one shows a change later.
"""
_LONGEST_NS = 30_000_000_000
"""ns, the longest window. The contact must be closed for as long before a window counts, so that it holds verified
motion alone, and two windows this far apart share no motion. A longer one leaves out short examinations.
"""
_SAME_CALIBRATION = frozenset({State.MONITORING, State.NOT_VERIFIED})
"""States across which windows are averaged; in any other the calibration may have changed."""


@dataclass(slots=True)
class _Windows:
    """Holds the windows of one parameter since the last entry.

    shown_ns: that of the latest window, as in Check; an entry does not reset it.
    """

    values: list[float] = field(default_factory=list)
    sigmas: list[float] = field(default_factory=list)
    limit: float = 0.0
    shown_ns: int | None = None

    def take(self, check: Check) -> None:
        """Adds the window of a check, unless it shares motion with the latest one."""
        value, sigma = number_or_none(check.value), number_or_none(check.sigma)
        if value is None or sigma is None or check.shown_ns is None:
            return
        if self.shown_ns is None or check.shown_ns - self.shown_ns >= _LONGEST_NS:
            self.values.append(value)
            self.sigmas.append(sigma)
            self.limit, self.shown_ns = check.limit, check.shown_ns


class EstimateNotes:
    """Collects windows and writes entries: {"reference": number in the history, "checks": {name: [value, sigma,
    limit]}, "windows": {name: number averaged}}.
    """

    def __init__(self, events: EventLog) -> None:
        self._events = events
        self._noted_ns: int | None = None
        self._number: int | None = None
        self._windows = defaultdict[str, _Windows](_Windows)

    def step(self, now_ns: int, alarm: AlarmState, verdict: Verdict | None, reference: Reference | None) -> None:
        """Takes the windows that are in force at this tick."""
        number = None if reference is None else reference.entry.number
        if alarm.state not in _SAME_CALIBRATION or number != self._number:
            self._windows.clear()
            self._number = number
        settled = alarm.state is State.MONITORING and now_ns - alarm.since_ns >= _LONGEST_NS
        if not settled or verdict is None or number is None:
            return
        for check in verdict.checks:
            if check.name in MEASURED:
                self._windows[check.name].take(check)
        if self._noted_ns is None or now_ns - self._noted_ns >= _EVERY_NS:
            self._note(now_ns, number)

    def _note(self, now_ns: int, number: int) -> None:
        """Writes an entry of the windows since the last entry, if there are any."""
        known = {name: one for name, one in self._windows.items() if one.values}
        if not known:
            return
        self._noted_ns = now_ns
        counts = {name: len(one.values) for name, one in known.items()}
        self._events.note(
            Event.ESTIMATE, reference=number, checks={name: _figures(name, one) for name, one in known.items()},
            windows=counts,
        )  # fmt: skip
        for one in known.values():
            one.values, one.sigmas = [], []


def _figures(name: str, windows: _Windows) -> list[float]:
    value, sigma = pooled(windows.values, windows.sigmas, QUANTITIES[class_of(name)].left_out)
    return [round(value, 4), round(sigma, 4), windows.limit]
