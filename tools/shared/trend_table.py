"""Computes the drift of each parameter from the alarm log, as rows of a table."""

from collections import defaultdict
from collections.abc import Sequence
from datetime import datetime
from math import inf, isfinite

from probewatch.appliance.core.parameters import MEASURED, QUANTITIES, class_of
from probewatch.appliance.core.quality.trend import Estimate, Trend, trend
from probewatch.appliance.storage.alarm_chain import Entry, Event
from probewatch.tools.german.translation import recognised, told
from probewatch.tools.shared.tables import NOTHING

HEADINGS = ("parameter", "estimates", "now", "limit", "since the first", "per day", "reaches the limit", "is")
_FAR_DAYS = 3650
"""Days, ten years: a prediction beyond that is of no use to anybody."""


def trends(entries: Sequence[Entry], reference: int) -> dict[str, Trend]:
    """Returns the trend of each parameter by name, from the estimates under that reference."""
    noted = _noted(entries, reference)
    return {name: trend([one for one, _ in rows], rows[-1][1]) for name, rows in noted.items()}


def estimates_of(entries: Sequence[Entry], reference: int) -> dict[str, list[Estimate]]:
    """Returns the estimates of each parameter under that reference by name, in the order of the log."""
    return {name: [one for one, _ in rows] for name, rows in _noted(entries, reference).items()}


def _noted(entries: Sequence[Entry], reference: int) -> dict[str, list[tuple[Estimate, float]]]:
    """Returns the estimates of each parameter by name, each with its limit at that time."""
    known = defaultdict[str, list[tuple[Estimate, float]]](list)
    for entry in entries:
        if entry.event == Event.ESTIMATE and entry.data.get("reference") == reference:
            utc_s = datetime.fromisoformat(entry.utc).timestamp()
            for name, (value, sigma, limit) in _figures(entry.data.get("checks")).items():
                known[name].append((Estimate(utc_s, value, sigma), limit))
    return known


def _figures(checks: object) -> dict[str, list[float]]:
    """Returns the known parameters; fields of other versions are left out."""
    rows = checks if isinstance(checks, dict) else {}
    return {
        name: row
        for name, row in rows.items()
        if name in MEASURED
        and isinstance(row, list)
        and [type(one) in (int, float) for one in row] == [True] * 3
        and row[2] > 0
    }


def unit_of(name: str) -> str:
    """Returns the unit of a parameter's estimates."""
    return QUANTITIES[class_of(name)].unit


def references_of(entries: Sequence[Entry]) -> list[int]:
    """Returns the references that have estimates, the latest last."""
    numbers = (entry.data.get("reference") for entry in reversed(entries) if entry.event == Event.ESTIMATE)
    return list(dict.fromkeys(number for number in numbers if isinstance(number, int)))[::-1]


def state_of(one: Trend) -> str:
    """Returns the state of a trend in a word."""
    if one.near:
        return "near its limit"
    if one.moving:
        return "moving"
    return "steady" if isfinite(one.high[-1]) else "not known yet"


def row_of(name: str, one: Trend, language: str = "en") -> tuple[str, ...]:
    """Returns the cells under HEADINGS."""
    unit, mean = recognised(unit_of(name), language), float(one.mean[-1])
    base = float(one.mean[-1] - (one.low[-1] + one.high[-1]) / 2) if isfinite(one.high[-1]) else inf
    since = f"{base:+.2f} {unit}" if isfinite(base) else NOTHING
    day = f"{one.per_day:+.3f} ± {one.per_day_sigma:.3f}" if isfinite(one.per_day_sigma) else NOTHING
    left = (
        told("not before {days} days", language, days=f"{one.days_left:.0f}") if one.days_left < _FAR_DAYS else NOTHING
    )
    return (
        recognised(name, language),
        str(len(one.estimates)),
        f"{mean:+.2f} {unit}",
        f"{one.limit:g} {unit}",
        since,
        day,
        left,
        recognised(state_of(one), language),
    )
