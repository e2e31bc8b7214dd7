"""Provides a lock that keeps a second process of ours out of a place, for as long as the first one lives."""

import errno
import fcntl
import os
from contextlib import suppress
from pathlib import Path

_OWNER = 0o600
"""Mode of the file. Only its owner may open it, as whoever opens it, even for reading, can hold the lock."""
_TRIES = 10
"""How often a file that is removed while it is being locked is made again. More insists longer against somebody who
removes it in a loop.
"""


def held_lock(file: Path) -> int:
    """Returns the descriptor of the file, which is made where it is missing, and locked until it is closed; none but
    its owner may open it. A file that somebody removes keeps nobody out: the holder checks that with is_held().

    Raises BlockingIOError where another process holds it, another OSError where it cannot be made.
    """
    for _ in range(_TRIES):
        descriptor = _locked(file)
        if is_held(file, descriptor):
            return descriptor
        os.close(descriptor)
    raise OSError(errno.ESTALE, os.strerror(errno.ESTALE), str(file))


def is_held(file: Path, descriptor: int) -> bool:
    """Returns whether the next process to ask for this file finds the lock of this descriptor. Raises OSError."""
    try:
        return os.path.samestat(file.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def _locked(file: Path) -> int:
    descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, _OWNER)
    try:
        with suppress(OSError):
            os.fchmod(descriptor, _OWNER)  # an earlier version let the group open it
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor
