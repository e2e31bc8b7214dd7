"""Wall time beside wall time without the waits for a processor, so that a bound holds on a busy computer as on an idle
one.
"""

import time
from pathlib import Path

_TICK_S = 0.01
"""Unit of /proc/stat."""


class Stopwatch:
    """Runs from when it is made, in seconds of a `HostClock` of that rate."""

    def __init__(self, rate: float = 1.0) -> None:
        self._rate, self._began_s, self._waited_s = rate, time.monotonic(), _waited_s()

    def elapsed_s(self) -> float:
        """Wall time."""
        return self._rate * (time.monotonic() - self._began_s)

    def spent_s(self) -> float:
        """Wall time less what the threads of this process waited for a processor, and what the host took from this
        machine. Threads that waited at the same time are each counted, so on a busy machine it may be too little; on
        an idle one it is the wall time.
        """
        return self.elapsed_s() - self._rate * (_waited_s() - self._waited_s)


def _waited_s() -> float:
    waits = (_schedule(task)[1] for task in Path("/proc/self/task").iterdir())
    stolen = int(Path("/proc/stat").read_text().split(maxsplit=9)[8])
    return sum(waits) / 1e9 + stolen * _TICK_S


def _schedule(task: Path) -> list[int]:
    """Nanoseconds on a processor and waiting for one, and how often; zeros of a thread that has just ended."""
    try:
        return [int(field) for field in (task / "schedstat").read_text().split()]
    except OSError:
        return [0, 0, 0]
