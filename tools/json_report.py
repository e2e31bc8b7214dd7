"""Reports as JSON files: whether one can be written is asked before the work, and it appears whole or not at all."""

import json
from collections.abc import Mapping
from pathlib import Path

from drivers.atomicfile import replacing
from drivers.errors import ConfigurationError


def check_writable(path: Path | None) -> None:
    """Raises ConfigurationError where no file can come to lie; None is no file."""
    if path is not None and (path.is_dir() or not path.absolute().parent.is_dir()):
        raise ConfigurationError("no file can be written here", str(path), "Name a file in a directory that exists")


def write_json(path: Path, report: Mapping[str, object]) -> None:
    """Replace the file at path. Raises ConfigurationError, ValueError for a number that is not finite."""
    try:
        with replacing(path) as stream:
            stream.write(json.dumps(report, indent=2, allow_nan=False).encode() + b"\n")
    except OSError as error:
        what = f"cannot be written: {error.strerror}"
        raise ConfigurationError(what, str(path), "Check the directory and its permissions") from error
