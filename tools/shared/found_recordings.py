"""Finds the recordings that arguments name: files, folders, and the files of a recorder."""

import errno
import os
from collections.abc import Sequence
from pathlib import Path

from probewatch.appliance.storage.black_box import BlackBox, Series, series_of
from probewatch.drivers.errors import ConfigurationError, RecordingError
from probewatch.drivers.files.regular_file import reading
from probewatch.drivers.recordings.mcap_file import MAGIC

SUFFIXES = (".mha", ".mhd", ".nrrd", ".nhdr", ".mcap")
"""Suffixes of the files that are used in a folder. Films and tables belong together only by their names, so they must
be named themselves."""

BOXES = (".mcap",)
"""Suffixes of the files that are used in a folder where only black boxes can be used."""


def found(paths: Sequence[Path], suffixes: Sequence[str] = SUFFIXES) -> tuple[list[Path | Series], list[str]]:
    """Returns the recordings in the order in which they were named, and messages about files in folders that cannot be
    read; the files of one run of a recorder are one recording. suffixes: those of the files that are used in a folder.
    Raises ConfigurationError for a folder without recordings, RecordingError for a named file that cannot be read.
    """
    sequences: list[Path | Series] = []
    boxes: list[BlackBox] = []
    refused: list[str] = []
    for path in paths:
        files = _files(path, suffixes, refused) if path.is_dir() else [path]
        for file in files:
            try:
                if is_box(file) or _named_box(file):
                    boxes.append(BlackBox(file))
                else:
                    sequences.append(file)
            except RecordingError as error:
                if not path.is_dir():
                    raise
                refused.append(str(error))
    return [*sequences, *series_of(boxes)], refused


def _files(folder: Path, suffixes: Sequence[str], refused: list[str]) -> list[Path]:
    """Returns the recordings in the folder. Adds a message to `refused` for each folder in it that cannot be listed."""
    unread: list[OSError] = []
    there = (Path(at, name) for at, _, names in os.walk(folder, onerror=unread.append) for name in names)
    files = sorted(path for path in there if path.suffix.lower() in suffixes)
    told = [f"{error.filename}: cannot be looked into: {error.strerror}" for error in unread]
    if unread and not files:
        what, remedy = f"cannot be looked into: {unread[0].strerror}", "Check its permissions, or be its owner"
        raise ConfigurationError(what, str(unread[0].filename), remedy)
    refused += told
    if not files:
        what, remedy = "holds no recordings", f"It looks for {', '.join(suffixes)}; name a film or another file itself"
        if tuple(suffixes) == BOXES:
            what, remedy = "holds no black box", "Name a folder of probewatch record, such as its kept, or .mcap files"
        raise ConfigurationError(what, str(folder), remedy)
    return files


def _named_box(path: Path) -> bool:
    """Returns whether the file has the suffix of a black box, whatever it holds: an empty one cannot be recognised by
    its first bytes.
    """
    return path.suffix.lower() == ".mcap" and path.is_file() and os.access(path, os.R_OK)


def is_there(path: Path) -> bool:
    """Returns whether a file or folder has this name. Raises RecordingError where this user may not look for it, or may
    not read it.
    """
    try:
        if not path.exists():
            return False
        if not os.access(path, os.R_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    except OSError as error:
        raise RecordingError(
            f"cannot be read: {error.strerror}", str(path), "Check the path and its permissions"
        ) from None
    return True


def is_box(path: Path) -> bool:
    """Returns whether the file begins as a black box does."""
    try:
        with reading(path) as stream:
            return stream.read(len(MAGIC)) == MAGIC
    except OSError:
        return False  # the code that opens it reports why
