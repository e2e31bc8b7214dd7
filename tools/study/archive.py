"""Runs the line over real recordings, and makes a row of the study's table for each; their truth is not known."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from probewatch.appliance.core.line import Line
from probewatch.appliance.core.parameters import MEASURED
from probewatch.appliance.core.quality.report import Change, LineReport
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.black_box import BlackBox, Series, series_of
from probewatch.appliance.storage.calibration_file import calibration_bytes, is_device_set, parse_calibration
from probewatch.appliance.supervision.timeline import Judging
from probewatch.drivers.errors import ConfigurationError, ProbewatchError, RecordingError
from probewatch.drivers.recordings.replay import open_recording
from probewatch.drivers.twins.faults import Schedule
from probewatch.tools.shared.digest import files_sha256, files_state, with_pictures
from probewatch.tools.shared.found_recordings import is_box
from probewatch.tools.shared.recording_run import BlackBoxSession, Session, run, run_series
from probewatch.tools.shared.rerun import Comparison, why_unusable
from probewatch.tools.shared.tables import NOTHING, FittingTable
from probewatch.tools.study.outcome import cell, closed_share
from probewatch.tools.study.store import NotFetchedError, fetched, state_of

NOT_FETCHED = "not fetched"
"""Beginning of the error of a recording that could not be fetched."""
NOTHING_TO_JUDGE = "nothing in it can be judged"
"""Beginning of the error of a recording that could be read, but shows too little."""
RECORD_BOTH = "Record pictures and poses together, while the probe moves"
ARCHIVE_KEYS = ("recording",)
"""Columns that name a row."""
CALIBRATION = "calibration_sha256"
"""Column with the file by which a recording was judged; empty for a black box that was judged by its own."""

NAMES = "names"
"""Column with the tools and the orientation that were named where the file does not state them."""
CONTENT, STATE = "recording_sha256", "recording_state"
"""Columns with the content that was judged (of several files in order), and with their size and time, or what their
store reports: these show whether a row was made of what is stored now."""


@dataclass(frozen=True)
class ArchiveTask:
    """Describes one recording, and the calibration of its probe: None for a black box, which has its own.

    recording: a path, or what names a recording of a store in the table. parts: the files of a black box. probe,
    reference, orientation: as open_recording takes them. urls: those of its files, where they lie in a store. content:
    that of the calibration's file, for workers that cannot read it themselves.
    """

    recording: Path | str
    calibration: Path | None
    judging: Judging | None = None
    parts: tuple[Path, ...] = ()
    probe: str | None = None
    reference: str | None = None
    orientation: str | None = None
    urls: tuple[str, ...] = ()
    content: bytes | None = None

    @property
    def judged_by(self) -> str:
        """Returns the SHA-256 of the calibration's file, empty without one."""
        return "" if self.content is None else hashlib.sha256(self.content).hexdigest()

    @property
    def names(self) -> str:
        """Returns what was named for it, as a row has it; empty for a black box."""
        named = {"probe": self.probe, "reference": self.reference, "orientation": self.orientation}
        is_box = self.parts or str(self.recording).endswith(".mcap")
        return "" if is_box else " ".join(f"{name}={value}" for name, value in named.items() if value is not None)

    @property
    def files(self) -> tuple[Path, ...]:
        """Returns all files of a recording on this computer."""
        return self.parts or with_pictures(Path(self.recording))

    @property
    def state(self) -> str:
        """Returns size and time of the files now, or what their store reports; empty where neither is known."""
        try:
            return state_of(self.urls) if self.urls else files_state(self.files)
        except RecordingError:
            return ""

    def is_of(self, row: Mapping[str, str]) -> bool:
        """Returns whether the row was made of the content that the recording has now. Where that cannot be determined,
        it is assumed.
        """
        state = self.state
        if not state or state == row[STATE]:
            return True
        if not row[STATE]:
            return not row["error"]  # it may be there by now
        return not self.urls and files_sha256(self.files) == row[CONTENT]

    def rows(self) -> list[dict[str, str]]:
        """Returns one row; a recording that cannot be used has its error in it, so that the rest of an archive goes on.
        An error that may be gone another time begins with NOT_FETCHED.
        """
        row = {"recording": str(self.recording), **dict.fromkeys(_COLUMNS, ""), CALIBRATION: self.judged_by}
        row[STATE], row[NAMES] = self.state, self.names
        try:
            if not self.urls:
                row[CONTENT] = files_sha256(self.files)
                return [row | self._said()]
            with fetched(self.urls) as files:
                row[CONTENT] = files_sha256(files)
                return [row | self._of(files)._said()]
        except NotFetchedError as error:
            return [row | {"error": f"{NOT_FETCHED}: {error}"}]
        except ProbewatchError as error:
            return [row | {"error": str(error)}]
        except Exception as error:  # what was judged before must not be lost to one file
            return [row | {"error": f"not judged, which is a defect of probewatch: {type(error).__name__}: {error}"}]

    def _of(self, files: tuple[Path, ...]) -> "ArchiveTask":
        """Returns the same task for copies on this computer."""
        boxes = files if all(is_box(file) for file in files) else ()
        return replace(self, recording=files[0], parts=boxes, urls=())

    def _said(self) -> dict[str, str]:
        report, changes, session, comparison = self._run()
        why = why_unusable(report, comparison)
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
            "missing": " ".join(report.missing),
            "error": why and f"{NOTHING_TO_JUDGE}: {why}",
            "live": "" if comparison is None else f"{comparison.equal} of {comparison.recorded}",
        }
        for check in report.checks:
            if check.name in MEASURED:
                row |= {f"{check.name} last": cell(check.value), f"{check.name} sigma": cell(check.sigma)}
        return row

    def _run(self) -> tuple[LineReport, list[Change], Session, Comparison | None]:
        if self.parts:
            series = self._series()
            box = BlackBoxSession(series)
            if self.calibration is None:
                report, changes, comparison = run_series(series, self.judging)
                return report, changes, box, comparison
            session: Session = box
            size_px = box.size_px
        else:
            session = recording = open_recording(
                Path(self.recording), probe=self.probe, reference=self.reference, orientation=self.orientation
            )
            size_px = recording.size_px
        if self.calibration is None:
            raise ConfigurationError("its calibration is not known", str(self.recording), "Give --calibration")
        content = calibration_bytes(self.calibration) if self.content is None else self.content
        if size_px is None and is_device_set(content):
            raise RecordingError("holds no pictures", str(self.recording), "Give the recording that has them")
        calibration = parse_calibration(content, self.calibration, size_px, self.probe or "Probe")
        judging = self.judging or Judging(Limits())
        report, changes = run(
            session, Line(calibration, judging.limits, judging.timeouts.stale_ns), Schedule(), judging
        )
        return report, changes, session, None

    def _series(self) -> Series:
        """Returns the series of the files. Raises RecordingError where they are of several runs."""
        found = series_of(BlackBox(path) for path in self.parts)
        if len(found) != 1:
            raise RecordingError(f"its files are of {len(found)} runs", str(self.recording), "Name them one by one")
        return found[0]


