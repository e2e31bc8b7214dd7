"""What the instrument says of real recordings, a row for each; no truth is known there."""

from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from appliance.core.line import Line
from appliance.core.quality.report import LineReport
from appliance.limits import Limits
from appliance.storage.calibration_file import read_calibration
from appliance.supervision.timeline import Judging
from appliance.types import VerdictKind
from drivers.errors import ProbewatchError
from drivers.recordings.replay import open_recording
from drivers.twins.faults import Schedule
from tools.shared.recording_run import run
from tools.study.outcome import CHECKS, cell, closed_share

ARCHIVE_KEYS = ("recording",)
"""Columns that name a row."""


@dataclass(frozen=True)
class ArchiveTask:
    """One recording, and the calibration of its probe."""

    recording: Path
    calibration: Path

    def rows(self) -> list[dict[str, str]]:
        """One row; what cannot be used has its error in it, so that the rest of an archive goes on."""
        row = {"recording": str(self.recording), **dict.fromkeys(_COLUMNS, "")}
        try:
            return [row | self._said()]
        except ProbewatchError as error:
            return [row | {"error": str(error)}]

    def _said(self) -> dict[str, str]:
        session = open_recording(self.recording)
        calibration = read_calibration(self.calibration, session.size_px, "Probe")
        judging = Judging(Limits())
        report, changes = run(session, Line(calibration, judging.limits), Schedule(), judging)
        start_ns, end_ns = session.overlap_ns
        duration_s = max(end_ns - start_ns, 0) / 1e9
        row = {
            "duration_s": cell(duration_s),
            "frames": cell(report.frames),
            "paired": cell(report.paired),
            "closed": cell(closed_share(changes, duration_s)),
            "verdict": report.verdict.kind.value,
            "fault": report.verdict.fault or "",
            "reason": report.verdict.reason,
            "missing": " ".join(missing(report)),
        }
        for check in report.checks:
            if check.name in CHECKS:
                row |= {f"{check.name} last": cell(check.value), f"{check.name} sigma": cell(check.sigma)}
        return row


_OF_EACH = tuple(f"{name} {what}" for name in CHECKS for what in ("last", "sigma"))
_COLUMNS = ("duration_s", "frames", "paired", "closed", "verdict", "fault", "reason", "missing", "error", *_OF_EACH)


def missing(report: LineReport) -> list[str]:
    """Required parameters that nothing in the recording showed."""
    shown = {check.name for check in report.checks if check.verdict is VerdictKind.OK and isfinite(check.value)}
    return [name for name in Limits().required_age_s.names if name not in shown]
