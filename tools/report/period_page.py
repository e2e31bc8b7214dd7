"""Writes the page of a period."""

import html
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path

from probewatch.appliance.core.quality.trend import Trend
from probewatch.appliance.storage.reference_dates import Dates
from probewatch.appliance.supervision.faults import FAULT_ROWS
from probewatch.appliance.types import State
from probewatch.drivers.printable import LONGEST_TEXT, printable
from probewatch.tools.german.translation import Speech, damage_text, lost_text
from probewatch.tools.report.page import section, table, text, write_page
from probewatch.tools.report.period import OFF, Alarm, InForce, Summary, limits_text, per_fault, share
from probewatch.tools.report.svg import Plot
from probewatch.tools.shared.trend_table import HEADINGS, references_of, row_of, trends

_MOST_ALARMS = 200
"""Alarms listed one by one; the rest is counted and in the log."""
_LEAST_SHARE = 0.001
"""Share of the time: the least that one decimal of a per cent shows."""
_MINUTES_FROM_S, _HOURS_FROM_S = 120, 2 * 3600
"""Durations, s, from which minutes and hours are precise enough."""
_MOST_DAMAGES = 5
"""Damages listed one by one, at the top; `probewatch log --verify` lists all."""
_AXIS = {
    "day": "hour of the day, UTC",
    "week": "day of the week, 1 is Monday",
    "month": "day of the month",
}
"""Period → the label of its plots' axis."""
_EDGE = 0.1
"""Space left free on either side of a bar, as a share of its width."""
_SEEN = 1.0
"""Least height of a bar, %: the service ran, and verified nothing; without any bar it did not run."""
_FAULTS = {fault.value: row.text for fault, row in FAULT_ROWS.items()}
"""Name of a fault → what the operator reads."""
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
    path: Path,
    cart: str,
    found: Summary,
    dates: Dates | None,
    test_faults: Sequence[str],
    chosen: str,
    language: str = "en",
) -> None:
    """Writes the page of a period in the language. dates: those of the calibration in force, None without one.
    test_faults: those of the records of self-tests. chosen: which period it is of, and why, in the language.

    Raises ConfigurationError where it cannot be written.
    """
    speech = Speech(language)
    name = speech.tell("{name} so far", name=found.period.name) if found.so_far else found.period.name
    title = f"{cart}: {name}"
    start, until, made = (_minute(one) for one in (found.period.start, found.until, found.made))
    of = (
        "{chosen}. From {start} until {until} UTC, by the alarm log of this cart; made {made} UTC. "
        "probewatch is not a certified medical device."
    )
    signature = "Name ____________________  Date ____________  Signature ____________________"
    parts = [
        f"<h1>{html.escape(speech.tell('probewatch report'))}</h1>",
        text((f"{speech.tell('SIMULATED')} · " if found.simulated else "") + title, "verdict"),
        *_warnings(found, dates, test_faults, speech),
        text(speech.tell(of, chosen=chosen, start=start, until=until, made=made), "note"),
        section(speech.tell("Verification"), _verification(found, speech)),
        section(speech.tell("Alarms"), _alarms(found, speech)),
        section(speech.tell("Calibrations"), _references(found, dates, speech)),
        section(speech.tell("Trend"), _trend(found, speech)),
        section(speech.tell("Self-tests"), _self_tests(found, speech)),
        section(speech.tell("Software and limits"), _software(found, speech)),
        section(speech.tell("The log itself"), _log(found, speech)),
        section(speech.tell("Read by"), text(speech.tell(signature))),
    ]
    write_page(path, f"probewatch: {title}", parts, language)


