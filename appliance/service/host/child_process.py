"""Provides what every child process needs: an end with its parent, and a single thread for its mathematics."""

import ctypes
import signal

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment of a process that computes: more threads of its libraries would take the processor from others."""

_PR_SET_PDEATHSIG = 1
"""Option of prctl(2), <linux/prctl.h>."""


def end_with_parent(by: signal.Signals) -> None:
    """Makes the kernel send this signal when the parent dies, also after an exec. An earlier death is not noticed."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, by)
