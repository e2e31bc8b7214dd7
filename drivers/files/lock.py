"""A lock that keeps a second process of ours out of a place, for as long as the first one lives."""

import fcntl
import os
from contextlib import suppress
from pathlib import Path

_OWNER = 0o600
"""Who may open the file may hold it, for reading too."""


def held_lock(file: Path) -> int:
    """Descriptor of the file, made where it is missing, and locked until it is closed; none but its owner may open it.

    Raises BlockingIOError where another process holds it, another OSError where it cannot be made.
    """
    descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, _OWNER)
    try:
        with suppress(OSError):
            os.fchmod(descriptor, _OWNER)  # an earlier version let the group open it
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor
