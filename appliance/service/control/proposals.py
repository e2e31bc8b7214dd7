"""Keeps the proposals and undecided faults that motion shows, for a person who comes later and for the alarm log."""

from collections.abc import Sequence
from typing import Any

from probewatch.appliance.core.quality.proposal import Proposal, proposal_fields, propose
from probewatch.appliance.service.control.event_log import EventLog
from probewatch.appliance.storage.alarm_chain import Event
from probewatch.appliance.storage.image_to_probe import image_to_probe
from probewatch.appliance.storage.reference import Reference
from probewatch.appliance.supervision.languages import translated_text
from probewatch.appliance.types import AlarmState, State, Verdict


class Proposals:
    """Keeps proposals. `current` is the latest one since the calibration was last verified under the present reference;
    None without one. Each proposal, and each undecided choice between the same classes, is logged once in the alarm
    log.
    """

    def __init__(self, events: EventLog) -> None:
        self.current: Proposal | None = None
        self._events = events
        self._reference: int | None = None
        self._seen: Verdict | None = None
        self._noted: set[tuple[str, ...]] = set()

    def step(self, alarm: AlarmState, verdict: Verdict | None, reference: Reference | None, latency_ms: float) -> None:
        """Takes the proposal and choice of this tick. `latency_ms` is the value stated in the tracker's URL."""
        number = None if reference is None else reference.entry.number
        if alarm.state is State.MONITORING or number != self._reference:
            self.current, self._reference = None, number
            self._noted.clear()
        if verdict is None or verdict is self._seen or reference is None:
            return
        self._seen = verdict
        found = propose(verdict.checks, reference.calibration, latency_ms)
        if found is not None:
            self.current = found
            self._note(Event.PROPOSAL, found.about, **proposal_fields(found))
        if verdict.rivals:
            names = sorted(rival.check.name for rival in verdict.rivals)
            self._note(Event.UNDECIDED, names, text=verdict.reason, names=names)

    @property
    def beyond_url(self) -> bool:
        """Returns `Proposal.is_beyond_url` of the present one."""
        return self.current is not None and self.current.is_beyond_url

    def fields(self, language: str) -> dict[str, Any] | None:
        """Returns the proposal for JSON, with its text in the language of the room."""
        proposal = self.current
        if proposal is None:
            return None
        X = proposal.calibration
        return {
            **proposal_fields(proposal),
            "text": translated_text(proposal.text, language),
            "image_to_probe": None if X is None else image_to_probe(X).tolist(),
        }

    def _note(self, event: Event, about: Sequence[str], **data: Any) -> None:
        if (event, *about) not in self._noted:
            self._noted.add((event, *about))
            self._events.note(event, **data)
