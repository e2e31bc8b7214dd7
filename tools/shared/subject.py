"""What a replay report is of: without it nobody can tell later what was judged, by what, and whether it was spoiled."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from drivers.twins.faults import Schedule
from tools.shared.digest import file_sha256

_SHOWN = 12
"""Digits of a SHA-256 that a person compares."""


@dataclass(frozen=True)
class Subject:
    """recording: its files, with those of poses recorded apart. calibration, configuration: by which it was judged;
    None for what the black box brings, and for the limits that probewatch ships with. injected: what spoiled it on
    purpose.
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
        """Reads each file once. Raises ConfigurationError."""
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
        """What was injected, of which the title must warn; empty where nothing was."""
        return f"SPOILED on purpose: --inject {', '.join(self.injected)}" if self.injected else ""

    def rows(self) -> list[tuple[str, str]]:
        """Rows for people."""
        judged = "as recorded in the black box" if self.calibration is None else _named(self.calibration)
        limits = "as probewatch ships them" if self.configuration is None else _named(self.configuration)
        return [
            *(("recording", _named(file)) for file in self.recording),
            ("calibration", judged),
            ("limits and times", limits),
            ("made", f"{self.utc}, {self.software}"),
        ]

    def fields(self) -> dict[str, object]:
        """Ready for JSON."""
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
