"""Reads the kernel's pressure stall information: for how long programs waited for the processor or for memory."""

import os
import re
from math import nan
from pathlib import Path

from probewatch.appliance.service.host.log import get_log

_RESOURCES = ("cpu", "memory")
"""Resources that are read. Not io: a tick waits for no disk, and a busy one disturbs nothing."""
_TOTAL = re.compile(rb"^some .*\btotal=(\d+)$", re.M)


class Pressure:
    """Measures the pressure on the service's own control group where there is one, else on the whole machine.

    The first shows what this service lacks; the second also counts programs that wait without harm to it. Neither
    exists on kernels built without CONFIG_PSI or started with psi=0; that of the whole machine does not exist under
    ProcSubset=pid either.
    """

    def __init__(self, proc: Path = Path("/proc"), groups: Path = Path("/sys/fs/cgroup")) -> None:
        self._files = _opened(_own_group(proc, groups), "{}.pressure") or _opened(proc / "pressure", "{}")
        self._stalled_us = self._totals_us()
        self._at_ns: int | None = None
        if not self._files:
            get_log().info("this kernel reports no CPU pressure; overload is detected from late ticks alone")

    def close(self) -> None:
        for file in self._files:
            os.close(file)
        self._files = []

    def share(self, real_ns: int) -> float:
        """Returns the share of the time since the last call, 0 … 1, in which some program waited; NaN where it is not
        known.

        real_ns: CLOCK_MONOTONIC.
        """
        before_ns, before_us = self._at_ns, self._stalled_us
        self._at_ns, self._stalled_us = real_ns, self._totals_us()
        if before_ns is None or real_ns <= before_ns or not self._stalled_us:
            return nan
        elapsed_us = (real_ns - before_ns) / 1e3
        shares = (now_us - then_us for now_us, then_us in zip(self._stalled_us, before_us, strict=True))
        return min(1.0, max(0.0, max(shares) / elapsed_us))

    def _totals_us(self) -> list[int]:
        try:
            texts = [os.pread(file, 512, 0) for file in self._files]
        except OSError:
            self.close()
            return []
        return [int(found[1]) for text in texts if (found := _TOTAL.search(text))]


def _own_group(proc: Path, groups: Path) -> Path:
    """Returns the folder of the control group; where there is none but the root's, a folder that does not exist."""
    try:
        found = re.search(r"^0::/(.+)$", (proc / "self/cgroup").read_text(), re.M)
    except OSError:
        found = None
    return groups / (found[1] if found else "no group of its own")


def _opened(folder: Path, name: str) -> list[int]:
    """Opens the files of all resources, or none."""
    files: list[int] = []
    try:
        for resource in _RESOURCES:
            files.append(os.open(folder / name.format(resource), os.O_RDONLY | os.O_CLOEXEC))
            if not _TOTAL.search(os.pread(files[-1], 512, 0)):
                raise OSError
    except OSError:
        for file in files:
            os.close(file)
        return []
    return files
