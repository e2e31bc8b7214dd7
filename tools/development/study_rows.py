"""Reads the rows of a table that `probewatch study` wrote, for the pages that are made of it."""

import csv
from collections.abc import Collection
from pathlib import Path

from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.study.summary import Row


def study_rows(path: Path, columns: Collection[str], options: str = "") -> list[Row]:
    """Returns every row of the table. Raises ConfigurationError where one of the columns is missing.

    options: those of `probewatch study` without which it writes no such columns; for the message.
    """
    with path.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    if not rows or not set(columns) <= set(rows[0]):
        what = "is not a table of a study" + (f" with {options.lstrip('-')}" if options else "")
        written = " ".join(filter(None, ("probewatch study", options)))
        raise ConfigurationError(what, str(path), f"Give the study.csv that {written} wrote")
    return rows
