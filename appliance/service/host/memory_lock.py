"""Pages once used stay in memory: a rare path, such as the first real fault, must not wait for the disk."""

import ctypes
import os
import resource

_MCL_CURRENT, _MCL_FUTURE, _MCL_ONFAULT = 1, 2, 4
"""Flags of mlockall(2), <bits/mman-linux.h>."""


def lock_memory() -> bool:
    """mlockall(2), each page from its first use on. False where this process may not lock as much as it needs."""
    unlimited = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY
    if os.geteuid() != 0 and not unlimited:
        return False
    return int(ctypes.CDLL(None).mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT)) == 0
