"""Runs a session through line and supervisor once, and collects what came of it for a row of the table."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from math import isfinite, nan

import numpy as np

from probewatch.appliance.core.line import Line
from probewatch.appliance.core.parameters import MEASURED, PER_UNIT, limit_of_each
from probewatch.appliance.core.quality.report import Change, spells
from probewatch.appliance.limits import Limits
from probewatch.appliance.supervision.timeline import Timeline
from probewatch.appliance.types import Check, Fault, State, Verdict, VerdictKind
from probewatch.drivers.samples import Frame, GreyImage
from probewatch.tools.study.bound import bounds
from probewatch.tools.study.point import Coverage, errors_mm, places_mm
from probewatch.tools.study.samples import Conditions, samples, seconds, stamp_ns

_EVERY_NS = 1_000_000_000
"""Nanoseconds between two looks at value and sigma: a few solutions apart. Looks within one window share its motion, so
their z-scores are not independent; the seeds are."""
_GROSS, _BEYOND = 2.0, 1.3
"""Multiples of its limit from which a parameter must never be OK, and may be in one run of a hundred."""


@dataclass
class Scores:
    """Holds the scores of one check, in its unit. last, sigma: at the end. looks, squares, worst: number, sum of
    squares, and largest size of (value − truth) ÷ sigma. shown_s: first time it was OK, NaN for never. shown: share of
    looks at which it was OK. bound: least sigma that half a minute of this motion can give.
    """

    last: float = nan
    sigma: float = nan
    looks: int = 0
    squares: float = 0.0
    worst: float = 0.0
    shown_s: float = nan
    shown: float = 0.0
    bound: float = nan

    def look(self, check: Check, truth: float, t_s: float) -> None:
        """Takes what the line reports at t_s."""
        if check.verdict is VerdictKind.OK:
            self.shown += 1
            self.shown_s = t_s if not isfinite(self.shown_s) else self.shown_s
        if isfinite(check.value) and check.sigma > 0:
            z = (check.value - truth) / check.sigma
            self.last, self.sigma = check.value, check.sigma
            self.looks, self.squares, self.worst = self.looks + 1, self.squares + z * z, max(self.worst, abs(z))


@dataclass
class Outcome:
    """Holds what came of a run.

    closed, ok: shares of the session in which the contact was closed and the line reported OK. closed_s, ok_s: first
    times, NaN for never. faults: names in the order in which they were reported. fault_s, named_s, opened_s: from the
    onset of the hazard, or from the start, until the first FAULT, until all that is wrong was named at once, and until
    the contact was open permanently. warnings, halts: how often these states began. ok_beyond_s, ok_gross_s: for how
    long it reported OK with a parameter 1.3 and 2 times its limit away; closed_gross_s: for how long the contact was
    closed while a parameter was 2 times its limit away. nats: largest log likelihood ratio of the sequential test, with
    a hazard since its onset; NaN where it had nothing to test. cost_ms, cost_99_ms: processor time per picture. point:
    coverage of the error of a point.
    """

    frames: int = 0
    closed: float = 0.0
    ok: float = 0.0
    closed_s: float = nan
    ok_s: float = nan
    faults: str = ""
    fault_s: float = nan
    named_s: float = nan
    opened_s: float = nan
    warnings: int = 0
    halts: int = 0
    ok_beyond_s: float = 0.0
    ok_gross_s: float = 0.0
    closed_gross_s: float = 0.0
    nats: float = nan
    cost_ms: float = 0.0
    cost_99_ms: float = 0.0
    last_reason: str = ""
    point: Coverage = field(default_factory=Coverage)
    scores: dict[str, Scores] = field(default_factory=lambda: {name: Scores() for name in MEASURED})

    def row(self) -> dict[str, str]:
        """Returns column → cell; what is not known is empty."""
        row = {one.name: cell(getattr(self, one.name)) for one in fields(self) if one.name not in ("point", "scores")}
        parts: dict[str, Coverage | Scores] = {"point": self.point, **self.scores}
        for name, scores in parts.items():
            for one in fields(scores):
                row[f"{name} {one.name}"] = cell(getattr(scores, one.name))
        return row


def run(conditions: Conditions, pictures: list[GreyImage]) -> Outcome:
    """Runs the line over a session, and counts what it reports. pictures: those of `tools.study.samples.rendered`."""
    session, judging, limits = conditions.session, conditions.judging, conditions.judging.limits
    line, outcome = Line(session.reference, limits), Outcome()
    timeline = Timeline(stamp_ns(0.0), stamp_ns(0.0), stamp_ns(session.duration_s), judging)
    notes, costs_ms = _Notes(conditions, limits, outcome, line), [0.0]
    for sample in samples(conditions, pictures):
        began_s = time.process_time()
        verdicts = line.step(sample)
        costs_ms[-1] += (time.process_time() - began_s) * 1e3
        if isinstance(sample, Frame):
            costs_ms.append(0.0)
        timeline.step(sample, verdicts)
        for verdict in verdicts:
            notes.take(verdict)
    timeline.finish()
    notes.finish()
    outcome.cost_ms, outcome.cost_99_ms = float(np.mean(costs_ms)), float(np.quantile(costs_ms, 0.99))
    _read(timeline.changes, conditions, limits, outcome)
    least = bounds(session, conditions.tracker.noise_mm, conditions.tracker.noise_deg)
    for scores, bound in zip(outcome.scores.values(), least, strict=True):
        scores.bound = float(bound)
    return outcome


class _Notes:
    """Reads the verdicts of the line into the outcome."""

    def __init__(self, conditions: Conditions, limits: Limits, outcome: Outcome, line: Line) -> None:
        self._conditions, self._outcome, self._limits, self._line = conditions, outcome, limits, line
        self._places_mm = places_mm(conditions)
        self._looked_ns, self._looks = 0, 0
        self._last_s = 0.0
        self._named: list[str] = []

    def take(self, verdict: Verdict) -> None:
        outcome, t_s, nats = self._outcome, seconds(verdict.t_ns), self._line.nats
        if nats is not None and self._after_s(t_s) >= 0:
            outcome.nats = float(np.fmax(outcome.nats, nats))
        outcome.frames += 1
        since_s, self._last_s = max(t_s - self._last_s, 0.0), t_s
        if verdict.kind is VerdictKind.OK:
            outcome.ok += since_s
            outcome.ok_s = t_s if not isfinite(outcome.ok_s) else outcome.ok_s
            misfit = gross(self._conditions, self._limits, t_s)
            outcome.ok_beyond_s += since_s * (misfit >= _BEYOND)
            outcome.ok_gross_s += since_s * (misfit >= _GROSS)
        if verdict.fault is not None:
            self._fault(verdict.fault, t_s)
            self._note_named(verdict, t_s)
        if verdict.t_ns - self._looked_ns >= _EVERY_NS:
            self._looked_ns = verdict.t_ns
            self._look(verdict, t_s)

    def finish(self) -> None:
        self._outcome.faults = " ".join(self._named)
        self._outcome.ok /= self._conditions.session.duration_s
        for scores in self._outcome.scores.values():
            scores.shown /= max(self._looks, 1)

    def _after_s(self, t_s: float) -> float:
        """Returns the time since the onset of the hazard, or since the start where there is none."""
        onset_s = self._conditions.hazard.onset_s
        return t_s - (onset_s if isfinite(onset_s) else 0.0)

    def _fault(self, fault: str, t_s: float) -> None:
        after_s = self._after_s(t_s)
        if after_s >= 0 and not isfinite(self._outcome.fault_s):
            self._outcome.fault_s = after_s
        if fault not in self._named:
            self._named.append(fault)

    def _note_named(self, verdict: Verdict, t_s: float) -> None:
        wrong, after_s = self._conditions.hazard.faults, self._after_s(t_s)
        named = {check.fault for check in verdict.checks if check.verdict is VerdictKind.FAULT}
        if wrong and wrong <= named and after_s >= 0 and not isfinite(self._outcome.named_s):
            self._outcome.named_s = after_s

    def _look(self, verdict: Verdict, t_s: float) -> None:
        self._looks += 1
        truth = _truth(self._conditions, t_s)
        for check in verdict.checks:
            if check.name in self._outcome.scores:
                self._outcome.scores[check.name].look(check, truth[MEASURED.index(check.name)], t_s)
        self._outcome.last_reason = verdict.reason
        bounds = None if verdict.point is None else self._line.point_bounds(verdict.t_ns, self._places_mm)
        if bounds is not None:
            self._outcome.point.look(bounds, errors_mm(self._conditions, t_s, self._places_mm))


def gross(conditions: Conditions, limits: Limits, t_s: float) -> float:
    """Returns the largest |error| ÷ limit at t_s; infinite for a polarity or a pose convention that is wrong."""
    gone = (one for one in conditions.hazard.each if one.fault in (Fault.POLARITY, Fault.POSE_CONVENTION))
    if any(one.share(np.array([t_s]))[0] for one in gone):
        return np.inf
    return float(np.max(np.abs(_truth(conditions, t_s) / PER_UNIT) / limit_of_each(limits)))


def _truth(conditions: Conditions, t_s: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Returns what the estimates should be, (9,) deg, %, mm, ms."""
    return np.asarray(conditions.hazard.change(np.array([t_s]))[0] * PER_UNIT)


