"""Runs a recording through pipeline and supervisor, as fast as possible."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Protocol

from probewatch.appliance.core.line import Line
from probewatch.appliance.core.quality.report import Change, LineReport
from probewatch.appliance.storage.black_box import Series
from probewatch.appliance.supervision.timeline import Judging, Timeline
from probewatch.appliance.types import Fault, Verdict, VerdictKind
from probewatch.drivers.errors import RecordingError
from probewatch.drivers.samples import Frame, Pose, Sample
from probewatch.drivers.twins.faults import Schedule
from probewatch.tools.shared.inject import inject
from probewatch.tools.shared.paths_followed import PathsFollowed, unit_asked
from probewatch.tools.shared.rerun import Comparison, Rerun, Step


class Session(Protocol):
    """Defines the interface of a recording; implemented by drivers.recordings.replay.Recording and by a black box."""

    @property
    def start_ns(self) -> int: ...

    @property
    def overlap_ns(self) -> tuple[int, int]: ...

    @property
    def left_out(self) -> dict[str, int]: ...

    @property
    def poses_left_out(self) -> dict[str, int]: ...

    def samples(self) -> Iterator[Sample]: ...


Seen = Callable[[Sample, tuple[Verdict, ...], Line], None]
"""(sample, the verdicts of the line on it, the line), for a function that draws it."""

_LOST = {"lose-video": Fault.VIDEO_LOST, "lose-tracker": Fault.TRACKER_LOST}
"""Faults that --inject makes by leaving samples out → what a cart says of them."""


def nobody(sample: Sample, verdicts: tuple[Verdict, ...], line: Line) -> None:
    """Ignores the sample and its verdicts."""


def run(
    session: Session,
    line: Line,
    schedule: Schedule,
    judging: Judging,
    watched: Callable[[Iterable[Sample]], Iterator[Sample]] = iter,
    seen: Seen = nobody,
) -> tuple[LineReport, list[Change]]:
    """Runs every sample through pipeline and supervisor; the report also counts what the reader left out.
    `watched` passes the samples on and shows the progress.
    """
    injected = [_LOST[episode.fault] for episode in schedule.episodes if episode.fault in _LOST]
    timeline = Timeline(session.start_ns, *session.overlap_ns, judging, injected)
    followed = PathsFollowed()
    for sample in watched(inject(session.samples(), schedule, session.start_ns)):
        verdicts = line.step(sample)
        timeline.step(sample, verdicts)
        followed.step(sample, line, session.start_ns)
        seen(sample, verdicts, line)
    timeline.finish()
    report = line.report()
    left_out = sum(session.left_out.values())
    report = replace(report, frames=report.frames + left_out, unpaired={**report.unpaired, **session.left_out})
    report = _with_unit(timeline.completed(report), unit_asked(followed.paths))
    poses = report.poses + sum(session.poses_left_out.values())
    return replace(report, poses=poses, unusable={**report.unusable, **session.poses_left_out}), timeline.changes


def _with_unit(report: LineReport, asked: str) -> LineReport:
    """Adds the question about the unit of the poses; none where they verified the calibration."""
    if not asked or report.verdict.kind is VerdictKind.OK:
        return report
    return replace(report, verdict=replace(report.verdict, reason=f"{report.verdict.reason}; {asked}"))


def run_series(
    series: Series,
    judging: Judging | None,
    watched: Callable[[Iterable[Step]], Iterator[Step]] = iter,
    seen: Seen = nobody,
) -> tuple[LineReport, list[Change], Comparison]:
    """Runs a black box through pipelines with its own settings; the report is that of the last one. `judging` None uses
    the limits of the first pipeline and the shipped times. Raises RecordingError where there was no pipeline.
    """
    settings = series.first_settings()
    if settings is None:
        what = "holds no reference that was in force, so nothing was judged"
        raise RecordingError(what, str(series.boxes[0].path), "Give --calibration")
    judging = judging or Judging(settings.limits)
    rerun, session = Rerun(series), BlackBoxSession(series)
    timeline = Timeline(session.start_ns, *session.overlap_ns, judging)
    for step in watched(rerun.steps()):
        if isinstance(step.item, Frame | Pose) and rerun.line is not None:
            timeline.step(step.item, step.verdicts)
            assert isinstance(rerun.line, Line)
            seen(step.item, step.verdicts, rerun.line)
    timeline.finish()
    if rerun.line is None:
        raise RecordingError("ends before there was a reference", str(series.boxes[0].path), "Give --calibration")
    report = timeline.completed(rerun.line.report())
    told = [one._replace(t_ns=one.t_ns - session.start_ns) for one in rerun.comparison.told]
    rerun.comparison.told = told
    return report, timeline.changes, rerun.comparison


class BlackBoxSession:
    """Represents the samples of a black box as one session, regardless of its pipelines."""

    left_out: dict[str, int] = {}  # noqa: RUF012  its gaps state what is missing
    poses_left_out: dict[str, int] = {}  # noqa: RUF012

    def __init__(self, series: Series) -> None:
        self._series = series
        self._pictures, self._poses = series.spans()
        first = next(self.frames(), None)
        self.size_px = None if first is None else (first.image.shape[1], first.image.shape[0])

    def __len__(self) -> int:
        return self._pictures.number + self._poses.number

    @property
    def start_ns(self) -> int:
        """Returns the earliest stamp, CLOCK_MONOTONIC of the cart."""
        return min((span.first_ns for span in (self._pictures, self._poses) if span.number), default=0)

    @property
    def overlap_ns(self) -> tuple[int, int]:
        """Returns the (first, last) stamp between which both devices were recorded; start_ns and the one before it
        where never.
        """
        if not self._pictures.number or not self._poses.number:
            return self.start_ns, self.start_ns - 1
        first_ns = max(self._pictures.first_ns, self._poses.first_ns)
        return first_ns, min(self._pictures.last_ns, self._poses.last_ns)

    def samples(self) -> Iterator[Sample]:
        """Yields the samples in the order in which the line took them."""
        for item, _ in self._series.items():
            if isinstance(item, Frame | Pose):
                yield item

    def frames(self) -> Iterator[Frame]:
        """Yields the pictures alone."""
        return (sample for sample in self.samples() if isinstance(sample, Frame))