def _warnings(found: Summary, dates: Dates | None, test_faults: Sequence[str], speech: Speech) -> list[str]:
    """Returns what a reader must know before the figures, above which it stands."""
    told, language = [], speech.language
    if found.damages:
        what = (
            "The alarm log is DAMAGED: entries are missing, were changed or put in; what follows may be false. "
            "{damages}. See: probewatch log --verify."
        )
        damages = _first([damage_text(one, language) for one in found.damages], speech)
        told.append(text(speech.tell(what, damages=damages), "bad"))
    if found.chains:
        again = "The chain of the alarm log was begun again {times} in this period."
        told.append(text(speech.tell(again, times=_times(found.chains, speech)), "bad"))
    if found.store_fault:
        what = "The store of references is DAMAGED, so what was in force is not known: {why}."
        told.append(text(speech.tell(what, why=lost_text(found.store_fault, language)), "bad"))
    if overdue := "" if dates is None else dates.overdue(found.made):
        late = "The check of the calibration in force is OVERDUE: {overdue}."
        told.append(text(speech.tell(late, overdue=speech.recognise(overdue)), "bad"))
    if test_faults:
        changed = "Records of self-tests are not as they were kept: {faults}."
        faults = _first([speech.recognise(one) for one in test_faults], speech)
        told.append(text(speech.tell(changed, faults=faults), "bad"))
    if found.overloads:
        told.append(text(_overloaded(found, speech), "warn"))
    if found.so_far:
        so_far = "The {kind} is not over: this is what happened so far."
        told.append(text(speech.tell(so_far, kind=speech.tell(found.period.kind)), "warn"))
    return told


def _overloaded(found: Summary, speech: Speech) -> str:
    """Returns what is not known because the log has no entry for each change in a time of overload."""
    long = _duration(sum(one.lasted_s for one in found.overloads))
    unlogged = sum(one.unlogged or 0 for one in found.overloads)
    is_counted = all(one.unlogged is not None for one in found.overloads)
    lasted = "This computer was overloaded {times}, for {long} in all."
    told = speech.tell(lasted, times=_times(len(found.overloads), speech), long=long)
    if is_counted and not unlogged:
        return f"{told} {speech.tell('Each change of the state has its own entry all the same.')}"
    changes = "changes of the state may have no entry of their own"
    if unlogged == 1:
        changes = "1 change of the state has no entry of its own"
        changes = changes if is_counted else "at least 1 change of the state has no entry of its own"
    elif unlogged:
        changes = "{number} changes of the state have no entry of their own"
        changes = changes if is_counted else "at least {number} changes of the state have no entry of their own"
    lost = "Meanwhile {changes}: times in each state and of each fault are known only in part."
    return f"{told} {speech.tell(lost, changes=speech.tell(changes, number=unlogged))}"


def _times(number: int, speech: Speech) -> str:
    return speech.tell("once") if number == 1 else speech.tell("{number} times", number=number)


def _first(faults: Sequence[str], speech: Speech) -> str:
    more = len(faults) - _MOST_DAMAGES
    rest = [speech.tell("and {more} more", more=more)] if more > 0 else []
    return "; ".join([*faults[:_MOST_DAMAGES], *rest])


def _minute(at: datetime) -> str:
    return f"{at:%Y-%m-%d %H:%M}"


def _utc_minute(said: str) -> str:
    """Returns the time to the minute, UTC. said: ISO 8601."""
    return _minute(datetime.fromisoformat(said).astimezone(UTC))


def _good(found: Summary) -> str:
    """Returns the class of a good figure; none where the log is damaged, because its figures prove nothing."""
    return "" if found.damages or found.chains else "good"


def _percent(value: float) -> str:
    """Returns the share as a percentage; a small one, as of a halt, is not shown as none."""
    if not isfinite(value):
        return "–"
    return "< 0.1 %" if 0 < value < _LEAST_SHARE else f"{100 * value:.1f} %"


def _duration(seconds: float) -> str:
    """Returns the duration in the unit that a person would choose."""
    if seconds < _MINUTES_FROM_S:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < _HOURS_FROM_S else _hours(seconds)


def _hours(seconds: float) -> str:
    return f"{seconds / 3600:.1f} h"


