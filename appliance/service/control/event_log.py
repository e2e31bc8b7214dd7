"""Writes the service's events to the alarm log, which keeps them, and to the journal."""

from typing import Any

from probewatch.appliance.service.control.status import reference_fields
from probewatch.appliance.service.host.log import get_log
from probewatch.appliance.service.host.recorder import Recorder
from probewatch.appliance.storage.alarm_chain import Event, Latch
from probewatch.appliance.storage.reference import Reference
from probewatch.appliance.types import AlarmState


class EventLog:
    """Writes events. `simulated` lists the URLs of sources that are not real devices; every state and reference entry
    contains them.

    `alarm` is the current alarm, None before the first; its latched state is part of every entry.
    """

    def __init__(self, recorder: Recorder, simulated: tuple[str, ...]) -> None:
        self.alarm: AlarmState | None = None
        self._recorder = recorder
        self._simulated = {"simulated": [*simulated]} if simulated else {}
        self._noted_reference: int | None = None
        self._noted_overdue = ""
        self._log = get_log()

    def note(self, event: Event, **data: Any) -> None:
        """Writes an entry to the alarm log only."""
        self._recorder.note(event, self._latch(), **data)

    def started(self, current: Reference | None, origin: dict[str, Any]) -> None:
        """Records the start. `origin` says what the verdicts rest on, including the `current` reference."""
        self._noted_reference = None if current is None else current.entry.number
        self.note(Event.STARTED, found=[*self._recorder.damage], **origin)
        self._log.info("started", **origin)

    def state(self, before: AlarmState | None, alarm: AlarmState) -> None:
        """Records an entry of the timeline; the journal gets changes of state only."""
        said = {"state": alarm.state.value, "fault": alarm.fault, "reason": alarm.reason, **self._simulated}
        if before is None or before.state is not alarm.state:
            self._log.info("state", **said)
        self.note(Event.STATE, **said)

    def reference(self, reference: Reference) -> None:
        """Records that a reference has come into force, unless the start entry already named it."""
        if reference.entry.number == self._noted_reference:
            return
        self._noted_reference = reference.entry.number
        said = {"reference": reference_fields(reference), **self._simulated}
        self._log.info("reference", **said)
        self.note(Event.REFERENCE, **said)

    def overdue(self, why: str) -> None:
        """Records which date of the reference has passed; `why` is empty while none has. Each date is recorded once."""
        if why == self._noted_overdue:
            return
        self._noted_overdue = why
        self._log.warning("calibration date", overdue=why or None)
        self.note(Event.OVERDUE, overdue=why or None)

    def _latch(self) -> Latch | None:
        if self.alarm is None:
            return self._recorder.latch
        latched = self.alarm.latched
        return None if latched is None else Latch(latched.value, self.alarm.latched_fault)
