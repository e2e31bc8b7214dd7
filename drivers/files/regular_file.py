"""Opens files that people name only where they are files: no device is touched, and no writer is waited for.

A refusal is an OSError whose strerror states the reason, so it is reported like any other file that cannot be opened.
"""

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe (FIFO)",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def refuse_irregular(path: Path) -> None:
    """Refuses a path that exists and is no regular file; a link counts as what it leads to.

    Raises OSError.
    """
    try:
        _refuse(_named(path).stat().st_mode, path)
    except FileNotFoundError:
        return


def open_regular(path: Path, flags: int = os.O_RDONLY, mode: int = 0o644) -> int:
    """Opens, like os.open, but only a regular file; the caller closes the descriptor.

    The file is checked before it is opened, because merely opening makes some devices act, and again after that,
    because it may have been replaced in between. Raises OSError.
    """
    refuse_irregular(path)
    descriptor = os.open(path, flags | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC, mode)
    try:
        _refuse(os.fstat(descriptor).st_mode, path)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def reading(path: Path) -> BinaryIO:
    """Returns the open file, to be closed by the caller. Raises OSError."""
    return os.fdopen(open_regular(path), "rb")


def read_bounded(path: Path, most_bytes: int) -> bytes:
    """Returns the whole file, and never uses more than most_bytes of memory for it. Raises OSError."""
    with reading(path) as stream:
        data = stream.read(most_bytes + 1) or b""
    if len(data) > most_bytes:
        raise OSError(errno.EFBIG, f"it is too large (over {most_bytes // 1000} kB)", str(path))
    return data


def _named(path: Path) -> Path:
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "there is a NUL in its name", str(path))
    return path


def _refuse(mode: int, path: Path) -> None:
    if not stat.S_ISREG(mode):
        kind = _KINDS.get(stat.S_IFMT(mode), "something else")
        number = errno.EISDIR if stat.S_ISDIR(mode) else errno.EINVAL
        raise OSError(number, f"it is {kind}, not a file", str(path))
