"""Makes the section of docs/evidence.md on signs and names in healthy scanning, from docs/false-alarms.json."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from scipy.stats import chi2

from probewatch.tools.development.markdown import table

FIGURES = Path(__file__).parents[2] / "docs" / "false-alarms.json"
_TAIL = 0.025
"""Probability on either side of an interval of 95 %."""
_LEVELS_NATS = (6, 8, 10, 13.5, 18.5)
"""Nats above which peaks are counted: what the test reports at all, a sign, one of a distorted field, a name, and
between."""

_COUNTED = {
    "signs": "signs",
    "withdrawn": "of them while OK",
    "choices": "`undecided`",
    "faults": "named FAULTs",
    "warnings": "WARNINGs",
    "halts": "HALTs",
}
"""Figure → head of its column."""

_TEXT = """`make false-alarms SEEDS={seeds}` plays every session of [study.md](study.md) after a gesture without
pictures: the path, with the errors of a registration, goes straight into what judges it; leaps, freezes and other
tissue are not in it. Three noises of the tracker of one size (0.1 mm, 0.02°): `gaussian`; `t5`, Student's t with five
degrees of freedom; `ar1`, alike from reading to reading (0.9 at 60 Hz). *Sign*: something speaks against the
calibration, and the contact is open until motion answers it. None: a rate under {none:.1f} ÷ hours. Seeds 1 to
{seeds}, commit {commits}.
"""


def interval(events: int, hours: float) -> tuple[float, float]:
    """Returns the interval of a rate per hour, Poisson, both sides."""
    low = float(chi2.ppf(_TAIL, 2 * events)) / 2 if events else 0.0
    return low / hours, float(chi2.ppf(1 - _TAIL, 2 * events + 2)) / 2 / hours


def false_alarm_lines() -> list[str]:
    """Returns the lines of the page, as last measured."""
    figures: Mapping[str, Any] = json.loads(FIGURES.read_text(encoding="utf-8"))
    commits = ", ".join(f"`{one}`" for one in figures["commits"])
    told = _TEXT.format(seeds=figures["seeds"], commits=commits, none=interval(0, 1.0)[1])
    totals: Mapping[str, Mapping[str, Any]] = figures["totals"]
    counted = [kind for kind in _COUNTED if any(int(total[kind]) for total in totals.values())]
    head = ("healthy scanning", "hours", *(_COUNTED[kind] for kind in counted), "OK for")
    rows = [_row(name, total, counted) for name, total in totals.items()]
    never = ", ".join(name for kind, name in _COUNTED.items() if kind not in counted)
    none = [f"In none of these rows: {never}.", ""] if never else []
    return ["## Signs and names in healthy scanning", "", told, *table(head, rows), *none, *_peaks(figures)]


def _row(name: str, total: Mapping[str, Any], counted: Sequence[str]) -> Sequence[str]:
    hours = float(total["hours"])
    rates = [_rate(int(total[kind]), hours) for kind in counted]
    return (name, f"{hours:.2f}", *rates, f"{100 * float(total['ok_h']) / hours:.0f} %")


def _rate(events: int, hours: float) -> str:
    if not events:
        return "0"
    low, high = interval(events, hours)
    return f"{events} ({low:.2g} to {high:.2g})"


def _peaks(figures: Mapping[str, Any]) -> list[str]:
    names = ", ".join(f"`{name}` {number}" for name, number in figures["names"].items()) or "none"
    return [
        f"Largest log likelihood ratio of each half minute: {_above(figures['peaks'])}. Of a distorted field: "
        f"{_above(figures['bent'])}. Names: {names}.",
        "",
    ]


def _above(peaks: Sequence[float]) -> str:
    """Returns the counts up to the first level that none passed. peaks: the highest first."""
    counts = [sum(peak > level for peak in peaks) for level in _LEVELS_NATS]
    told = counts.index(0) + 1 if 0 in counts else len(counts)
    levels = zip(counts[:told], _LEVELS_NATS, strict=False)
    above = ", ".join(f"{count} above {level:g}" for count, level in levels)
    return f"{above} nats, the highest {peaks[0] if peaks else 0.0:.1f}"
