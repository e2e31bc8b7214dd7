"""Writes the calibration estimated from a recording as a file."""

from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np

from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.types import PARAMETERS, Calibration
from probewatch.drivers.errors import RecordingError

_NEEDED = PARAMETERS[:5]
"""These are the rotations and scales: the offset follows from a cross-wire scan with `recalibrate --solve offset`."""


def write_estimate(path: Path, estimate: Calibration | None, nominal: Calibration, recording: Path) -> None:
    """Writes the estimate. `nominal` is its starting point and supplies the parameters not observed. Raises
    RecordingError where the motion does not determine rotation and scales, ConfigurationError where the file cannot be
    written.
    """
    seen = () if estimate is None else estimate.observed
    missing = [name for name, shown in zip(_NEEDED, seen or (False,) * len(_NEEDED), strict=False) if not shown]
    if estimate is None or missing:
        what = f"does not show {', '.join(missing)} of the calibration"
        remedy = "Record a minute of tissue: to and fro sideways and in depth, tilted and turned by 10 to 20 degrees"
        raise RecordingError(what, str(recording), remedy)
    offset_mm = np.where(estimate.observed[5:], estimate.offset_mm, nominal.offset_mm)
    write_calibration(
        path,
        replace(estimate, offset_mm=offset_mm, simulated=nominal.simulated),
        {
            "when": datetime.now(UTC).isoformat(timespec="seconds"),
            "how": f"probewatch {version('probewatch')} replay --estimate",
            "input": str(recording.absolute()),
        },
    )