def _verification(found: Summary, speech: Speech) -> str:
    if not found.on_s:
        return text(speech.tell("The service did not run: of this cart nothing was verified."), "bad")
    by_hours = found.period.kind == "day"
    unit, per_unit_s, most = ("min", 60, 60) if by_hours else ("h", 3600, 24)
    axis = speech.tell(_AXIS[found.period.kind])
    across = (0.0, len(found.by_part)) if by_hours else (0.5, len(found.by_part) + 0.5)
    plot = Plot(across, (0, most), axis, unit)
    coverage = Plot(across, (0, 100), axis, speech.tell("% verified"), height=150)
    for number, shares_s in enumerate(found.by_part):
        left = number + _EDGE if by_hours else number + 0.5 + _EDGE
        right, low = left + 1 - 2 * _EDGE, 0.0
        for state, kind in _STACK:
            long = shares_s[state] / per_unit_s
            if long > 0:
                plot.block(left, right, low, low + long, kind, f"{speech.recognise(state)}: {long:.1f} {unit}")
                low += long
        verified = 100 * share(shares_s)
        if isfinite(verified):
            title = speech.tell("{share} % verified", share=f"{verified:.1f}")
            coverage.block(left, right, 0, max(verified, _SEEN), "a", title)
    rows = [
        (speech.recognise(state), _duration(seconds), "" if state == OFF else _percent(seconds / found.on_s))
        for state, seconds in sorted(found.shares_s.items(), key=lambda share_s: -share_s[1])
    ]
    ran = "The service ran for {long}; the calibration was verified in {share} of it."
    colours = "Green: monitoring; blue: not verified; yellow: warning; red: halt, or a device or a part lost."
    each = "time in each state, hour by hour" if by_hours else "time in each state, day by day"
    shares = "share of the time verified, hour by hour" if by_hours else "share of the time verified, day by day"
    return (
        text(speech.tell(ran, long=_duration(found.on_s), share=_percent(found.verified)))
        + plot.svg(speech.tell(each))
        + text(speech.tell(colours), "note")
        + coverage.svg(speech.tell(shares))
        + table(_headings(speech, "state", "time", "of the time on"), rows)
    )


def _headings(speech: Speech, *heads: str) -> list[str]:
    return [speech.tell(head) for head in heads]


def _alarms(found: Summary, speech: Speech) -> str:
    if not found.alarms:
        if found.on_s:
            return text(speech.tell("None."), _good(found))
        return text(speech.tell("None, as the service did not run."), "bad")
    rows = [(_named(name, speech), str(number), _duration(s)) for name, number, s in per_fault(found.alarms)]
    shown = found.alarms[:_MOST_ALARMS]
    each = [
        (
            f"{alarm.begun:%Y-%m-%d %H:%M:%S}",
            _lasted(alarm, speech),
            speech.recognise(alarm.worst),
            _faults(alarm, speech),
            speech.recognise(alarm.reason),
        )
        for alarm in shown
    ]
    more = len(found.alarms) - len(shown)
    rest = text(speech.tell("And {more} more; probewatch log has them all.", more=more)) if more else ""
    requests = [f"{speech.recognise(what)} ({_times(number, speech)})" for what, number in found.requests.most_common()]
    asked = ", ".join(requests) or speech.tell("nothing")
    return (
        table(_headings(speech, "fault", "alarms", "in all"), rows)
        + table(_headings(speech, "begun, UTC", "lasted", "at the end", "faults", "reason at the end"), each)
        + rest
        + text(speech.tell("People asked: {asked}.", asked=asked))
    )


def _named(fault: str, speech: Speech) -> str:
    """Returns the name of a fault; with its text beside it where that is not of the language of the names."""
    said = _FAULTS.get(fault)
    return fault if speech.language == "en" or said is None else f"{speech.recognise(said)} ({fault})"


def _faults(alarm: Alarm, speech: Speech) -> str:
    return speech.tell(", then ").join(name for name, _ in alarm.named if name) or "–"


def _lasted(alarm: Alarm, speech: Speech) -> str:
    long = _duration(alarm.lasted_s)
    return long if alarm.ended else f"!{speech.tell('{long}, and went on', long=long)}"


def _references(found: Summary, dates: Dates | None, speech: Speech) -> str:
    due = text(_due(found, dates, speech), "bad" if dates is not None and dates.overdue(found.made) else "note")
    heads = ("reference", "in force from, UTC", "until, UTC", "verified by motion", "how", "file")
    none = "Not known, see the top of this report." if found.store_fault else "None was in force."
    rows = [_in_force(one, speech) for one in found.in_force]
    held = table([*_headings(speech, *heads), "SHA-256"], rows) if rows else text(speech.tell(none), "bad")
    if not found.references:
        same = "By the log, none took the place of another in this period."
        return held + text(speech.tell(same)) + due
    changes = []
    for entry in found.references:
        said = entry.data.get("reference") or {}
        changes.append(
            (
                _utc_minute(entry.utc),
                str(said.get("number")),
                speech.recognise(str(said.get("origin"))),
                str(said.get("who") or "–"),
                speech.recognise(str(said.get("difference") or "–")),
            )
        )
    changed = _headings(speech, "reference", "how", "by", "difference to the one before")
    return held + table(["UTC", *changed], changes) + due


