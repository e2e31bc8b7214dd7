"""`python run_with_parent.py PARENT COMMAND …`: becomes COMMAND, which gets SIGTERM when the process PARENT dies.

Where it is allowed, COMMAND has the priority that the unit file gives the service: real devices do not slow down on a
busy machine, so simulated ones should not either.
"""

import ctypes
import os
import signal
import sys
from contextlib import suppress

_PR_SET_PDEATHSIG = 1
_NICE = -10
"""As systemd/probewatch.service."""


def main() -> None:
    """The settings outlive the exec; a parent that died before the first was made is seen by its pid."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, _NICE)
    parent, *command = sys.argv[1:]
    if os.getppid() == int(parent):
        os.execv(command[0], command)


if __name__ == "__main__":
    main()
