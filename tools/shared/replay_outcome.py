"""Formats the result of a replay as JSON and as text."""

import sys
from dataclasses import dataclass
from pathlib import Path

import click
from rich.console import Console

from probewatch.appliance.core.handeye.second_opinion import SecondOpinion
from probewatch.appliance.core.quality.check_fields import limits_fields, point_fields
from probewatch.appliance.core.quality.report import Change, LineReport, report_json
from probewatch.appliance.types import Calibration, Check
from probewatch.tools.shared.point_text import point_text
from probewatch.tools.shared.profile_text import profile_text
from probewatch.tools.shared.rerun import Comparison, why_unusable
from probewatch.tools.shared.subject import Subject
from probewatch.tools.shared.tables import NOTHING, FittingTable


@dataclass(frozen=True)
class Outcome:
    """Holds the result of one recording. `nominal` is the named calibration, None for a black box judged by its own.
    `damage` describes the file's damage. `notes` says how its pictures were turned, and what of it is not read.
    """

    path: Path
    report: LineReport
    timeline: list[Change]
    nominal: Calibration | None = None
    comparison: Comparison | None = None
    damage: str = ""
    notes: tuple[str, ...] = ()

    @property
    def unusable_because(self) -> str:
        """Returns `why_unusable` of this recording."""
        return why_unusable(self.report, self.comparison)

    def fields(self) -> dict[str, object]:
        """Returns the report's public contract; `black_box` is there for a black box judged by its own calibration."""
        fields = report_json(self.report, self.timeline)
        found = self.comparison
        return fields if found is None else {**fields, "black_box": _box_fields(found, self.damage)}


def _box_fields(comparison: Comparison, damage: str) -> dict[str, object]:
    return {
        "recorded_verdicts": comparison.recorded,
        "equal_verdicts": comparison.equal,
        "bit_for_bit": comparison.exact if comparison.recorded else None,
        "first_difference": comparison.difference or None,
        "gaps": comparison.gaps,
        "verdicts_without_past": comparison.without_past,
        "equal_anyway": comparison.equal_anyway,
        "same_kind_and_fault": comparison.alike,
        "ok_only_live": comparison.unproved,
        "ok_only_now": comparison.proved,
        "told_live": [
            {"t_s": one.t_ns / 1e9, "state": one.state, "fault": one.fault or None, "reason": one.reason}
            for one in comparison.told
        ],
        "text": comparison.text,
        "damage": damage or None,
    }


def print_outcome(outcome: Outcome, subject: Subject) -> None:
    """Prints the result, the latest verdict last."""
    report = outcome.report
    if subject.spoiled:
        click.secho(subject.spoiled, fg="red", bold=True)
    for name, said in subject.rows():
        click.echo(f"{name + ':':<18}{said}")
    _print_input(outcome)
    Console(file=sys.stdout, highlight=False).print(_table(report), crop=False)
    click.echo(f"{report.motions} motions of the probe went into the estimate")
    if report.follow is not None and report.follow.gives_way:
        share, sigma = 100 * report.follow.share, 100 * report.follow.sigma
        click.echo(f"the tissue gives way: it follows the probe's face by {share:.0f} ± {sigma:.0f} %")
    if report.second_opinion is not None:
        click.echo(_second_opinion(report.second_opinion))
    click.echo(profile_text(limits_fields(report.limits)))
    click.echo(point_text(point_fields(report.verdict.t_ns, report.verdict.point, report.limits.region)))
    _print_states(outcome)
    if report.proposal is not None:
        click.echo("\n".join(f"→ {clause}" for clause in report.proposal.text.split("; ")))
    fault = f" · {report.verdict.fault}" if report.verdict.fault else ""
    spoiled = f"{subject.spoiled}; " if subject.spoiled else ""
    click.echo(f"{spoiled}verdict: {report.verdict.kind.value}{fault}  {report.verdict.reason}")


def _print_input(outcome: Outcome) -> None:
    """Prints what was read, and what was not."""
    report = outcome.report
    click.echo(f"{outcome.path.name}: {report.frames} frames, {report.poses} poses, {report.paired} paired")
    if outcome.damage:
        click.secho(f"  damaged: {outcome.damage}", fg="yellow")
    for note in outcome.notes:
        click.echo(f"  {note}")
    if outcome.comparison is not None:
        click.echo(f"  {outcome.comparison.sentence}")
    for reason, number in report.unpaired.items():
        click.echo(f"  {number} not paired: {reason}")
    for reason, number in report.unusable.items():
        click.echo(f"  {number} poses cannot be used: {reason}")


def _print_states(outcome: Outcome) -> None:
    """Prints the states as judged now, then those reported live."""
    for change in outcome.timeline:
        click.echo(f"{change.t_s:8.2f} s  {change.state.value}: {change.reason}")
    for told in () if outcome.comparison is None else outcome.comparison.told:
        click.echo(f"{told.t_ns / 1e9:8.2f} s  reported live: {told.state}: {told.reason}")


def _second_opinion(opinion: SecondOpinion) -> str:
    lateral, axial = (
        f"{scale:.4f} ± {scale * sigma:.4f}"
        for scale, sigma in zip(opinion.scale_mm_per_px, opinion.sigma[3:], strict=True)
    )
    return f"closed form, without the reference ({opinion.form}, {opinion.pairs} pairs): {lateral} and {axial} mm/px"


def _table(report: LineReport) -> FittingTable:
    latency = () if report.latency is None or report.latency in report.checks else (report.latency,)
    headings = ("check", "value", "± 1σ", "limit", "of limit", "verdict")
    return FittingTable(headings, [_cells(check) for check in (*latency, *report.checks)])


def _cells(check: Check) -> tuple[str, ...]:
    if check.value != check.value:
        return check.name, NOTHING, NOTHING, f"{check.limit:g} {check.unit}", NOTHING, check.verdict.value
    value, sigma = f"{check.value:.3g} {check.unit}", f"{check.sigma:.2g}"
    return check.name, value, sigma, f"{check.limit:g} {check.unit}", f"{check.ratio:.3g}", check.verdict.value
