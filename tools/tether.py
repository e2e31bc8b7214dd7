"""`python tether.py PARENT COMMAND …`: becomes COMMAND, which gets SIGTERM when the process PARENT dies."""

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1


def main() -> None:
    """The setting outlives the exec; a parent that died before it was made is seen by its pid."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    parent, *command = sys.argv[1:]
    if os.getppid() == int(parent):
        os.execv(command[0], command)


if __name__ == "__main__":
    main()
