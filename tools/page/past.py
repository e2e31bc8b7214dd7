"""Derives the past from the alarm log: the last alarms, and the states of the last hour. Pure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

from probewatch.appliance.storage.alarm_chain import Entry, Event
from probewatch.appliance.supervision.alarms import SIGNALS, Priority
from probewatch.appliance.types import State
from probewatch.drivers.printable import printable

HOUR_S = 3600.0
"""Past that the page shows, s. More makes short alarms too thin to be seen. Not varied."""
_LAST = 12
"""Alarms listed: as many as fit on a tablet beside everything else."""
UNKNOWN = "unknown"
"""Lamp of a time in which no service ran, or of which nothing is known."""
_ALARMS = (Priority.HIGH, Priority.MEDIUM)


@dataclass(frozen=True, slots=True)
class Stretch:
    """Represents a time in one state. from_s: wall clock, s since 1970. lamp: one of Lamp, or UNKNOWN."""

    from_s: float
    lamp: str
    state: str
    reason: str
    alarm: bool

    def fields(self) -> dict[str, Any]:
        """Returns the fields, ready for JSON."""
        said = {"lamp": self.lamp, "state": printable(self.state), "reason": printable(self.reason)}
        return {"from_s": self.from_s, **said, "alarm": self.alarm}


def _unknown(from_s: float) -> Stretch:
    """Returns a time in which no service ran, or of which the log states nothing."""
    return Stretch(from_s, UNKNOWN, "", "", alarm=False)


def last_states(entries: Sequence[Entry]) -> list[dict[str, str]]:
    """Returns the last states, the newest first, in the cart's own time."""
    states = [entry for entry in entries if entry.event == Event.STATE]
    return [
        {"time": _local(entry.utc), "state": _said(entry, "state"), "reason": _said(entry, "reason")}
        for entry in reversed(states[-_LAST:])
    ]


def hour(entries: Sequence[Entry], now_s: float) -> list[dict[str, Any]]:
    """Returns each stretch of the hour before now_s, the oldest first; the first began before it, the last goes on.

    Where the wall clock was set back, what came before counts as no later than what came after.
    """
    known = [_unknown(0.0), *_stretches(entries)]
    ordered: list[Stretch] = []
    latest_s = now_s
    for stretch in reversed(known):
        latest_s = min(latest_s, stretch.from_s)
        ordered.append(replace(stretch, from_s=latest_s))
        if latest_s <= now_s - HOUR_S:
            break
    return [stretch.fields() for stretch in reversed(ordered)]


def _stretches(entries: Sequence[Entry]) -> Iterator[Stretch]:
    """Yields the stretches; after a service that did not log its stop, nothing is known from its last entry on."""
    before: Entry | None = None
    for entry in entries:
        if entry.event == Event.STARTED and before is not None and before.event != Event.STOPPED:
            yield _unknown(_seconds(before.utc))
        if entry.event == Event.STATE:
            yield _stretch(entry)
        elif entry.event == Event.STOPPED:
            yield _unknown(_seconds(entry.utc))
        if entry.event != Event.CHAIN_BEGUN:  # an entry of the service that starts
            before = entry


def _stretch(entry: Entry) -> Stretch:
    """Returns the stretch that an entry begins. One of a state that this version does not know has no lamp."""
    said = _said(entry, "state")
    signal = SIGNALS[State(said)] if said in (state.value for state in State) else None
    lamp = UNKNOWN if signal is None else signal.lamp.value
    alarm = signal is not None and signal.priority in _ALARMS
    return Stretch(_seconds(entry.utc), lamp, said, _said(entry, "reason"), alarm)


def _seconds(utc: str) -> float:
    return _moment(utc).timestamp()


def _local(utc: str) -> str:
    return _moment(utc).astimezone().isoformat(timespec="seconds")


def _moment(utc: str) -> datetime:
    """Returns the moment; 1970 where the text is none, as in a damaged entry."""
    try:
        return datetime.fromisoformat(utc)
    except ValueError:
        return datetime.fromtimestamp(0).astimezone()


def _said(entry: Entry, name: str) -> str:
    return printable(str(entry.data.get(name, "")))
