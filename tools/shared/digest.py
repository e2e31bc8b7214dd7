"""Computes the SHA-256 and the state of files, by which a report or a table recognises a recording."""

import hashlib
from collections.abc import Iterable
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path

from probewatch.drivers.errors import RecordingError
from probewatch.drivers.files.regular_file import reading

HEADERS = (".mha", ".mhd", ".nrrd", ".nhdr")
"""Suffixes of recordings whose pictures may lie in a separate file beside them."""
_NAMES_DATA = (b"ElementDataFile", b"data file", b"datafile")
_OWN = ("", ".", "..", "LOCAL")
_NO_NAME = ("/", "\\", "\0", "%")
_COPY_BYTES = 1 << 20
"""Bytes read at once: more is no faster. Not measured."""


def file_sha256(path: Path) -> str:
    """Returns the SHA-256 of a file of any size, in hexadecimal. Raises RecordingError."""
    return files_sha256((path,))


def files_sha256(paths: Iterable[Path]) -> str:
    """Returns the SHA-256 of the files joined in order, as `cat` would join them, in hexadecimal. Raises
    RecordingError.
    """
    digest = hashlib.sha256()
    for path in paths:
        try:
            with reading(path) as stream:
                while data := stream.read(_COPY_BYTES):
                    digest.update(data)
        except OSError as error:
            raise _unreadable(path, error) from None
    return digest.hexdigest()


def files_state(paths: Iterable[Path]) -> str:
    """Returns, as text, how many bytes the files have and when the last of them was written. Raises RecordingError."""
    size, last_ns = 0, 0
    for path in paths:
        try:
            found = path.stat()
        except OSError as error:
            raise _unreadable(path, error) from None
        size, last_ns = size + found.st_size, max(last_ns, found.st_mtime_ns)
    whole_s, rest_ns = divmod(last_ns, 1_000_000_000)
    return f"{size} bytes of {datetime.fromtimestamp(whole_s, UTC):%Y-%m-%dT%H:%M:%S}.{rest_ns:09}Z"


def with_pictures(path: Path) -> tuple[Path, ...]:
    """Returns the file and, for a header that names one, the file beside it that has its pictures."""
    if path.suffix.lower() not in HEADERS:
        return (path,)
    try:
        with reading(path) as stream:
            name = pictures_named(stream)
        beside = path if name is None else path.with_name(name)
        return (path, beside) if beside != path and beside.is_file() else (path,)
    except (OSError, ValueError):  # the reader of the recording reports what is wrong
        return (path,)


def pictures_named(stream: Iterable[bytes]) -> str | None:
    """Returns the name of the file beside a header that has its pictures; None where they are in the header's own file,
    or where the reader of recordings accepts no such name. Raises ValueError for a name that is not text.
    """
    lines = iter(stream)
    first = next(lines, b"")
    for line in chain((first,), lines):
        if line.startswith(_NAMES_DATA):
            name = line.replace(b":", b"=").partition(b"=")[2].strip().decode().removeprefix("./")
            return None if name in _OWN or any(mark in name for mark in _NO_NAME) else name
        if first.startswith(b"NRRD") and not line.strip():
            return None
    return None


def _unreadable(path: Path, error: OSError) -> RecordingError:
    return RecordingError(f"cannot be read: {error.strerror}", str(path), "Check the path and its permissions")
