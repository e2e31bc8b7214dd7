"""Keeps a thread that may hang on a disk for ever from holding open the files of the others.

SIGKILL does not end a thread that waits in the kernel for a disk, and the open files of a process live as long as its
last thread that shares them: a line held high by the service would stay high, and its locks would keep the next service
out.
"""

import ctypes
import os
import resource

_CLONE_FILES = 0x400
"""Flag of unshare(2), <linux/sched.h>."""
_FIRST = 3
"""The first descriptor to close: standard input, output and error are no device."""


def own_files() -> None:
    """Gives the calling thread its own table of open files, with all but the standard ones closed (unshare(2))."""
    if ctypes.CDLL(None).unshare(_CLONE_FILES) == 0:
        os.closerange(_FIRST, resource.getrlimit(resource.RLIMIT_NOFILE)[0])
