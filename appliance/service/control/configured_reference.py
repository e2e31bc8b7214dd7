"""Reads the calibration that the configuration names, to compare it with the reference in force."""

from pathlib import Path

from probewatch.appliance.storage.calibration_file import calibration_bytes
from probewatch.appliance.storage.reference_store import sha256_of
from probewatch.drivers.errors import ConfigurationError

UNNAMED = "none"
"""Stands for the SHA-256 where the configuration names no calibration."""
_UNREADABLE = ""
_TAKE = "Take it with: probewatch calibration use"
_TAKE_ANY = "Name its file again, or take another: probewatch calibration use FILE"


def configured(file: Path | None, number: int) -> tuple[str, str, str]:
    """Returns the SHA-256 of the configured file, and what is wrong and what to do where it is not in force. number:
    that of the reference in force.
    """
    if file is None:
        gone = f"the configuration names no calibration any more, and reference {number} stays in force"
        return UNNAMED, gone, _TAKE_ANY
    try:
        sha256, trouble = sha256_of(calibration_bytes(file)), "was changed"
    except ConfigurationError as error:
        sha256, trouble = _UNREADABLE, error.what
    return sha256, f"{file} {trouble}, and is not in force", f"{_TAKE} {file}"
