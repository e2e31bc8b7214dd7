"""`python -m probewatch.tools.simulators.run_with_parent PARENT COMMAND …`: becomes COMMAND, which gets SIGTERM when
the process PARENT dies.

Where it is allowed, COMMAND has the priority that the unit file gives the service: real devices do not slow down on a
busy machine, so simulated ones should not either.
"""

import os
import signal
import sys
from contextlib import suppress

from probewatch.appliance.service.host.child_process import end_with_parent

_NICE = -10
"""As systemd/probewatch.service."""


def with_parent(*command: str) -> list[str]:
    """The command line that runs `command` as a child which ends with this process."""
    return [sys.executable, "-P", "-m", "probewatch.tools.simulators.run_with_parent", str(os.getpid()), *command]


def main() -> None:
    """The settings outlive the exec; a parent that died before the first was made is seen by its pid."""
    end_with_parent(signal.SIGTERM)
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, _NICE)
    parent, *command = sys.argv[1:]
    if os.getppid() == int(parent):
        os.execv(command[0], command)


if __name__ == "__main__":
    main()
