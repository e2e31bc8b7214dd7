"""Summarises the rows of a study: coverage, truthfulness of sigmas, delays of hazards. It is pure."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import isfinite, nan, sqrt
from statistics import median

from scipy.stats import beta

from probewatch.appliance.core.parameters import MEASURED
from probewatch.tools.study.hazard import Hazard

Row = dict[str, str]
_SURE = 0.95
"""Confidence of every interval."""


def number(row: Row, column: str) -> float:
    """Returns the number in a cell; NaN where nothing is known."""
    return float(row[column]) if row.get(column) else nan


def middle(values: Iterable[float]) -> float:
    """Returns the median of the values that are known; NaN where none is."""
    known = [value for value in values if isfinite(value)]
    return median(known) if known else nan


@dataclass(frozen=True)
class Share:
    """Represents k of n, with the exact interval of Clopper and Pearson (95 %)."""

    k: int
    n: int

    @property
    def interval(self) -> tuple[float, float]:
        """Returns (low, high)."""
        tail = (1 - _SURE) / 2
        low = float(beta.ppf(tail, self.k, self.n - self.k + 1)) if self.k else 0.0
        high = float(beta.ppf(1 - tail, self.k + 1, self.n - self.k)) if self.k < self.n else 1.0
        return low, high

    def __str__(self) -> str:
        if not self.n:
            return "–"
        low, high = self.interval
        return f"{self.k} of {self.n} ({100 * low:.0f} to {100 * high:.0f} %)"

    @property
    def brief(self) -> str:
        """Returns the share and its interval for a cell of a table."""
        if not self.n:
            return "–"
        low, high = self.interval
        return f"{self.k}/{self.n} ({100 * low:.0f}–{100 * high:.0f} %)"


@dataclass(frozen=True)
class Coverage:
    """Summarises healthy runs of one session, tissue, tracker, asked and profile. closed: share of each run. closed_s:
    median time until the contact closed first. faulted: runs with a FAULT.
    """

    session: str
    tissue: str
    noise_mm: str
    asked: str
    profile: str
    closed: tuple[float, ...]
    closed_s: float
    faulted: Share
    scores: dict[str, "Truth"]

    @property
    def spread(self) -> tuple[float, float, float]:
        """Returns the least, median and most of `closed`, %."""
        percent = [100 * share for share in self.closed]
        return min(percent), median(percent), max(percent)


@dataclass(frozen=True)
class Truth:
    """Summarises how true one check was over several runs. rms, worst: those of the z-scores. sigma: median at the end.
    ratio: sigma to the bound. shown: median share of the time at which it was OK.
    """

    rms: float
    worst: float
    sigma: float
    ratio: float
    shown: float


@dataclass(frozen=True)
class Detection:
    """Summarises runs with one hazard and profile, in all sessions. named: as `rightly_named`. fault_s, opened_s:
    medians from its onset. gross: runs in which OK was reported, or the contact closed again, with a parameter twice
    its limit away; of none where the hazard has no limit.
    """

    hazard: str
    profile: str
    found: Share
    named: Share
    fault_s: float
    opened_s: float
    gross: Share


def coverages(rows: Sequence[Row]) -> list[Coverage]:
    """Returns a Coverage for each session, tissue, tracker, asked and profile, sorted by these."""
    healthy = [row for row in rows if row["hazard"] == "none"]
    order = list(dict.fromkeys(_place(row) for row in healthy))
    return [_coverage(place, [row for row in healthy if _place(row) == place]) for place in sorted(order)]


def detections(rows: Sequence[Row]) -> list[Detection]:
    """Returns a Detection for each hazard and profile."""
    sick = sorted((row for row in rows if row["hazard"] != "none"), key=_wrong)
    return [_detection(*key, list(same)) for key, same in groupby(sick, key=_wrong)]


def healthy_hours(rows: Sequence[Row], fps: float) -> float:
    """Returns the hours of sessions without a hazard, each counted once, however many limits have judged it."""
    frames = {tuple(row[key] for key in _PICTURES): number(row, "frames") for row in rows if row["hazard"] == "none"}
    return sum(frames.values()) / fps / 3600


def false_rate_per_hour(faults: int, hours: float) -> float:
    """Returns the upper limit (95 %) of the rate of events of which this number was seen."""
    return float(beta.ppf(_SURE, faults + 1, 1e9)) * 1e9 / hours if hours else nan


_PICTURES = ("session", "tissue", "seed", "duration_s", "noise_mm", "draw")
"""Fields of a row that determine its pictures and poses."""


def _place(row: Row) -> tuple[str, str, str, str, str]:
    return row["session"], row["tissue"], row["noise_mm"], row["asked"], row["profile"]


def _coverage(place: tuple[str, str, str, str, str], rows: list[Row]) -> Coverage:
    return Coverage(
        *place,
        closed=tuple(number(row, "closed") for row in rows),
        closed_s=middle(number(row, "closed_s") for row in rows),
        faulted=Share(sum(bool(row["faults"]) for row in rows), len(rows)),
        scores={name: truth_of(name, rows) for name in MEASURED},
    )


def truth_of(name: str, rows: Sequence[Row]) -> Truth:
    """Returns the truth of a check in these runs; NaN where it was never measured."""
    looks = sum(number(row, f"{name} looks") for row in rows)
    squares = sum(number(row, f"{name} squares") for row in rows)
    return Truth(
        rms=sqrt(squares / looks) if looks else nan,
        worst=max(number(row, f"{name} worst") for row in rows) if looks else nan,
        sigma=middle(number(row, f"{name} sigma") for row in rows),
        ratio=middle(number(row, f"{name} sigma") / number(row, f"{name} bound") for row in rows),
        shown=middle(number(row, f"{name} shown") for row in rows),
    )


def rightly_named(hazard: Hazard, row: Row) -> bool:
    """Returns whether the hazard was named as what it is before anything else was; of two at once, both and nothing
    else.
    """
    names = row["faults"].split()
    if hazard.beside is None:
        return names[:1] == [hazard.fault]
    return bool(row["named_s"]) and hazard.faults.issuperset(names)


def _wrong(row: Row) -> tuple[str, str]:
    return row["hazard"], row["profile"]


def _detection(name: str, profile: str, rows: list[Row]) -> Detection:
    hazard = Hazard.parse(name)
    found = [row for row in rows if row["fault_s"]]
    wrong = sum(number(row, "ok_gross_s") > 0 for row in rows)
    judged = len(rows) if hazard.limited else 0
    return Detection(
        hazard=name,
        profile=profile,
        found=Share(len(found), len(rows)),
        named=Share(sum(rightly_named(hazard, row) for row in found), len(rows)),
        fault_s=middle(number(row, "fault_s") for row in found),
        opened_s=middle(number(row, "opened_s") for row in rows),
        gross=Share(wrong, judged),
    )
