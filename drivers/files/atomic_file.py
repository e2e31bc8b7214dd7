"""Writes files that are either the old one or the whole new one, also after a power cut."""

import errno
import os
import pwd
import stat
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.regular_file import refuse_irregular

PAGE_BEGINS = b"<!doctype html>"
"""First bytes of every page that a command writes, for `check_replaceable`."""

PAGE_ENDS = (".html", ".htm")
"""Suffixes of the names of such a page."""
_KINDS = {
    **dict.fromkeys(PAGE_ENDS, "an HTML page"),
    ".pdf": "a PDF",
    ".csv": "a table, CSV",
    ".json": "JSON",
    ".toml": "TOML",
    ".xml": "XML",
    ".tfm": "an ITK transform",
    ".h5": "HDF5",
    ".prom": "metrics",
    ".txt": "plain text",
    ".mcap": "a black box",
    **dict.fromkeys((".mha", ".mhd", ".nrrd", ".nhdr"), "a sequence of pictures"),
    **dict.fromkeys((".mp4", ".mkv", ".avi"), "a film"),
    **dict.fromkeys((".png", ".jpg", ".jpeg", ".svg"), "a picture"),
}
"""Suffix of a name, in lower case → the kind of file that everybody takes it for."""


def sync_directory(directory: Path) -> None:
    """Makes renames inside the directory durable."""
    handle = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def make_folder(folder: Path, mode: int = 0o777) -> None:
    """Makes a folder and its parents, where missing; their names are on the disk when it returns. Raises OSError.

    mode: that of the folder itself.
    """
    if not folder.is_dir():
        make_folder(folder.parent)
        folder.mkdir(mode, exist_ok=True)
        sync_directory(folder.parent)


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """Yields the binary stream of a temporary file beside path, which takes path's name when the block ends well and is
    deleted otherwise.

    The data are on the disk before the rename, and the rename before the return. Raises OSError.

    It replaces whatever has the name, so it is for files of our own; `writing` is for those that people name.
    """
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as stream:
            os.fchmod(handle, 0o644)
            yield stream
            stream.flush()
            os.fsync(handle)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    sync_directory(path.parent)


@contextmanager
def writing(path: Path) -> Iterator[BinaryIO]:
    """Replaces, like replacing, a file that a person named: a device, a pipe or a folder of that name is refused and
    stays.

    Raises ConfigurationError, also for an OSError of the block.
    """
    try:
        refuse_irregular(path)
        with replacing(path) as stream:
            yield stream
    except OSError as error:
        raise _not_written(path, error) from error


def check_writable(path: Path | None) -> None:
    """Checks in advance that `writing` can write the file, before the work whose result it is to hold. None is no file.
    Raises ConfigurationError.
    """
    if path is None:
        return
    try:
        refuse_irregular(path)
        _refuse_folder(path.absolute().parent)
        if _is_of_another(path):
            raise OSError(errno.EPERM, "it is another user's, in a folder in which only that one may replace it")
    except OSError as error:
        raise _not_written(path, error) from error


def check_folder_writable(folder: Path) -> None:
    """Checks that files can be made in the folder. Raises ConfigurationError."""
    try:
        _refuse_folder(folder)
    except OSError as error:
        remedy = "Name a folder that you may write to"
        raise ConfigurationError(f"cannot be written to: {error.strerror}", str(folder), remedy) from error


def _refuse_folder(folder: Path) -> None:
    """Raises OSError that states why nothing can be written in the folder, if that is so."""
    if not folder.exists():
        raise OSError(errno.ENOENT, f"there is no folder {folder}")
    if not folder.is_dir():
        raise OSError(errno.ENOTDIR, f"{folder} is no folder")
    if not os.access(folder, os.W_OK | os.X_OK):
        why = "its disk is read-only" if os.statvfs(folder).f_flag & os.ST_RDONLY else f"{_user()} may not write there"
        raise OSError(errno.EACCES, f"{why}, in {folder}")


def _is_of_another(path: Path) -> bool:
    """Returns whether a sticky folder, such as /tmp, keeps this user from replacing the file."""
    folder = path.absolute().parent.stat()
    uid = os.geteuid()
    sticky = folder.st_mode & stat.S_ISVTX and uid not in (0, folder.st_uid)
    return bool(sticky) and path.exists() and path.stat().st_uid != uid


def _user() -> str:
    uid = os.geteuid()
    with suppress(KeyError):
        return f"the user {pwd.getpwuid(uid).pw_name}"
    return f"the user {uid}"


def check_kind(path: Path | None, what: str, *endings: str) -> None:
    """Raises ConfigurationError where the name has the suffix of another kind of file: neither a person nor a program
    would take it for what it contains. Suffixes that nobody knows are permitted. None is no file.

    what: what is written there. endings: those of that kind, in lower case; the first is proposed.
    """
    ending = "" if path is None else path.suffix.lower()
    if path is None or ending in endings or ending not in _KINDS:
        return
    said = f"is the name of {_KINDS[ending]}, and what is written there is {what}"
    remedy = f"Name it {path.with_suffix(endings[0]).name}" if endings else f"Name it {path.stem}"
    raise ConfigurationError(said, str(path), remedy)


def check_new(path: Path | None) -> None:
    """Raises ConfigurationError where the file cannot be written, or exists already. None is no file."""
    check_writable(path)
    if path is not None and path.exists():
        raise ConfigurationError("exists already", str(path), "Give another name, or move it away")


def check_replaceable(path: Path | None, begins: bytes) -> None:
    """Raises ConfigurationError where the file cannot be written, or exists and does not begin as what the command
    writes there does, so that a typing error costs no recording, calibration or configuration. None is no file.
    """
    check_writable(path)
    if path is None or not path.exists():
        return
    try:
        with path.open("rb") as stream:
            there = stream.read(len(begins))
    except OSError as error:
        raise _not_written(path, error) from error
    if there and there != begins:
        what = "exists already, and is something else than what would be written there"
        raise ConfigurationError(what, str(path), "Give another name, or move it away")


def check_apart(outputs: Iterable[Path | None], inputs: Iterable[Path | None]) -> None:
    """Raises ConfigurationError where a command would write what it reads, or write two things to one file."""
    taken = {path.resolve() for path in inputs if path is not None}
    for path in outputs:
        if path is None:
            continue
        if path.resolve() in taken:
            raise ConfigurationError("is named twice, and would be written over", str(path), "Give another name")
        taken.add(path.resolve())


def _not_written(path: Path, error: OSError) -> ConfigurationError:
    remedy = "Name a file in a folder that exists and may be written to"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        remedy = "Make room on its disk, or name a file on another one"
    return ConfigurationError(f"cannot be written: {error.strerror}", str(path), remedy)
