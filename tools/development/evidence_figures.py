"""Computes from the rows of a study the figures that docs/evidence.json keeps and the pages show. It is pure.

Each figure states with which sessions, seeds and commits it was measured, so that its command can be written down.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from itertools import groupby
from math import isfinite
from statistics import median
from typing import Any

import numpy as np

from probewatch.appliance.core.parameters import MEASURED
from probewatch.appliance.types import Fault
from probewatch.tools.development.evidence_points import PointBounds, is_within, point_bounds
from probewatch.tools.study.bound import least_delay_s
from probewatch.tools.study.hazard import FAULTS, HIDDEN_S, ONSET_S, Hazard, Manner
from probewatch.tools.study.session import FPS, Session
from probewatch.tools.study.summary import Row, Share, number, rightly_named, truth_of

SOON_S = 10.0
"""Seconds within which nearly every fault ought to be named, where the motion shows it."""
_BOUNDED = (Manner.START, Manner.UNSEEN)
"""Manners that motion alone shows: what changes in sight is seen by its leap, to which no such bound applies."""


@dataclass(frozen=True)
class Origin:
    """Holds the conditions that figures of one line share. seeds: "1" or "1–20"."""

    session: str
    tissue: str
    noise_mm: str
    asked: str
    duration_s: str
    seeds: str
    draws: str
    commits: list[str]

    @property
    def conditions(self) -> tuple[str, ...]:
        """Returns what was asked for, in the order of the pages."""
        return self.session, self.tissue, self.noise_mm, self.asked, self.duration_s


@dataclass(frozen=True)
class Score:
    """Holds the score of (value − truth) ÷ sigma at the looks of all runs: root of the mean square, and largest
    size.
    """

    rms: float
    worst: float


@dataclass(frozen=True)
class Healthy:
    """Holds the figures of healthy runs.

    closed: share of each run with the contact closed, in order. first_s: time until it closed first, of those that did.
    faulted, warnings, halts: runs with a FAULT, and how often the states began. nats: those of each run that kept them,
    as in `Outcome`, in order. scores: name of a check → `Score`; without those that were never measured.
    """

    origin: Origin
    runs: int
    hours: float
    closed: list[float]
    first_s: list[float]
    faulted: int
    warnings: int
    halts: int
    nats: list[float] = field(default_factory=list)
    scores: dict[str, Score] = field(default_factory=dict)


@dataclass(frozen=True)
class Found:
    """Holds the figures of runs with one hazard.

    named: runs that named it first as what it is. told: name that came first → runs; no name is "". fault_s: delays of
    the FAULT, in order. open_s: until the contact was open permanently, in order. soon: FAULTs within SOON_S. gross:
    runs with an OK at twice the limit. bound_s: median least delay; None where none is known. nats: as in Healthy.
    """

    origin: Origin
    hazard: str
    runs: int
    named: int
    told: dict[str, int]
    fault_s: list[float]
    open_s: list[float]
    soon: int
    gross: int
    bound_s: float | None
    nats: list[float] = field(default_factory=list)

    @property
    def kind(self) -> str:
        """Returns the kind of hazard, without its size and manner."""
        return Hazard.parse(self.hazard).kind

    @property
    def share(self) -> Share:
        """Returns the share of runs with a FAULT."""
        return Share(len(self.fault_s), self.runs)

    @property
    def delay(self) -> str:
        """Returns the median of the runs with a FAULT, and their range."""
        if not self.fault_s:
            return "–"
        return f"{median(self.fault_s):.2f} s ({self.fault_s[0]:.2f} to {self.fault_s[-1]:.2f})"


@dataclass(frozen=True)
class Figures:
    """Holds everything that was measured."""

    healthy: list[Healthy]
    found: list[Found]
    points: list[PointBounds] = field(default_factory=list)

    def plain(self) -> dict[str, object]:
        """Returns the value as JSON takes it."""
        return asdict(self)

    def updated(self, now: "Figures") -> "Figures":
        """Returns the figures with what was measured now in the place of the same conditions before; all else stays,
        with its commit.
        """
        healthy = {one.origin.conditions: one for one in (*self.healthy, *now.healthy)}
        found = {(*one.origin.conditions, one.hazard): one for one in (*self.found, *now.found)}
        points = {one.key: one for one in (*self.points, *now.points)}
        return Figures(
            [healthy[key] for key in sorted(healthy)],
            [found[key] for key in sorted(found)],
            [points[at] for at in sorted(points)],
        )

    @classmethod
    def parse(cls, plain: dict[str, list[dict[str, Any]]]) -> "Figures":
        """Returns the figures of such a value, the inverse of `plain`. Raises KeyError and TypeError for something
        else.
        """
        healthy, found = ([one | {"origin": Origin(**one["origin"])} for one in plain[k]] for k in ("healthy", "found"))
        for one in healthy:
            one["scores"] = {name: Score(**score) for name, score in one.get("scores", {}).items()}
        points = [PointBounds(**one) for one in plain.get("points", [])]
        return cls([Healthy(**one) for one in healthy], [Found(**one) for one in found], points)


def of_fault(found: list[Found], fault: Fault) -> list[Found]:
    """Returns the figures of the hazards that ought to be named as this fault."""
    return [one for one in found if FAULTS[one.kind] is fault]


def figures(rows: Sequence[Row]) -> Figures:
    """Returns the figures of the rows of study.csv."""
    alike = ("session", "tissue", "noise_mm", "asked", "duration_s")
    healthy = _grouped([row for row in rows if row["hazard"] == "none"], alike)
    wrong = [row for row in rows if row["hazard"] != "none" and not is_within(row["hazard"])]
    sick = _grouped(wrong, (*alike, "hazard"))
    return Figures([_healthy(group) for group in healthy], [_found(group) for group in sick], point_bounds(rows))


def _grouped(rows: list[Row], alike: tuple[str, ...]) -> list[list[Row]]:
    def key(row: Row) -> tuple[str, ...]:
        return tuple(row[name] for name in alike)

    return [list(group) for _, group in groupby(sorted(rows, key=key), key=key)]


def _origin(rows: list[Row]) -> Origin:
    row = rows[0]
    commits = sorted({one["commit"] for one in rows})
    seeds, draws = _span(one["seed"] for one in rows), _span(one["draw"] for one in rows)
    return Origin(
        row["session"], row["tissue"], row["noise_mm"], row["asked"], row["duration_s"], seeds, draws, commits
    )


def _span(numbers: Iterable[str]) -> str:
    """Returns "1", "1–20" or "1, 3" as the numbers are."""
    told = sorted({int(one) for one in numbers})
    whole = len(told) > 1 and told == list(range(told[0], told[-1] + 1))
    return f"{told[0]}–{told[-1]}" if whole else ", ".join(map(str, told))


def _known(rows: list[Row], column: str) -> list[float]:
    return sorted(round(value, 3) for row in rows if isfinite(value := number(row, column)))


def _healthy(rows: list[Row]) -> Healthy:
    return Healthy(
        origin=_origin(rows),
        runs=len(rows),
        hours=round(sum(number(row, "frames") for row in rows) / FPS / 3600, 4),
        closed=_known(rows, "closed"),
        first_s=_known(rows, "closed_s"),
        faulted=sum(bool(row["faults"]) for row in rows),
        warnings=sum(int(row["warnings"]) for row in rows),
        halts=sum(int(row["halts"]) for row in rows),
        nats=_known(rows, "nats"),
        scores={name: score for name in MEASURED if (score := _score(rows, name)) is not None},
    )


def _score(rows: list[Row], name: str) -> Score | None:
    """Returns the score of a check, or None where it was never measured."""
    truth = truth_of(name, rows)
    return Score(round(truth.rms, 3), round(truth.worst, 2)) if isfinite(truth.rms) else None


def _found(rows: list[Row]) -> Found:
    hazard = Hazard.parse(rows[0]["hazard"])
    found = [row for row in rows if row["fault_s"]]
    told = Counter(row["faults"].split()[0] if row in found else "" for row in rows)
    delays_s = _known(found, "fault_s")
    return Found(
        origin=_origin(rows),
        hazard=str(hazard),
        runs=len(rows),
        named=sum(rightly_named(hazard, row) for row in found),
        told=dict(sorted(told.items())),
        fault_s=delays_s,
        open_s=_known(rows, "opened_s"),
        soon=sum(delay_s <= SOON_S for delay_s in delays_s),
        gross=sum(number(row, "ok_gross_s") > 0 for row in rows),
        bound_s=_bound_s(hazard, rows),
        nats=_known(rows, "nats"),
    )


def _bound_s(hazard: Hazard, rows: list[Row]) -> float | None:
    """Returns the median over the seeds; None where the hazard has no size or is seen to happen."""
    if not hazard.size or hazard.manner not in _BOUNDED:
        return None
    from_s = 0.0 if hazard.manner is Manner.START else ONSET_S + HIDDEN_S
    change = hazard.change(np.array([np.inf]))[0]
    noise_mm = float(rows[0]["noise_mm"])
    bounds_s = [least_delay_s(_session(row), change, noise_mm, 0.2 * noise_mm, from_s) for row in rows]
    return round(median(bounds_s), 3) if isfinite(median(bounds_s)) else None


def _session(row: Row) -> Session:
    return Session(row["session"], row["tissue"], int(row["seed"]), float(row["duration_s"]))
