"""What every process that this one starts needs: an end with its parent, and one thread for its mathematics."""

import ctypes
import signal

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment of a process that computes: threads of its libraries would take the processor from its neighbours."""

_PR_SET_PDEATHSIG = 1
"""prctl(2), <linux/prctl.h>."""


def end_with_parent(by: signal.Signals) -> None:
    """The kernel sends this signal when the parent dies, also after an exec; one that died before is not noticed."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, by)
