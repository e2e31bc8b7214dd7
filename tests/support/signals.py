"""Finding processes, and stopping them for a while, as a hang does that the operating system knows nothing of."""

import os
import signal
from collections.abc import Callable
from pathlib import Path


def family(pid: int) -> list[int]:
    """The process, and what it started: a twin runs under run_with_parent."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [pid, *(one for child in children for one in family(int(child)))]


def processes(session: int) -> list[int]:
    """Those of a session, by the process that began it, but for those that have ended."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, _, owner = stat.read_text().rpartition(") ")[2].split()[:4]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(owner) == session and state != "Z":
            found.append(int(stat.parent.name))
    return found


def stop(pids: list[int]) -> Callable[[], None]:
    """SIGSTOP to each; what lets them go on."""
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)

    def go_on() -> None:
        for pid in pids:
            os.kill(pid, signal.SIGCONT)

    return go_on