def _closed(changes: list[Change], end_s: float) -> Iterator[tuple[float, float]]:
    """Yields the spans in which the contact was closed, s."""
    for change, after_s in spells(changes, end_s):
        if change.state is State.MONITORING:
            yield change.t_s, after_s


def closed_share(changes: list[Change], duration_s: float) -> float:
    """Returns the share of the session during which the contact was closed; 0 for one without any length."""
    closed_s = sum(end - start for start, end in _closed(changes, duration_s))
    return closed_s / duration_s if duration_s > 0 else 0.0


def _read(changes: list[Change], conditions: Conditions, limits: Limits, outcome: Outcome) -> None:
    """Reads the supervisor's changes of state into the outcome."""
    duration_s, onset_s = conditions.session.duration_s, conditions.hazard.onset_s
    spells = list(_closed(changes, duration_s))
    outcome.closed = closed_share(changes, duration_s)
    outcome.closed_s = spells[0][0] if spells else nan
    if isfinite(onset_s) and (not spells or spells[-1][1] < duration_s):
        outcome.opened_s = max(spells[-1][1] - onset_s, 0.0) if spells else 0.0
    outcome.warnings = sum(change.state is State.WARNING for change in changes)
    outcome.halts = sum(change.state is State.HALT for change in changes)
    for start, end in spells:
        steps = np.arange(start, end, 0.1)
        outcome.closed_gross_s += 0.1 * sum(gross(conditions, limits, t) >= _GROSS for t in steps)


def cell(value: object) -> str:
    """Returns the text of a value, a number with six digits; empty where a number is not known."""
    if isinstance(value, float):
        return f"{value:.6g}" if isfinite(value) else ""
    return str(value)
