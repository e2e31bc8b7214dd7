"""Computes the dates until which a reference holds: those that its file states, and the configuration's. Pure: the time
is an argument.

Days are of UTC and count whole: a calibration that is due on the first of May is overdue from the second on. The wall
clock is trusted as it is, whichever way it was stepped, with one exception: a clock that is a day or more before the
reference came into force is wrong, and then every date counts as passed. So does a date that cannot be read.

The configuration's days count from the day on which a file first came into force. Going back to it, or using it again,
checks nothing about it and renews nothing; a new scan makes another file.
"""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, timedelta

from probewatch.appliance.storage.calibration_file import provenance_of
from probewatch.appliance.storage.reference_store import Entry

_CLOCK_WITHIN = timedelta(days=1)
"""The time by which a corrected clock may be before the day of the reference. More lets a wrong clock hide a date for
longer; less takes a corrected clock for a wrong one.
"""


@dataclass(frozen=True, slots=True)
class Dates:
    """Holds the dates of a reference. due, expires: from when on it is; None: never. damage: a date that cannot be
    read, in words. since: when it came into force. first_use: that of its file, where due counts from it.
    """

    due: datetime | None = None
    expires: datetime | None = None
    damage: str = ""
    since: datetime | None = None
    first_use: datetime | None = None

    @property
    def due_utc(self) -> str | None:
        """Returns the due date in ISO 8601, for the status."""
        return None if self.due is None else self.due.isoformat(timespec="seconds")

    @property
    def expires_utc(self) -> str | None:
        return None if self.expires is None else self.expires.isoformat(timespec="seconds")

    def overdue(self, now: datetime) -> str:
        """Returns which date has passed, in words; empty while none has."""
        if self.damage:
            return self.damage
        passed = self._wrong_clock(now)
        if self.expires is not None and now >= self.expires:
            passed = f"it has expired since {self.expires:%Y-%m-%d %H:%M} UTC"
        elif self.due is not None and now >= self.due:
            passed = f"it is due since {self.due:%Y-%m-%d %H:%M} UTC{self._counted}"
        return passed

    def expired(self, now: datetime) -> str:
        """Returns how the reference has ended: when it expires, or is due if no expiry is stated; empty until then."""
        ends = self.due if self.expires is None else self.expires
        return self.overdue(now) if self.damage or self._wrong_clock(now) or (ends and now >= ends) else ""

    @property
    def _counted(self) -> str:
        """Returns from which day the due date counts, and the remedy if the clock was wrong then: to use the same file
        again does not help.
        """
        if self.first_use is None:
            return ""
        remedy = "if the clock was wrong then: use a changed file, or probewatch calibration reset"
        return f"; it counts from {self.first_use:%Y-%m-%d}, when its file was first used; {remedy}"

    def _wrong_clock(self, now: datetime) -> str:
        if self.since is None or (self.due is None and self.expires is None) or now >= self.since - _CLOCK_WITHIN:
            return ""
        return f"the clock says {now:%Y-%m-%d}, before it came in force on {self.since:%Y-%m-%d}: set the clock"


def dates_of(entry: Entry, history: Iterable[Entry], content: bytes, due_days: int | None) -> Dates:
    """Returns when the reference is due and expires. history: all references, in which the same file may have been in
    force before. content: of the reference's file. due_days: of the configuration. It is due on the earlier of the two
    dates.
    """
    stated = stated_dates(content)
    try:
        since = _utc(entry.utc)
        first_use = counted = None
        if due_days is not None:
            first_use = _first_use(entry, history, since)
            counted = first_use + timedelta(days=due_days)
    except (ValueError, OverflowError):
        return Dates(damage=f"it came in force at {entry.utc[:40]!r}, which no calendar has")
    due = min((one for one in (stated.due, counted) if one is not None), default=None)
    is_counted = counted is not None and due == counted
    return replace(stated, due=due, since=since, first_use=first_use if is_counted else None)


def stated_dates(content: bytes) -> Dates:
    """Returns when a file of this content is due and expires by its own statement, wherever it is in force."""
    stated = provenance_of(content)
    ends: dict[str, datetime | None] = {}
    damages = []
    for name in ("due", "expires"):
        try:
            ends[name] = _end_of(stated[name]) if name in stated else None
        except (ValueError, OverflowError):
            ends[name] = None
            damages.append(f"its '{name}' is {stated[name][:40]!r}, no day such as 2027-05-01")
    return Dates(ends["due"], ends["expires"], "; ".join(damages))


def _first_use(entry: Entry, history: Iterable[Entry], since: datetime) -> datetime:
    """Returns when the file of the entry first came into force: the earliest time, not the first in the list, which may
    have come while the clock was ahead. A time that cannot be read is skipped.
    """
    known = [since]
    for one in history:
        if one.sha256 == entry.sha256:
            with suppress(ValueError, OverflowError):
                known.append(_utc(one.utc))
    return min(known)


def _end_of(day: str) -> datetime:
    """Returns the midnight after the day."""
    return datetime.combine(date.fromisoformat(day) + timedelta(days=1), datetime.min.time(), UTC)


def _utc(text: str) -> datetime:
    moment = datetime.fromisoformat(text)
    return moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)
