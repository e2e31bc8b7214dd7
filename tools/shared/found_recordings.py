"""Finds the recordings that arguments name: files, folders, and the files of a recorder."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from appliance.storage.black_box import BlackBox, Series, series_of
from drivers.errors import ConfigurationError, RecordingError
from drivers.files.regular_file import reading
from drivers.recordings.mcap_file import MAGIC

SUFFIXES = (".mha", ".mhd", ".nrrd", ".nhdr", ".mcap")
"""What is taken out of a folder; films and tables belong together by their names alone, so they are named."""


def found(paths: Sequence[Path]) -> tuple[list[Path | Series], list[str]]:
    """Returns the recordings in the order in which they were named, and messages about files in folders that cannot be
    read; the files of one run of a recorder are one recording. Raises ConfigurationError for a folder without
    recordings, RecordingError for a named file that cannot be read.
    """
    sequences: list[Path | Series] = []
    boxes: list[BlackBox] = []
    refused: list[str] = []
    for path in paths:
        for file in _files(path) if path.is_dir() else (path,):
            try:
                if is_box(file):
                    boxes.append(BlackBox(file))
                else:
                    sequences.append(file)
            except RecordingError as error:
                if not path.is_dir():
                    raise
                refused.append(str(error))
    return [*sequences, *series_of(boxes)], refused


def _files(folder: Path) -> Iterator[Path]:
    files = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES and not path.is_dir())
    if not files:
        remedy = f"It looks for {', '.join(SUFFIXES)}; name a film or another file itself"
        raise ConfigurationError("holds no recordings", str(folder), remedy)
    return iter(files)


def is_box(path: Path) -> bool:
    """Whether the file begins as a black box does."""
    try:
        with reading(path) as stream:
            return stream.read(len(MAGIC)) == MAGIC
    except OSError:
        return False  # whoever opens it says why
