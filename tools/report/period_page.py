"""The page of a period."""

from math import isfinite
from pathlib import Path

from appliance.storage.reference_store import Entry as Reference
from appliance.types import State
from tools.report.page import section, table, text, write_page
from tools.report.period import OFF, Summary, per_fault, share
from tools.report.svg import Plot

_MOST_ALARMS = 200
"""Told one by one; the rest is counted and in the log."""
_STACK = (
    (State.MONITORING.value, "good"),
    (State.NOT_VERIFIED.value, "wait"),
    (State.WARNING.value, "warn"),
    (State.HALT.value, "bad"),
    (State.RECALIBRATION_REQUESTED.value, "bad"),
    (State.DEVICE_LOST.value, "bad"),
    (State.INTERNAL_FAULT.value, "bad"),
)


def write_period_page(path: Path, cart: str, found: Summary, due_utc: str | None, damaged_tests: int) -> None:
    """Raises ConfigurationError where it cannot be written."""
    title = f"{cart}: {found.period.name}"
    parts = [
        "<h1>probewatch report</h1>",
        text(("SIMULATED · " if found.simulated else "") + title, "verdict"),
        text(
            f"{found.period.start:%Y-%m-%d} to {found.period.end:%Y-%m-%d} UTC, of the alarm log of this cart. "
            "probewatch is not a certified medical device.",
            "note",
        ),
        section("Verification", _verification(found)),
        section("Alarms", _alarms(found)),
        section("Calibrations", _references(found, due_utc)),
        section("Self-tests", _self_tests(found, damaged_tests)),
        section("Software", _software(found)),
        section("The log itself", _log(found)),
    ]
    write_page(path, f"probewatch: {title}", parts)


def _percent(value: float) -> str:
    return f"{100 * value:.0f} %" if isfinite(value) else "–"


def _hours(seconds: float) -> str:
    return f"{seconds / 3600:.1f} h"


def _verification(found: Summary) -> str:
    days = len(found.by_day)
    plot = Plot((0, days), (0, 24), "day of the period", "h")
    for number, shares_s in enumerate(found.by_day):
        low = 0.0
        for state, kind in _STACK:
            hours = shares_s[state] / 3600
            if hours > 0:
                plot.block(number + 0.1, number + 0.9, low, low + hours, kind, f"{state}: {hours:.1f} h")
                low += hours
    coverage = Plot((0, days), (0, 100), "day of the period", "% verified", height=150)
    middles = [number + 0.5 for number in range(days)]
    coverage.line(middles, [100 * share(shares_s) for shares_s in found.by_day], "a")
    rows = [
        (state, _hours(seconds), "" if state == OFF else _percent(seconds / found.on_s))
        for state, seconds in sorted(found.shares_s.items(), key=lambda share_s: -share_s[1])
    ]
    verified = f"the calibration was verified in {_percent(found.verified)} of it"
    if not found.on_s:
        return text("The service did not run: of this cart nothing was verified.", "bad")
    return (
        text(f"The service ran for {_hours(found.on_s)}; {verified}.")
        + plot.svg("hours in each state, day by day")
        + text("Green: monitoring; blue: not verified; yellow: warning; red: halt, or a device or a part lost.", "note")
        + coverage.svg("share of the time verified, day by day")
        + table(("state", "time", "of the time on"), rows)
    )


def _alarms(found: Summary) -> str:
    if not found.alarms:
        return text("None.", "good") if found.on_s else text("None, as the service did not run.", "bad")
    rows = [(name, str(number), f"{seconds:.0f} s") for name, number, seconds in per_fault(found.alarms)]
    shown = found.alarms[:_MOST_ALARMS]
    each = [
        (f"{alarm.begun:%Y-%m-%d %H:%M:%S}", f"{alarm.lasted_s:.0f} s", alarm.worst, alarm.fault or "–", alarm.reason)
        for alarm in shown
    ]
    more = len(found.alarms) - len(shown)
    rest = text(f"And {more} more; probewatch log has them all.") if more else ""
    asked = ", ".join(f"{what} {number}" for what, number in found.requests.most_common()) or "nothing"
    return (
        table(("fault", "alarms", "in all"), rows)
        + table(("begun, UTC", "lasted", "at the end", "fault", "reason"), each)
        + rest
        + text(f"People asked: {asked}.")
    )


def _references(found: Summary, due_utc: str | None) -> str:
    due = text(f"To be checked again: {due_utc}." if due_utc else "No date is set for the next check.", "note")
    held = text(f"In force: {'; '.join(map(_in_force, found.in_force)) or 'none'}.", "" if found.in_force else "bad")
    if not found.references:
        return held + text("None came in force in this period.") + due
    rows = []
    for entry in found.references:
        said = entry.data.get("reference") or {}
        by = str(said.get("who") or "–")
        rows.append(
            (entry.utc, str(said.get("number")), str(said.get("origin")), by, str(said.get("difference") or "–"))
        )
    return held + table(("UTC", "reference", "how", "by", "difference to the one before"), rows) + due


def _in_force(one: Reference) -> str:
    shown = f"verified {one.verified_utc}" if one.verified_utc else "never verified"
    return f"{one.number} ({one.origin}, {one.file}, SHA-256 {one.sha256[:12]}…) since {one.utc}, {shown}"


def _self_tests(found: Summary, damaged: int) -> str:
    note = text(f"{damaged} records of self-tests cannot be read.", "bad") if damaged else ""
    if not found.self_tests:
        return text("None.", "bad") + note
    rows = []
    for test in found.self_tests:
        red = [str(item.get("name")) for item in test["items"] if not item.get("green")]
        passed = "+passed" if test.get("passed") else "!failed"
        rows.append((str(test["utc"]), passed, str(test.get("operator") or "–"), ", ".join(red) or "–"))
    return table(("UTC", "result", "by", "red"), rows) + note


def _software(found: Summary) -> str:
    rows = [(utc, said) for utc, said in found.software] or [("–", "the service was not started")]
    return table(("from, UTC", "version"), rows) + text(f"Started {found.starts} times.")


def _log(found: Summary) -> str:
    if found.damages:
        return text("The chain is NOT whole: " + "; ".join(found.damages[:5]), "bad")
    if not found.starts and not found.on_s:
        return text("Nothing was logged.", "bad")
    begun = f"; it was begun again {found.chains} times" if found.chains else ""
    return text(f"The chain of the alarm log is whole{begun}.", "bad" if found.chains else "good")
