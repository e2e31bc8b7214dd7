"""Was this computer too busy with other programs for tests in real time?

Two figures have to say so together. The time that others had tells nothing of whether the tests suffered: a program of
low priority may take all that is left over. The waiting of the tests' own threads tells nothing of who kept them
waiting: a fault of the program that makes it work too much has them wait for one another.
"""

import ctypes
import os
import resource
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from math import nan
from pathlib import Path
from types import TracebackType
from typing import Self

MOST_OTHERS = 0.25
"""Share of the processors' time, as a mean of the run. Higher: a machine that is half as quick counts as quiet. Lower:
what an idle machine does by itself, kernel included, would excuse a failure."""
MOST_WAITED = 0.3
"""Share of the tests' time. Higher: a real-time test that lost every second tick counts as unhindered. Lower: what the
processes of one cart wait for one another on two processors would count."""
TOO_SLOW = 0.6
"""Share of the tests' time, whoever kept them waiting, from which workers side by side were too many for this computer.
A whole `make live` waited .74 of its time on one that was half as quick as usual, and failed in seven modules. Lower:
failures of the program that make it work too much are looked at twice; they fail alone as well.
"""
_PERIOD_S = 0.5
"""Between two looks at the threads' waiting. Shorter costs a processor that the tests need; of longer ones more is lost
of threads that end between two, which makes the waiting less."""
_TICK_S = 1 / os.sysconf("SC_CLK_TCK")
_PROC = Path("/proc")
_SUBREAPER = 36
"""PR_SET_CHILD_SUBREAPER of prctl(2)."""


@dataclass(frozen=True, slots=True)
class Load:
    """Of one run of tests. others: share of all processors' time that other programs had or the host took away.
    waited: share of the time in which threads of the tests could have run that they waited for a processor. Both 0 …
    1, NaN where the kernel does not tell.
    """

    others: float = nan
    waited: float = nan

    def too_busy(self) -> bool:
        """Whether a failure in that run says nothing; never where one figure is unknown."""
        return self.others >= MOST_OTHERS and self.waited >= MOST_WAITED

    def too_slow(self) -> bool:
        """Whether many failures in that run may be for want of time; never where the figure is unknown."""
        return self.waited >= TOO_SLOW

    def __str__(self) -> str:
        return f"others had {self.others:.0%} of the processors, the tests waited {self.waited:.0%} of their time"


class LoadMeter:
    """Measures from entering the context to leaving it; what runs below this process are the tests. own_s: processor
    time that they had, and this process.
    """

    def __init__(self) -> None:
        with suppress(OSError, AttributeError):  # what is orphaned stays below this process, and is counted with it
            ctypes.CDLL(None).prctl(_SUBREAPER, 1)
        self._threads: dict[str, tuple[int, int]] = {}
        self._ended = threading.Event()
        self.load, self.own_s = Load(), 0.0

    def __enter__(self) -> Self:
        self._began_s, self._busy_s, self._spent_s = time.monotonic(), _busy_s(), _own_s()
        self._watch = threading.Thread(target=self._look, daemon=True)
        self._watch.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self._ended.set()
        self._watch.join()
        _reap()
        capacity_s = (time.monotonic() - self._began_s) * len(os.sched_getaffinity(0))
        self.own_s = _own_s() - self._spent_s
        others_s = _busy_s() - self._busy_s - self.own_s
        ran, waited = (sum(figures) for figures in zip((0, 0), *self._threads.values(), strict=True))
        self.load = Load(max(0.0, others_s / capacity_s), waited / (ran + waited) if ran else nan)

    def _look(self) -> None:
        while not self._ended.wait(_PERIOD_S):
            for thread in _descendants():
                with suppress(OSError, ValueError):
                    ran_ns, waited_ns, _ = map(int, (thread / "schedstat").read_text().split())
                    self._threads[thread.name] = ran_ns, waited_ns


def _busy_s() -> float:
    """Of the processors that this process may use, the host's theft included."""
    names = {f"cpu{number}" for number in os.sched_getaffinity(0)}
    lines = [line.split() for line in (_PROC / "stat").read_text().splitlines()]
    # user, nice, system, irq, softirq and steal: all but idle and waiting for a disk
    return sum(int(line[at]) for line in lines if line[0] in names for at in (1, 2, 3, 6, 7, 8)) * _TICK_S


def _own_s() -> float:
    """Of this process, of what it waited for, and of what still lives below it."""
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    living = {thread.parent.parent for thread in _descendants()}
    return sum(usage.ru_utime + usage.ru_stime for usage in usages) + sum(map(_spent_s, living))


def _spent_s(process: Path) -> float:
    """With what it waited for itself."""
    try:
        fields = (process / "stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return sum(map(int, fields[11:15])) * _TICK_S


def _descendants() -> list[Path]:
    """Folder of every thread of every process below this one."""
    found: list[Path] = []
    waiting = [_PROC / "self"]
    while waiting:
        process = waiting.pop()
        with suppress(OSError):
            threads = list((process / "task").iterdir())
            found += threads if process.name != "self" else []
            for thread in threads:
                with suppress(OSError):
                    waiting += [_PROC / child for child in (thread / "children").read_text().split()]
    return found


def _reap() -> None:
    """Orphans that have ended: only what was waited for is counted."""
    with suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
