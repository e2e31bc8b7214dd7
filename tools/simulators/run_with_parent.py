"""Becomes a command that gets SIGTERM when its parent dies: `python -m probewatch.tools.simulators.run_with_parent
PARENT COMMAND …`, with the process id of the parent.

Where it is allowed, COMMAND has the priority that the unit file gives the service: real devices do not slow down on a
busy machine, so simulated ones should not either.
"""

import os
import signal
import sys
from contextlib import suppress

from probewatch.appliance.service.host.child_process import end_with_parent

_NICE = -10
"""Nice value, as in systemd/probewatch.service."""


def with_parent(*command: str) -> list[str]:
    """Returns the command line that runs `command` as a child which ends with this process."""
    return [sys.executable, "-P", "-m", "probewatch.tools.simulators.run_with_parent", str(os.getpid()), *command]


def main() -> None:
    """Applies the settings, which outlive the exec, and becomes the command; a parent that died before the first was
    made is noticed by its pid.
    """
    end_with_parent(signal.SIGTERM)
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, _NICE)
    parent, *command = sys.argv[1:]
    if os.getppid() == int(parent):
        os.execv(command[0], command)


if __name__ == "__main__":
    main()
