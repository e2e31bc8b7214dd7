"""The page of a period."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path

from appliance.core.quality.trend import Trend
from appliance.storage.reference_dates import Dates
from appliance.types import State
from drivers.printable import LONGEST_TEXT, printable
from tools.report.page import section, table, text, write_page
from tools.report.period import OFF, Alarm, InForce, Summary, per_fault, share
from tools.report.svg import Plot
from tools.shared.trend_table import HEADINGS, references_of, row_of, trends

_MOST_ALARMS = 200
"""Listed one by one; the rest is counted and in the log."""
_LEAST_SHARE = 0.001
"""Share of the time: the least that one decimal of a per cent shows."""
_MINUTES_FROM_S, _HOURS_FROM_S = 120, 2 * 3600
"""From which duration on minutes and hours tell it well enough, s."""
_MOST_DAMAGES = 5
"""Listed one by one, at the top; `probewatch log --verify` lists all."""
_AXIS = {
    "day": "hour of the day, UTC",
    "week": "day of the week, 1 is Monday",
    "month": "day of the month",
}
"""Period → what stands under its plots."""
_EDGE = 0.1
"""Left free on either side of a bar, of its width."""
_SEEN = 1.0
"""Least height of a bar, %: the service ran, and verified nothing; without any it did not run."""
_STACK = (
    (State.MONITORING.value, "good"),
    (State.NOT_VERIFIED.value, "wait"),
    (State.WARNING.value, "warn"),
    (State.HALT.value, "bad"),
    (State.RECALIBRATION_REQUESTED.value, "bad"),
    (State.DEVICE_LOST.value, "bad"),
    (State.INTERNAL_FAULT.value, "bad"),
)


def write_period_page(
    path: Path, cart: str, found: Summary, dates: Dates | None, test_faults: Sequence[str], chosen: str
) -> None:
    """Writes the page of a period. dates: of the calibration in force, None without one. test_faults: of the records of
    self-tests. chosen: which period it is of, and why.

    Raises ConfigurationError where it cannot be written.
    """
    title = f"{cart}: {found.period.name}{' so far' if found.so_far else ''}"
    parts = [
        "<h1>probewatch report</h1>",
        text(("SIMULATED · " if found.simulated else "") + title, "verdict"),
        *_warnings(found, dates, test_faults),
        text(
            f"{chosen}. From {_minute(found.period.start)} until {_minute(found.until)} UTC, by the alarm log of this "
            f"cart; made {_minute(found.made)} UTC. probewatch is not a certified medical device.",
            "note",
        ),
        section("Verification", _verification(found)),
        section("Alarms", _alarms(found)),
        section("Calibrations", _references(found, dates)),
        section("Trend", _trend(found)),
        section("Self-tests", _self_tests(found)),
        section("Software and limits", _software(found)),
        section("The log itself", _log(found)),
        section("Read by", text("Name ____________________  Date ____________  Signature ____________________")),
    ]
    write_page(path, f"probewatch: {title}", parts)


def _warnings(found: Summary, dates: Dates | None, test_faults: Sequence[str]) -> list[str]:
    """What a reader must know before the figures: they stand above them."""
    told = []
    if found.damages:
        what = "The alarm log is DAMAGED: entries are missing, were changed or put in; what follows may be false"
        told.append(text(f"{what}. {_first(found.damages)}. See: probewatch log --verify.", "bad"))
    if found.chains:
        told.append(text(f"The chain of the alarm log was begun again {_times(found.chains)} in this period.", "bad"))
    if found.store_fault:
        what = "The store of references is DAMAGED, so what was in force is not known"
        told.append(text(f"{what}: {found.store_fault}.", "bad"))
    if overdue := "" if dates is None else dates.overdue(found.made):
        told.append(text(f"The check of the calibration in force is OVERDUE: {overdue}.", "bad"))
    if test_faults:
        told.append(text(f"Records of self-tests are not as they were kept: {_first(test_faults)}.", "bad"))
    if found.overloads:
        told.append(text(_overloaded(found), "warn"))
    if found.so_far:
        told.append(text(f"The {found.period.kind} is not over: this is what happened so far.", "warn"))
    return told


def _overloaded(found: Summary) -> str:
    """What is not known because the log has no entry for each change of a time of overload."""
    long = _duration(sum(one.lasted_s for one in found.overloads))
    unlogged = sum(one.unlogged or 0 for one in found.overloads)
    is_counted = all(one.unlogged is not None for one in found.overloads)
    told = f"This computer was overloaded {_times(len(found.overloads))}, for {long} in all."
    if is_counted and not unlogged:
        return f"{told} Each change of the state has its own entry all the same."
    least = "" if is_counted else "at least "
    changes = "1 change of the state has no entry of its own"
    if unlogged != 1:
        changes = f"{unlogged} changes of the state have no entry of their own"
    if not unlogged:
        least, changes = "", "changes of the state may have no entry of their own"
    return f"{told} Meanwhile {least}{changes}: times in each state and of each fault are known only in part."


def _times(number: int) -> str:
    return "once" if number == 1 else f"{number} times"


def _first(faults: Sequence[str]) -> str:
    more = len(faults) - _MOST_DAMAGES
    return "; ".join(faults[:_MOST_DAMAGES]) + (f"; and {more} more" if more > 0 else "")


def _minute(at: datetime) -> str:
    return f"{at:%Y-%m-%d %H:%M}"


def _utc_minute(said: str) -> str:
    """said: ISO 8601."""
    return _minute(datetime.fromisoformat(said).astimezone(UTC))


def _good(found: Summary) -> str:
    """Returns the class of a good figure; none where the log is damaged, because its figures prove nothing."""
    return "" if found.damages or found.chains else "good"


def _percent(value: float) -> str:
    """A little of a state, as of a halt, is not none of it."""
    if not isfinite(value):
        return "–"
    return "< 0.1 %" if 0 < value < _LEAST_SHARE else f"{100 * value:.1f} %"


def _duration(seconds: float) -> str:
    """Duration in the unit that a person would take."""
    if seconds < _MINUTES_FROM_S:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < _HOURS_FROM_S else _hours(seconds)


def _hours(seconds: float) -> str:
    return f"{seconds / 3600:.1f} h"


def _verification(found: Summary) -> str:
    by_hours = found.period.kind == "day"
    unit, per_unit_s, most, what = ("min", 60, 60, "hour by hour") if by_hours else ("h", 3600, 24, "day by day")
    axis = _AXIS[found.period.kind]
    across = (0.0, len(found.by_part)) if by_hours else (0.5, len(found.by_part) + 0.5)
    plot = Plot(across, (0, most), axis, unit)
    coverage = Plot(across, (0, 100), axis, "% verified", height=150)
    for number, shares_s in enumerate(found.by_part):
        left = number + _EDGE if by_hours else number + 0.5 + _EDGE
        right, low = left + 1 - 2 * _EDGE, 0.0
        for state, kind in _STACK:
            long = shares_s[state] / per_unit_s
            if long > 0:
                plot.block(left, right, low, low + long, kind, f"{state}: {long:.1f} {unit}")
                low += long
        verified = 100 * share(shares_s)
        if isfinite(verified):
            coverage.block(left, right, 0, max(verified, _SEEN), "a", f"{verified:.1f} % verified")
    rows = [
        (state, _duration(seconds), "" if state == OFF else _percent(seconds / found.on_s))
        for state, seconds in sorted(found.shares_s.items(), key=lambda share_s: -share_s[1])
    ]
    told = f"the calibration was verified in {_percent(found.verified)} of it"
    if not found.on_s:
        return text("The service did not run: of this cart nothing was verified.", "bad")
    return (
        text(f"The service ran for {_duration(found.on_s)}; {told}.")
        + plot.svg(f"time in each state, {what}")
        + text("Green: monitoring; blue: not verified; yellow: warning; red: halt, or a device or a part lost.", "note")
        + coverage.svg(f"share of the time verified, {what}")
        + table(("state", "time", "of the time on"), rows)
    )


def _alarms(found: Summary) -> str:
    if not found.alarms:
        return text("None.", _good(found)) if found.on_s else text("None, as the service did not run.", "bad")
    rows = [(name, str(number), _duration(seconds)) for name, number, seconds in per_fault(found.alarms)]
    shown = found.alarms[:_MOST_ALARMS]
    each = [
        (f"{alarm.begun:%Y-%m-%d %H:%M:%S}", _lasted(alarm), alarm.worst, _faults(alarm), alarm.reason)
        for alarm in shown
    ]
    more = len(found.alarms) - len(shown)
    rest = text(f"And {more} more; probewatch log has them all.") if more else ""
    asked = ", ".join(f"{what} ({_times(number)})" for what, number in found.requests.most_common()) or "nothing"
    return (
        table(("fault", "alarms", "in all"), rows)
        + table(("begun, UTC", "lasted", "at the end", "faults", "reason at the end"), each)
        + rest
        + text(f"People asked: {asked}.")
    )


def _faults(alarm: Alarm) -> str:
    return ", then ".join(name for name, _ in alarm.named if name) or "–"


def _lasted(alarm: Alarm) -> str:
    return _duration(alarm.lasted_s) if alarm.ended else f"!{_duration(alarm.lasted_s)}, and went on"


def _references(found: Summary, dates: Dates | None) -> str:
    due = text(_due(found, dates), "bad" if dates is not None and dates.overdue(found.made) else "note")
    head = ("reference", "in force from, UTC", "until, UTC", "verified by motion", "how", "file", "SHA-256")
    none = "Not known, see the top of this report." if found.store_fault else "None was in force."
    held = table(head, map(_in_force, found.in_force)) if found.in_force else text(none, "bad")
    if not found.references:
        return held + text("By the log, none took the place of another in this period.") + due
    rows = []
    for entry in found.references:
        said = entry.data.get("reference") or {}
        by = str(said.get("who") or "–")
        rows.append(
            (
                _utc_minute(entry.utc),
                str(said.get("number")),
                str(said.get("origin")),
                by,
                str(said.get("difference") or "–"),
            )
        )
    return held + table(("UTC", "reference", "how", "by", "difference to the one before"), rows) + due


def _trend(found: Summary) -> str:
    """Drift under the reference that the last estimate is of, by all its estimates until the end of the period."""
    number = next(reversed(references_of(found.estimates)), None)
    if number is None:
        return text("The service has noted no estimates: it does so every five minutes while it is verified.")
    drifts = trends(found.estimates, number)
    rows = [(*cells[:-1], f"{'!' * (one.moving or one.near)}{cells[-1]}") for cells, one in _drifts(drifts)]
    return text(f"Of reference {number}, until the end of the period.", "note") + table(HEADINGS, rows)


def _drifts(drifts: Mapping[str, Trend]) -> list[tuple[tuple[str, ...], Trend]]:
    return [(row_of(name, one), one) for name, one in drifts.items()]


def _due(found: Summary, dates: Dates | None) -> str:
    """Dates of the calibration that is in force when the report is made."""
    if found.store_fault:
        return "When the calibration is to be checked again is not known."
    if dates is None:
        return "No calibration is in force, so none is to be checked."
    if overdue := dates.overdue(found.made):
        return f"The next check of the calibration in force is overdue: {overdue}."
    ends = [f"{what} {_minute(at)} UTC" for what, at in (("due", dates.due), ("expires", dates.expires)) if at]
    return f"Next check of the calibration in force: {', '.join(ends) or 'no date is set'}."


def _in_force(one: InForce) -> tuple[str, ...]:
    reference = one.reference
    until = "still in force" if one.until is None else _minute(one.until)
    shown = "!never" if reference.verified_utc is None else _utc_minute(reference.verified_utc)
    since = _utc_minute(reference.utc)
    sha256 = f"{reference.sha256[:12]}…"
    return str(reference.number), since, until, shown, reference.origin, Path(reference.file).name, sha256


def _self_tests(found: Summary) -> str:
    if not found.self_tests:
        return text("None.", "bad")
    rows = []
    for test in found.self_tests:
        red = [str(item.get("name")) for item in test["items"] if not item.get("green")]
        passed = "+passed" if test.get("passed") else "!failed"
        rows.append(
            (
                _utc_minute(str(test["utc"])),
                passed,
                printable(str(test.get("operator") or "–")),
                printable(", ".join(red), LONGEST_TEXT) or "–",
            )
        )
    return table(("UTC", "result", "by", "red"), rows)


def _software(found: Summary) -> str:
    rows = [(_utc_minute(utc), said) for utc, said in found.software] or [("–", "the service was not started")]
    started = f"Started {_times(found.starts)}." if found.starts else "Not started in this period."
    limits = [(_utc_minute(utc), said.removeprefix("limits: ")) for utc, said in found.limits]
    held = table(("from, UTC", "limits of an OK"), limits) if limits else ""
    return table(("from, UTC", "version"), rows) + held + text(started)


def _log(found: Summary) -> str:
    if found.damages:
        return text("The chain is NOT whole, see the top of this report.", "bad")
    torn = "".join(text(f"A write that a loss of power tore, no damage: {one}.", "note") for one in found.torn)
    if not found.starts and not found.on_s:
        return text("Nothing was logged in this period.", "bad") + torn
    begun = f"; it was begun again {_times(found.chains)}" if found.chains else ""
    return text(f"The chain of the alarm log is whole{begun}.", _good(found) or "bad") + torn
