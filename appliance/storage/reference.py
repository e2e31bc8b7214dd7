"""Represents a calibration together with the file it came from: as a candidate for the reference, and in force."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from probewatch.appliance.configuration.config import CalibrationPlace, Config
from probewatch.appliance.storage.calibration_file import calibration_bytes, is_device_set, parse_calibration
from probewatch.appliance.storage.reference_store import Entry, content_of, read_history, sha256_of
from probewatch.appliance.types import Calibration
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.samples import Matrix4

Size = tuple[int, int]


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """Represents a calibration that may become the reference.

    content: that of its file, sha256: of the content. file: where it was. probe: names the transform of a device set
    that was taken.
    """

    calibration: Calibration
    content: bytes
    sha256: str
    file: str
    probe: str


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Represents the candidate that is in force, with its entry in the history."""

    entry: Entry
    candidate: Candidate

    @property
    def calibration(self) -> Calibration:
        return self.candidate.calibration

    @property
    def relative_pose(self) -> Matrix4 | None:
        """Returns the pose as it was kept; see `appliance.core.estimator_settings.EstimatorSettings`."""
        return None if self.entry.relative_pose is None else np.array(self.entry.relative_pose).reshape(4, 4)


def candidate_from_content(content: bytes, file: str, size_px: Size | None, probe: str) -> Candidate:
    """Returns the candidate in a file's content. size_px: (width, height) of the pictures, which a device set needs and
    our TOML must agree with where the configuration states it. Raises ConfigurationError.
    """
    calibration = parse_calibration(content, Path(file), size_px, probe)
    return Candidate(calibration, content, sha256_of(content), file, probe)


def refuse_simulated(candidate: Candidate, simulated: Sequence[str]) -> None:
    """Raises ConfigurationError for a calibration that a real cart cannot use. simulated: URLs of the cart's sources
    that are not real devices.
    """
    if candidate.calibration.simulated and not simulated:
        what = "was made of a simulated scan and cannot be the reference of a cart with real devices"
        raise ConfigurationError(what, candidate.file, "Scan the cross-wire with this probe: docs/recalibration.md")


def candidate_of_entry(folder: Path, entry: Entry) -> Candidate:
    """Returns an earlier reference as it was. folder: of the alarm log. Raises ConfigurationError."""
    return candidate_from_content(content_of(folder, entry), entry.file, entry.image_size_px, entry.probe)


def size_for(content: bytes, place: CalibrationPlace, seen_px: Size | None) -> Size | None:
    """Returns (width, height) for reading the content: that of the configuration, else, for a device set, that of the
    pictures seen.

    Our TOML states its own; pictures of another size are then a fault of the picture, not of the file.
    """
    return place.image_size_px or (seen_px if is_device_set(content) else None)


def in_force(config: Config, seen_px: Size | None = None) -> Candidate:
    """Returns the reference that the service of this configuration continues with, as on its disk. seen_px: size of the
    pictures, where they are available. Raises ConfigurationError.
    """
    history = read_history(config.alarm.folder)
    if history is not None and history.in_force is not None:
        return candidate_of_entry(config.alarm.folder, history.in_force)
    place = config.calibration
    if place.file is None:
        what = "names no calibration, and none was scanned yet"
        raise ConfigurationError(what, "[calibration] file", "Scan the first one: probewatch recalibrate --live")
    content = calibration_bytes(place.file)
    return candidate_from_content(content, str(place.file), size_for(content, place, seen_px), place.probe)
