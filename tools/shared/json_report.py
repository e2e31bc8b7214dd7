"""Reports as JSON files: each appears whole or not at all."""

import json
from collections.abc import Mapping
from pathlib import Path

from drivers.files.atomic_file import writing


def write_json(path: Path, report: Mapping[str, object]) -> None:
    """Replace the file at path. Raises ConfigurationError, ValueError for a number that is not finite."""
    with writing(path) as stream:
        stream.write(json.dumps(report, indent=2, allow_nan=False).encode() + b"\n")