def _trend(found: Summary, speech: Speech) -> str:
    """Returns the drift under the reference of the last estimate, by all its estimates until the end of the period."""
    number = next(reversed(references_of(found.estimates)), None)
    if number is None:
        none = "The service has noted no estimates: it does so every five minutes while it is verified."
        return text(speech.tell(none))
    drifts = trends(found.estimates, number)
    rows = [(*cells[:-1], f"{'!' * (one.moving or one.near)}{cells[-1]}") for cells, one in _drifts(drifts, speech)]
    of = speech.tell("Of reference {number}, until the end of the period.", number=number)
    return text(of, "note") + table([speech.recognise(head) for head in HEADINGS], rows)


def _drifts(drifts: Mapping[str, Trend], speech: Speech) -> list[tuple[tuple[str, ...], Trend]]:
    return [(row_of(name, one, speech.language), one) for name, one in drifts.items()]


def _due(found: Summary, dates: Dates | None, speech: Speech) -> str:
    """Returns the dates of the calibration that is in force when the report is made."""
    if found.store_fault:
        return speech.tell("When the calibration is to be checked again is not known.")
    if dates is None:
        return speech.tell("No calibration is in force, so none is to be checked.")
    if overdue := dates.overdue(found.made):
        late = "The next check of the calibration in force is overdue: {overdue}."
        return speech.tell(late, overdue=speech.recognise(overdue))
    stated = (("due", dates.due), ("expires", dates.expires))
    ends = ", ".join(f"{speech.recognise(what)} {_minute(at)} UTC" for what, at in stated if at)
    return speech.tell("Next check of the calibration in force: {ends}.", ends=ends or speech.tell("no date is set"))


def _in_force(one: InForce, speech: Speech) -> tuple[str, ...]:
    reference = one.reference
    until = speech.tell("still in force") if one.until is None else _minute(one.until)
    shown = f"!{speech.tell('never')}" if reference.verified_utc is None else _utc_minute(reference.verified_utc)
    since, origin = _utc_minute(reference.utc), speech.recognise(reference.origin)
    sha256 = f"{reference.sha256[:12]}…"
    return str(reference.number), since, until, shown, origin, Path(reference.file).name, sha256


def _self_tests(found: Summary, speech: Speech) -> str:
    if not found.self_tests:
        return text(speech.tell("None."), "bad")
    rows = []
    for test in found.self_tests:
        red = [speech.recognise(str(item.get("name"))) for item in test["items"] if not item.get("green")]
        passed = f"+{speech.tell('passed')}" if test.get("passed") else f"!{speech.tell('failed')}"
        rows.append(
            (
                _utc_minute(str(test["utc"])),
                passed,
                printable(str(test.get("operator") or "–")),
                printable(", ".join(red), LONGEST_TEXT) or "–",
            )
        )
    return table(["UTC", *_headings(speech, "result", "by", "red")], rows)


def _software(found: Summary, speech: Speech) -> str:
    rows = [(_utc_minute(utc), said) for utc, said in found.software]
    rows = rows or [("–", speech.tell("the service was not started"))]
    started = speech.tell("Not started in this period.")
    if found.starts:
        started = speech.tell("Started {times}.", times=_times(found.starts, speech))
    unknown = speech.tell("not logged by that version")
    limits = [(_utc_minute(one.utc), limits_text(one, speech.language) or unknown) for one in found.limits]
    held = table(_headings(speech, "from, UTC", "limits of an OK"), limits) if limits else ""
    return table(_headings(speech, "from, UTC", "version"), rows) + held + text(started)


def _log(found: Summary, speech: Speech) -> str:
    if found.damages:
        return text(speech.tell("The chain is NOT whole, see the top of this report."), "bad")
    harmless = "A write that a loss of power tore, no damage: {torn}."
    told = [speech.tell(harmless, torn=damage_text(one, speech.language)) for one in found.torn]
    torn = "".join(text(one, "note") for one in told)
    if not found.starts and not found.on_s:
        return text(speech.tell("Nothing was logged in this period."), "bad") + torn
    whole = speech.tell("The chain of the alarm log is whole.")
    if found.chains:
        again = "The chain of the alarm log is whole; it was begun again {times}."
        whole = speech.tell(again, times=_times(found.chains, speech))
    return text(whole, _good(found) or "bad") + torn