def archive_table(rows: list[dict[str, str]]) -> FittingTable:
    """Returns the table for the terminal. The last column gives the reason why a recording could not be judged."""
    heads = ("recording", "verdict", "fault", "closed", "not shown", "as live", "why")
    cells = [
        (Path(row["recording"]).name, row["verdict"] or "not usable", row["fault"] or NOTHING,
         f"{100 * float(row['closed']):.0f} %" if row["closed"] else NOTHING, row["missing"] or NOTHING,
         row["live"] or NOTHING, row["error"] or _few(row))
        for row in rows
    ]  # fmt: skip
    return FittingTable(heads, cells)


def refuse_all_unusable(rows: Sequence[Mapping[str, str]]) -> None:
    """Raises RecordingError where none of the recordings could be used, with the reason of the first."""
    if rows and all(row["error"] for row in rows):
        what = rows[0]["error"] if len(rows) == 1 else f"none of {len(rows)} can be used; the first: {rows[0]['error']}"
        raise RecordingError(what, rows[0]["recording"], RECORD_BOTH if NOTHING_TO_JUDGE in what else "")


def _few(row: dict[str, str]) -> str:
    """Returns the reason of the verdict where it is that most pictures have no pose; what was not shown means little
    then.
    """
    return row["reason"] if 2 * int(row["paired"] or 0) < int(row["frames"] or 0) else ""


_OF_EACH = tuple(f"{name} {what}" for name in MEASURED for what in ("last", "sigma"))
_COLUMNS = (
    "duration_s",
    "frames",
    "paired",
    "closed",
    "verdict",
    "fault",
    "reason",
    "missing",
    "live",
    "error",
    *_OF_EACH,
    CALIBRATION,
    NAMES,
    CONTENT,
    STATE,
)
