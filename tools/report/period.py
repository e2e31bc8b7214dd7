"""Summarises what happened on a cart in a day, week or month, by its alarm log, its references and its self-tests."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

from probewatch.appliance.storage.alarm_chain import Entry, Event, Reading
from probewatch.appliance.storage.reference_store import Entry as Reference
from probewatch.appliance.supervision.alarms import SIGNALS, Priority
from probewatch.appliance.types import State
from probewatch.tools.shared.profile_text import logged_limits_text

PERIODS = ("day", "week", "month")
Shares = defaultdict[str, float]
"""State → seconds."""
OFF = "off"
"""Name in place of a state while the service did not run."""
_HAS_LIMITS = (Event.STARTED, Event.RELOADED)
_ALARMS = {state.value for state, signal in SIGNALS.items() if signal.priority in (Priority.HIGH, Priority.MEDIUM)}


@dataclass(frozen=True, slots=True)
class Period:
    """Represents a period from start until before end, UTC. kind: one of PERIODS. name: such as 2026-10."""

    kind: str
    name: str
    start: datetime
    end: datetime

    @property
    def part(self) -> timedelta:
        """Returns the length of the parts that are drawn separately: hours of a day, days of a longer period."""
        return timedelta(hours=1) if self.kind == "day" else timedelta(days=1)

    @property
    def parts(self) -> int:
        """Returns the number of parts."""
        return (self.end - self.start) // self.part


def period(kind: str, day: datetime) -> Period:
    """Returns the day, week (from Monday on) or month that contains the day."""
    start = day.astimezone(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
    if kind == "day":
        return Period(kind, f"{start:%Y-%m-%d}", start, start + timedelta(days=1))
    if kind == "week":
        start -= timedelta(days=start.weekday())
        return Period(kind, f"{start:%G-W%V}", start, start + timedelta(days=7))
    start = start.replace(day=1)
    return Period(kind, f"{start:%Y-%m}", start, (start + timedelta(days=31)).replace(day=1))


def last_period(kind: str, now: datetime) -> Period:
    """Returns the last period that is over."""
    return period(kind, period(kind, now).start - timedelta(hours=1))


@dataclass(frozen=True, slots=True)
class Alarm:
    """Represents one time of alarm, from the first state that is one to the first that is none. worst: the last of
    these states; fault, reason: those of that state. named: (fault, seconds) of all that were named meanwhile, in their
    order. ended: False where it went on when the period ended, or when the report was made.
    """

    begun: datetime
    lasted_s: float
    worst: str
    fault: str
    reason: str
    ended: bool
    named: tuple[tuple[str, float], ...]


@dataclass(frozen=True, slots=True)
class Overload:
    """Represents a time in which this computer was overloaded. unlogged: number of changes of the state that have no
    entry of their own, so what was in force then is known only in part; None while it lasts.
    """

    begun: datetime
    lasted_s: float
    unlogged: int | None


@dataclass(frozen=True, slots=True)
class InForce:
    """Represents a reference, and when the next one took its place; None: it is still in force."""

    reference: Reference
    until: datetime | None


@dataclass
class Summary:
    """Holds what a report states. made: when it was made. shares_s: state → seconds. by_part: the same for each day, of
    a day for each hour, in order. requests: what was requested, how often.

    software: (UTC, the version in force from then on). limits: entries of the log, each with the limits in force from
    then on.

    in_force: references that were in force at some time of the period, by the store, oldest first; the first one of a
    cart comes into force without an entry in the log. begins: time of the first entry of the log, None without one.
    damages: those of the whole log, in words; torn: writes that a power cut tore; chains: how often the chain was begun
    again. self_tests: as they were kept, oldest first. estimates: what motion showed of the calibration until the end.
    store_fault: why nothing is known of the references; empty where they are known.
    """

    period: Period
    made: datetime
    shares_s: Shares = field(default_factory=lambda: defaultdict(float))
    by_part: list[Shares] = field(default_factory=list)
    alarms: list[Alarm] = field(default_factory=list)
    overloads: list[Overload] = field(default_factory=list)
    estimates: list[Entry] = field(default_factory=list)
    requests: Counter[str] = field(default_factory=Counter)
    references: list[Entry] = field(default_factory=list)
    in_force: list[InForce] = field(default_factory=list)
    software: list[tuple[str, str]] = field(default_factory=list)
    limits: list[Entry] = field(default_factory=list)
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
        """Returns whether the period was not over when the report was made."""
        return self.made < self.period.end

    @property
    def until(self) -> datetime:
        """Returns the end of the time that is reported."""
        return min(self.period.end, self.made)

    @property
    def on_s(self) -> float:
        """Returns the seconds in which the service ran."""
        return sum(seconds for state, seconds in self.shares_s.items() if state != OFF)

    @property
    def verified(self) -> float:
        """Returns the share of that time in which the calibration was verified; NaN where the service never ran."""
        return share(self.shares_s)


def share(shares_s: Shares) -> float:
    """Returns the share of MONITORING in the time in which the service ran."""
    on_s = sum(seconds for state, seconds in shares_s.items() if state != OFF)
    return shares_s[State.MONITORING.value] / on_s if on_s > 0 else float("nan")


def summary(
    wanted: Period,
    reading: Reading,
    self_tests: Iterable[dict[str, Any]],
    now: datetime,
    history: Sequence[Reference] = (),
) -> Summary:
    """Sums up the period. now: the present; what lies after it is not counted."""
    found = Summary(wanted, now, by_part=[defaultdict(float) for _ in range(wanted.parts)])
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
            found.limits = [entry]
        elif wanted.start <= at < end:
            _note(found, entry)
    found.overloads = [one for one in _overloads(reading.entries, end) if _meets(one, wanted.start, end)]
    found.estimates = [entry for entry in reading.entries if entry.event == Event.ESTIMATE and _time(entry) < end]
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
    """Returns whether it lies within, also where it had begun before."""
    ends = alarm.begun + timedelta(seconds=alarm.lasted_s)
    return alarm.begun < end and (alarm.begun >= start or ends > start)


def _meets(one: Overload, start: datetime, end: datetime) -> bool:
    return one.begun < end and one.begun + timedelta(seconds=one.lasted_s) >= start


def _overloads(entries: Sequence[Entry], end: datetime) -> Iterator[Overload]:
    """Yields the overloads in the log; the last one lasts until `end` where nothing ended it."""
    begun: datetime | None = None
    for entry in entries:
        if entry.event == Event.OVERLOADED:
            begun = begun or _time(entry)
        elif entry.event in (Event.OVERLOAD_ENDED, Event.STOPPED, Event.STARTED) and begun is not None:
            repeated = entry.data.get("repeated")
            times = repeated.values() if isinstance(repeated, dict) else ()
            unlogged = sum(number for number in times if isinstance(number, int))
            told = unlogged if entry.event == Event.OVERLOAD_ENDED else None
            yield Overload(begun, max((_time(entry) - begun).total_seconds(), 0.0), told)
            begun = None
    if begun is not None and begun < end:
        yield Overload(begun, (end - begun).total_seconds(), None)


_Spell = tuple[datetime, datetime, Entry | None]
"""From, until, the entry of the state in force; None while the service did not run."""


def _spells(entries: Sequence[Entry], end: datetime) -> Iterator[_Spell]:
    """Yields spells by the wall clock, which may have been set: one that would end before it begins has no length."""
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
        part = (from_ - found.period.start) // found.period.part
        here = min(until, found.period.start + (part + 1) * found.period.part)
        seconds = (here - from_).total_seconds()
        found.shares_s[state] += seconds
        found.by_part[part][state] += seconds
        from_ = here


def _alarms(spells: Sequence[_Spell]) -> Iterator[Alarm]:
    within: list[tuple[datetime, datetime, Entry]] = []
    for from_, until, entry in spells:
        if entry is not None and entry.data.get("state") in _ALARMS:
            within.append((from_, until, entry))
        elif within:
            yield _alarm(within, from_, True)
            within = []
    if within:
        yield _alarm(within, spells[-1][1], False)


def _alarm(within: Sequence[tuple[datetime, datetime, Entry]], until: datetime, ended: bool) -> Alarm:
    begun, last = within[0][0], within[-1][2]
    named: dict[str, float] = {}
    for from_, to, entry in within:
        fault = str(entry.data.get("fault") or "")
        named[fault] = named.get(fault, 0.0) + (to - from_).total_seconds()
    state, fault, reason = (str(last.data.get(name) or "") for name in ("state", "fault", "reason"))
    return Alarm(begun, (until - begun).total_seconds(), state, fault, reason, ended, tuple(named.items()))


def _note(found: Summary, entry: Entry) -> None:
    found.simulated = found.simulated or bool(entry.data.get("simulated"))
    if entry.event in _HAS_LIMITS and (not found.limits or limits_text(found.limits[-1]) != limits_text(entry)):
        found.limits.append(entry)
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


def limits_text(entry: Entry, language: str = "en") -> str:
    """Returns the limits as the entry has them; empty for those of earlier versions, which have none."""
    return logged_limits_text(entry.data, language).partition(": ")[2]


def _time(entry: Entry) -> datetime:
    return _utc(entry.utc)


def _utc(said: str) -> datetime:
    return datetime.fromisoformat(said).astimezone(UTC)


def per_fault(alarms: Iterable[Alarm]) -> list[tuple[str, int, float]]:
    """Returns (fault, in how many alarms, seconds in all), most often first; one alarm may have several in turn."""
    times: dict[str, list[float]] = defaultdict(list)
    for alarm in alarms:
        for name, lasted_s in alarm.named:
            times[name or "–"].append(lasted_s)
    return sorted(((name, len(all_s), sum(all_s)) for name, all_s in times.items()), key=lambda row: -row[1])
