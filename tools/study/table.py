"""Keeps the table of a study: one CSV file, a row for each run, that grows while the study lasts and can be
continued.
"""

import csv
import hashlib
import io
import os
import subprocess
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from pathlib import Path

from probewatch import appliance, drivers
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import check_folder_writable

INSTALL = "Install it, in the project's folder: .venv/bin/pip install '.[study]'"
"""Remedy where a package is missing that a cart does not need; probewatch is on no index, so it has a path."""

CODE = "code"
"""Column with the digest of the code that made the row."""
COMMIT = "commit"
"""Column with the commit that was checked out, or the version of an installed package."""
_DIGITS = 12
"""Hexadecimal digits of that digest: no two states of the code share them by chance."""


def code_digest() -> str:
    """Returns the digest of what a run's figures depend on: the sources of appliance, drivers and the study itself."""
    digest = hashlib.sha256()
    for root in (*(Path(str(package.__file__)).parent for package in (appliance, drivers)), Path(__file__).parent):
        for source in sorted((*root.rglob("*.py"), *root.rglob("*.[ch]"))):
            digest.update(source.relative_to(root).as_posix().encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()[:_DIGITS]


def commit() -> str:
    """Returns what was checked out; "+" means that files differed from it."""
    told = ("git", "-C", str(Path(__file__).parent), "describe", "--always", "--abbrev=12", "--exclude=*", "--dirty=+")
    try:
        return subprocess.run(told, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return f"version {version('probewatch')}"


class StudyTable:
    """Keeps the rows of one file. keys: columns that name a row. rows: those that were there and those added since.
    Raises ConfigurationError for a file that is something else, or has rows of other code.
    """

    def __init__(self, path: Path, keys: Sequence[str]) -> None:
        self.path, self._keys = path, tuple(keys)
        self._origin = {CODE: code_digest(), COMMIT: commit()}
        self._columns: list[str] = []
        self.rows: list[dict[str, str]] = []
        check_folder_writable(path.parent)
        try:
            if path.exists():
                path.open("r+b").close()
                self._read()
        except OSError as error:
            raise self._refusal(f"cannot be written to: {error.strerror}") from error

    @property
    def done(self) -> set[tuple[str, ...]]:
        """Returns the keys of all rows."""
        return {tuple(row[key] for key in self._keys) for row in self.rows}

    def add(self, rows: Iterable[dict[str, str]]) -> None:
        """Appends rows to the file; they are on the disk when this returns."""
        text = io.StringIO()
        writer: csv.DictWriter[str] | None = None
        for row in rows:
            whole = row | self._origin
            begin = not self._columns
            self._columns = self._columns or list(whole)
            writer = writer or csv.DictWriter(text, self._columns, lineterminator="\n")
            if begin:
                writer.writeheader()
            writer.writerow(whole)
            self.rows.append(whole)
        try:
            with self.path.open("a", encoding="utf-8", newline="") as stream:
                stream.write(text.getvalue())
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            what, remedy = (
                f"cannot be written: {error.strerror}",
                "Make room or check the permissions, and start it again",
            )
            raise ConfigurationError(what, str(self.path), f"{remedy}: what is done stays") from error

    def _read(self) -> None:
        whole = self.path.read_bytes()
        kept = whole[: whole.rfind(b"\n") + 1]
        try:
            reader = csv.DictReader(io.StringIO(kept.decode()), strict=True)
            rows = list(reader)
        except (UnicodeDecodeError, csv.Error) as error:
            raise self._refusal(f"is not a table of a study ({error})") from error
        self._columns = list(reader.fieldnames or ())
        if rows and not {*self._keys, *self._origin} <= set(self._columns):
            raise self._refusal("is not a table of this kind of study")
        if any(None in row or None in row.values() for row in rows):
            raise self._refusal("has a row with too many or too few cells")
        other = {row[CODE] for row in rows} - {self._origin[CODE]}
        if other:
            raise self._refusal(f"has rows of other code ({', '.join(sorted(other))}; this is {self._origin[CODE]})")
        self.rows = rows
        if len(kept) < len(whole):  # the last row was cut when the study was killed: it is done again
            with self.path.open("r+b") as stream:
                stream.truncate(len(kept))

    def _refusal(self, what: str) -> ConfigurationError:
        return ConfigurationError(what, str(self.path), "Give another folder with --output")
