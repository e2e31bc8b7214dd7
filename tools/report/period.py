"""What happened on a cart in a day, week or month, by its alarm log, its references and its self-tests."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

from appliance.storage.alarm_chain import Entry, Event, Reading
from appliance.storage.reference_store import Entry as Reference
from appliance.supervision.alarms import SIGNALS, Priority
from appliance.types import State
from tools.shared.profile_text import logged_limits_text

PERIODS = ("day", "week", "month")
Shares = defaultdict[str, float]
"""State → seconds."""
OFF = "off"
"""In place of a state while the service did not run."""
_HAS_LIMITS = (Event.STARTED, Event.RELOADED)
_ALARMS = {state.value for state, signal in SIGNALS.items() if signal.priority in (Priority.HIGH, Priority.MEDIUM)}


@dataclass(frozen=True, slots=True)
class Period:
    """A period from start until before end, UTC. kind: one of PERIODS. name: such as 2026-10."""

    kind: str
    name: str
    start: datetime
    end: datetime

    @property
    def days(self) -> list[datetime]:
        """The beginning of each."""
        return [self.start + timedelta(days=number) for number in range((self.end - self.start).days)]


def period(kind: str, day: datetime) -> Period:
    """The day, week (from Monday on) or month that the day lies in."""
    start = day.astimezone(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
    if kind == "day":
        return Period(kind, f"{start:%Y-%m-%d}", start, start + timedelta(days=1))
    if kind == "week":
        start -= timedelta(days=start.weekday())
        return Period(kind, f"{start:%G-W%V}", start, start + timedelta(days=7))
    start = start.replace(day=1)
    return Period(kind, f"{start:%Y-%m}", start, (start + timedelta(days=31)).replace(day=1))


def last_period(kind: str, now: datetime) -> Period:
    """The last that is over."""
    return period(kind, period(kind, now).start - timedelta(hours=1))


@dataclass(frozen=True, slots=True)
class Alarm:
    """One time of alarm, from the first state that is one to the first that is none. worst: the last of them. ended:
    False where it went on when the period ended, or when the report was made.
    """

    begun: datetime
    lasted_s: float
    worst: str
    fault: str
    reason: str
    ended: bool


@dataclass(frozen=True, slots=True)
class InForce:
    """A reference, and when the next one took its place; None: it is still in force."""

    reference: Reference
    until: datetime | None


@dataclass
class Summary:
    """made: when the report was. shares_s: state → seconds. by_day: the same for each day, in order. requests: what was
    asked, how often.

    software, limits: (UTC, what was in force from then on).

    in_force: references that were in force at some time of it, by the store, oldest first; a cart's first one comes in
    force without a word in the log. begins: first entry of the log, None without one. damages: of the whole log, in
    words; torn: writes that a power cut tore; chains: how often it was begun again. self_tests: as they were kept,
    oldest first. store_fault: why nothing can be said of the references; empty where it can.
    """

    period: Period
    made: datetime
    shares_s: Shares = field(default_factory=lambda: defaultdict(float))
    by_day: list[Shares] = field(default_factory=list)
    alarms: list[Alarm] = field(default_factory=list)
    requests: Counter[str] = field(default_factory=Counter)
    references: list[Entry] = field(default_factory=list)
    in_force: list[InForce] = field(default_factory=list)
    software: list[tuple[str, str]] = field(default_factory=list)
    limits: list[tuple[str, str]] = field(default_factory=list)
    starts: int = 0
    begins: datetime | None = None
    damages: list[str] = field(default_factory=list)
    torn: list[str] = field(default_factory=list)
    chains: int = 0
    self_tests: list[dict[str, Any]] = field(default_factory=list)
    simulated: bool = False
    store_fault: str = ""

    @property
    def so_far(self) -> bool:
        """The period was not over when the report was made."""
        return self.made < self.period.end

    @property
    def until(self) -> datetime:
        """What is reported is of the time before it."""
        return min(self.period.end, self.made)

    @property
    def on_s(self) -> float:
        """Seconds in which the service ran."""
        return sum(seconds for state, seconds in self.shares_s.items() if state != OFF)

    @property
    def verified(self) -> float:
        """Share of that in which the calibration was verified; NaN where it never ran."""
        return share(self.shares_s)


def share(shares_s: Shares) -> float:
    """Share of MONITORING in the time in which the service ran."""
    on_s = sum(seconds for state, seconds in shares_s.items() if state != OFF)
    return shares_s[State.MONITORING.value] / on_s if on_s > 0 else float("nan")


def summary(
    wanted: Period,
    reading: Reading,
    self_tests: Iterable[dict[str, Any]],
    now: datetime,
    history: Sequence[Reference] = (),
) -> Summary:
    """now: the present; what lies after it is not counted."""
    found = Summary(wanted, now, by_day=[defaultdict(float) for _ in wanted.days])
    end = found.until
    spells = list(_spells(reading.entries, end))
    for from_, until, entry in spells:
        _count(found, entry, max(from_, wanted.start), min(until, end))
    found.alarms = [alarm for alarm in _alarms(spells) if _within(alarm, wanted.start, end)]
    for entry in reading.entries:
        at = _time(entry)
        if at < wanted.start and entry.event == Event.STARTED:
            found.software = [(entry.utc, str(entry.data.get("software", "?")))]
        if at < wanted.start and entry.event in _HAS_LIMITS:
            found.limits = [(entry.utc, _limits(entry))]
        elif wanted.start <= at < end:
            _note(found, entry)
    found.in_force = [one for one in _in_force(history) if _overlaps(one, wanted.start, end)]
    found.begins = _time(reading.entries[0]) if reading.entries else None
    found.damages = [str(damage) for damage in reading.broken]
    found.torn = [str(damage) for damage in reading.damages if damage not in reading.broken]
    found.self_tests = [
        test for test in self_tests if wanted.start <= datetime.fromisoformat(str(test["utc"])).astimezone(UTC) < end
    ]
    return found


def _in_force(history: Sequence[Reference]) -> Iterator[InForce]:
    for number, one in enumerate(history, 1):
        yield InForce(one, _utc(history[number].utc) if number < len(history) else None)


def _overlaps(one: InForce, start: datetime, end: datetime) -> bool:
    return _utc(one.reference.utc) < end and (one.until is None or one.until > start)


def _within(alarm: Alarm, start: datetime, end: datetime) -> bool:
    """Whether it lies within, also where it had begun before."""
    ends = alarm.begun + timedelta(seconds=alarm.lasted_s)
    return alarm.begun < end and (alarm.begun >= start or ends > start)


_Spell = tuple[datetime, datetime, Entry | None]
"""From, until, the entry of the state in force; None while the service did not run."""


def _spells(entries: Sequence[Entry], end: datetime) -> Iterator[_Spell]:
    """Spells by the wall clock, which may have been set: a spell that would end before it begins has no length."""
    at: datetime | None = None
    current: Entry | None = None
    for entry in entries:
        if entry.event not in (Event.STATE, Event.STOPPED, Event.STARTED):
            continue
        then = _time(entry)
        if at is not None:
            yield at, max(at, then), current
        at, current = then, entry if entry.event == Event.STATE else None
    if at is not None:
        yield at, max(at, end), current


def _count(found: Summary, entry: Entry | None, from_: datetime, until: datetime) -> None:
    state = OFF if entry is None else str(entry.data.get("state"))
    while from_ < until:
        day = (from_ - found.period.start).days
        here = min(until, found.period.start + timedelta(days=day + 1))
        seconds = (here - from_).total_seconds()
        found.shares_s[state] += seconds
        found.by_day[day][state] += seconds
        from_ = here


def _alarms(spells: Sequence[_Spell]) -> Iterator[Alarm]:
    begun: datetime | None = None
    last: Entry | None = None
    for from_, _, entry in spells:
        if entry is not None and entry.data.get("state") in _ALARMS:
            begun, last = begun or from_, entry
        elif begun is not None and last is not None:
            yield _alarm(begun, from_, last, True)
            begun = None
    if begun is not None and last is not None:
        yield _alarm(begun, spells[-1][1], last, False)


def _alarm(begun: datetime, until: datetime, last: Entry, ended: bool) -> Alarm:
    fault, reason = last.data.get("fault") or "", str(last.data.get("reason", ""))
    return Alarm(begun, (until - begun).total_seconds(), str(last.data.get("state")), str(fault), reason, ended)


def _note(found: Summary, entry: Entry) -> None:
    found.simulated = found.simulated or bool(entry.data.get("simulated"))
    if entry.event in _HAS_LIMITS and (not found.limits or found.limits[-1][1] != _limits(entry)):
        found.limits.append((entry.utc, _limits(entry)))
    if entry.event == Event.REQUEST:
        found.requests[str(entry.data.get("do"))] += 1
    elif entry.event == Event.REFERENCE:
        found.references.append(entry)
    elif entry.event == Event.STARTED:
        found.starts += 1
        said = str(entry.data.get("software", "?"))
        if not found.software or found.software[-1][1] != said:
            found.software.append((entry.utc, said))
    elif entry.event == Event.CHAIN_BEGUN:
        found.chains += entry.number > 1


def _limits(entry: Entry) -> str:
    """Limits as the entry has them; those of earlier versions have none."""
    return logged_limits_text(entry.data) or "limits: not logged by that version"


def _time(entry: Entry) -> datetime:
    return _utc(entry.utc)


def _utc(said: str) -> datetime:
    return datetime.fromisoformat(said).astimezone(UTC)


def per_fault(alarms: Iterable[Alarm]) -> list[tuple[str, int, float]]:
    """(fault, how often, seconds in all), most often first."""
    times: dict[str, list[float]] = defaultdict(list)
    for alarm in alarms:
        times[alarm.fault or "–"].append(alarm.lasted_s)
    return sorted(((name, len(all_s), sum(all_s)) for name, all_s in times.items()), key=lambda row: -row[1])
