"""Compares the bounds on the error of a point with the true errors, world by world, and writes the table. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from math import sqrt
from statistics import mean, stdev

from scipy.stats import t as student

from probewatch.tools.development.markdown import table
from probewatch.tools.study.summary import Row, number

_HEADING = """## Is the bound on the error of a point honest?

The share of 200 places in the picture, once a second, at which the bound of 95 and of 99.7 % (`point_error.py`) was not
exceeded by the true error. Each parameter is wrong by at most half of its limit: by a constant amount from the start,
or by one that creeps in. A share above the stated one means that the bound is too wide. *Around*: the same shares for
the distance from the most likely error, which a bound that is merely wide does not raise. *Worst place*: mean of the
bound of 99.7 %, and of the true error. Intervals are Student's over the runs, since looks of one run are much alike.
"""
_SHARES = ("narrow", "wide", "narrow_off", "wide_off")
_SIZES = ("worst_mm", "true_mm")


@dataclass(frozen=True)
class PointBounds:
    """Holds what the runs of one world came to, in which what is wrong came about in one manner. runs: all of them;
    looks: at which there was a bound. shares, sizes_mm: a row for each run that had a bound, in the order of _SHARES
    and _SIZES, as of `tools.study.point.Coverage`.
    """

    tissue: str
    manner: str
    runs: int
    looks: int
    shares: list[list[float]]
    sizes_mm: list[list[float]]
    commits: list[str]

    @property
    def key(self) -> tuple[str, str]:
        """Returns what a later measurement replaces."""
        return self.tissue, self.manner


def point_bounds(rows: Sequence[Row]) -> list[PointBounds]:
    """Returns the figures of the runs in which something is wrong within its limit, by tissue and manner. Runs that
    were never verified have no bound and count as runs alone.
    """
    within = [row for row in rows if is_within(row["hazard"])]
    ordered = sorted(within, key=_conditions)
    return [_of(key, list(group)) for key, group in groupby(ordered, key=_conditions)]


def is_within(hazard: str) -> bool:
    """Returns whether a hazard is one of those in which all parameters are wrong within their limits."""
    return "/" in hazard


def _conditions(row: Row) -> tuple[str, str]:
    return row["tissue"], row["hazard"].rpartition("@")[2]


def _of(key: tuple[str, str], rows: list[Row]) -> PointBounds:
    looked = [row for row in rows if number(row, "point looks") > 0]
    looks = sum(int(number(row, "point looks")) for row in looked)
    shares, sizes_mm = ([_cells(row, names) for row in looked] for names in (_SHARES, _SIZES))
    return PointBounds(*key, len(rows), looks, shares, sizes_mm, sorted({row["commit"] for row in rows}))


def _cells(row: Row, names: Sequence[str]) -> list[float]:
    return [round(number(row, f"point {name}"), 4) for name in names]


def point_lines(points: Sequence[PointBounds]) -> list[str]:
    """Returns the section of docs/coverage.md; empty where nothing was measured."""
    if not points:
        return []
    whole = [_whole(points, manner) for manner in dict.fromkeys(one.manner for one in points)]
    head = ("world", "wrong", "runs", "looks", "95 %", "99.7 %", "around: 95 %", "99.7 %", "worst place: bound, true")
    commits = sorted({commit for one in points for commit in one.commits})
    said = f"Session: gesture-hold; commit: {', '.join(f'`{commit}`' for commit in commits)}."
    return [_HEADING, said, "", *table(head, [_row(one) for one in (*whole, *points)])]


def _whole(points: Sequence[PointBounds], manner: str) -> PointBounds:
    some = [one for one in points if one.manner == manner]
    shares = [row for one in some for row in one.shares]
    sizes_mm = [row for one in some for row in one.sizes_mm]
    runs, looks = sum(one.runs for one in some), sum(one.looks for one in some)
    return PointBounds("**all**", manner, runs, looks, shares, sizes_mm, [])


def _row(one: PointBounds) -> tuple[str, ...]:
    shares = [_share([row[at] for row in one.shares]) for at in range(len(_SHARES))]
    sizes = ", ".join(f"{mean(row[at] for row in one.sizes_mm):.1f}" for at in range(len(_SIZES)) if one.sizes_mm)
    manner = {"start": "from the start"}.get(one.manner, one.manner)
    return (one.tissue, manner, str(one.runs), str(one.looks), *shares, f"{sizes} mm" if sizes else "–")


def _share(runs: Sequence[float]) -> str:
    """Returns the mean of the runs in percent, with its interval of 95 % where they differ."""
    if not runs:
        return "–"
    text = f"{100 * mean(runs):.1f}"
    if len(runs) < 2 or stdev(runs) == 0:
        return text
    half = float(student.ppf(0.975, len(runs) - 1)) * stdev(runs) / sqrt(len(runs))
    low, high = max(mean(runs) - half, 0.0), min(mean(runs) + half, 1.0)
    return f"{text} ({100 * low:.1f}–{100 * high:.1f})"
