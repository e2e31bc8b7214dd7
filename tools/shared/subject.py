"""Identifies the subject of a replay report, so that it can be traced later: recording, calibration, limits and
injected faults.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from probewatch.drivers.twins.faults import Schedule
from probewatch.tools.shared.digest import file_sha256

_SHOWN = 12
"""Number of digits of a SHA-256 that a person compares."""
_OF_BOX = "as recorded in the black box"


@dataclass(frozen=True)
class Subject:
    """Holds each file of a report's subject with its SHA-256. `recording` lists the files of the recording, including
    poses recorded apart. `calibration` and `configuration` are the files used to judge it; None for those of the black
    box, and, beside a calibration, for the shipped limits. `injected` lists faults put in on purpose.
    """

    recording: tuple[tuple[Path, str], ...]
    calibration: tuple[Path, str] | None
    configuration: tuple[Path, str] | None
    injected: tuple[str, ...]
    software: str
    utc: str

    @classmethod
    def of(
        cls, recording: Sequence[Path], calibration: Path | None, configuration: Path | None, schedule: Schedule
    ) -> "Subject":
        """Returns the subject. Reads each file once. Raises ConfigurationError."""
        return cls(
            tuple((path, file_sha256(path)) for path in recording),
            None if calibration is None else (calibration, file_sha256(calibration)),
            None if configuration is None else (configuration, file_sha256(configuration)),
            tuple(f"{episode.fault}@{episode.from_s:g}" for episode in schedule.episodes),
            f"probewatch {version('probewatch')}",
            datetime.now(UTC).isoformat(timespec="seconds"),
        )

    @property
    def spoiled(self) -> str:
        """Returns the injected faults, for a warning in the title; empty without any."""
        return f"SPOILED on purpose: --inject {', '.join(self.injected)}" if self.injected else ""

    def rows(self) -> list[tuple[str, str]]:
        """Returns the subject as rows of a table."""
        judged = _OF_BOX if self.calibration is None else _named(self.calibration)
        unnamed = _OF_BOX if self.calibration is None else "as probewatch ships them"
        limits = unnamed if self.configuration is None else _named(self.configuration)
        return [
            *(("recording", _named(file)) for file in self.recording),
            ("calibration", judged),
            ("limits and times", limits),
            ("made", f"{self.utc}, {self.software}"),
        ]

    def fields(self) -> dict[str, object]:
        """Returns the subject for JSON."""
        return {
            "recording": [_fields(file) for file in self.recording],
            "calibration": None if self.calibration is None else _fields(self.calibration),
            "configuration": None if self.configuration is None else _fields(self.configuration),
            "injected": [*self.injected],
            "software": self.software,
            "utc": self.utc,
        }


def _named(file: tuple[Path, str]) -> str:
    return f"{file[0].name}, SHA-256 {file[1][:_SHOWN]}…"


def _fields(file: tuple[Path, str]) -> dict[str, str]:
    return {"file": str(file[0]), "sha256": file[1]}
