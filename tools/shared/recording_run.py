"""A recording through line and supervisor, as fast as it goes."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from appliance.core.line import Line
from appliance.core.quality.report import Change, LineReport
from appliance.supervision.timeline import Judging, Timeline
from appliance.types import Verdict, VerdictKind
from drivers.recordings.replay import Recording
from drivers.samples import Sample
from drivers.twins.faults import Schedule
from tools.shared.inject import inject


def run(
    session: Recording,
    line: Line,
    schedule: Schedule,
    judging: Judging,
    watched: Callable[[Iterable[Sample]], Iterator[Sample]] = iter,
) -> tuple[LineReport, list[Change]]:
    """Every sample through line and supervisor; the report counts the frames that the reader left out, too.

    watched: passes the samples on, to show how far it is.
    """
    timeline = Timeline(session.start_ns, *session.overlap_ns, judging)
    for sample in watched(inject(session.samples(), schedule, session.start_ns)):
        timeline.step(sample, line.step(sample))
    timeline.finish()
    report = line.report()
    left_out = sum(session.left_out.values())
    report = replace(report, frames=report.frames + left_out, unpaired={**report.unpaired, **session.left_out})
    return _with_devices(report, timeline), timeline.changes


def _with_devices(report: LineReport, timeline: Timeline) -> LineReport:
    """Add a device that was failing at the end; it names the verdict unless the line shows a fault of its own."""
    failing = timeline.lasting_fault()
    if failing is None:
        return report
    verdict = report.verdict
    if verdict.kind is not VerdictKind.FAULT:
        reason = timeline.changes[-1].reason
        verdict = Verdict(verdict.t_ns, VerdictKind.FAULT, (*verdict.checks, failing), failing.fault, reason)
    return replace(report, checks=(*report.checks, failing), verdict=verdict)
