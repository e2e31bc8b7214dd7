"""Devices and an estimator that live in the test's process, for the simulated cart."""

import os
import socket
import traceback
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import count
from types import TracebackType
from typing import Any, Self

from probewatch.appliance.limits import Limits
from probewatch.appliance.service.estimator.link import LinkClosed
from probewatch.appliance.service.estimator.loop import Estimator, MakeLine
from probewatch.appliance.service.estimator.process_host import EstimatorHost
from probewatch.appliance.service.estimator.ring import FRAMES, POSES, Ring, RingFds
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.samples import Sample

LOOK_MS = 5
ERR_NS = 100_000


class Device:
    """A scanner or a tracker that makes a sample every period_ns. plugged: it can be opened. sends: it makes any."""

    def __init__(self, clock: HostClock, period_ns: int, make: Callable[[int, int], Sample]) -> None:
        self.clock, self.period_ns, self.make = clock, period_ns, make
        self.plugged = self.sends = True

    def opened(self, url: str, clock: HostClock) -> "OpenDevice":
        """As the registry opens one."""
        self.require(url)
        return OpenDevice(self, url)

    def require(self, url: str) -> None:
        if not self.plugged:
            raise DeviceLost("is not there", url, "Plug it in")


class OpenDevice:
    """One connection to it."""

    def __init__(self, device: Device, url: str) -> None:
        self._device, self._url, self._numbers = device, url, count()
        self._due_ns = device.clock.now_ns()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None: ...

    def read(self, timeout_s: float) -> Any:
        """As a source promises."""
        device, end_ns = self._device, self._device.clock.now_ns() + round(timeout_s * 1e9)
        comes = device.sends and self._due_ns <= end_ns
        device.clock.sleep_until(self._due_ns if comes else end_ns)
        device.require(self._url)
        if not (comes and device.sends):
            self._due_ns = max(self._due_ns, device.clock.now_ns())
            return None
        due_ns, self._due_ns = self._due_ns, self._due_ns + device.period_ns
        return device.make(due_ns, next(self._numbers))


@dataclass(slots=True)
class LoopHere:
    """The estimator's loop in place of its process. stopped: it computes nothing, as after SIGSTOP."""

    loop: Estimator
    kept: ExitStack
    code: int | None = None
    stopped: bool = False
    pid: int = os.getpid()

    def compute(self) -> None:
        """What has come since; a line that raises ends it, as it would end the process."""
        if self.code is not None or self.stopped:
            return
        try:
            self.loop.step()
        except LinkClosed:
            self._end(0)
        except Exception:
            traceback.print_exc()
            self._end(1)

    def poll(self) -> int | None:
        return self.code

    def wait(self, timeout: float | None, /) -> int:
        assert self.code is not None
        return self.code

    def send_signal(self, number: int, /) -> None:
        if self.code is None:
            self._end(-number)

    def _end(self, code: int) -> None:
        self.code = code
        self.kept.close()


class EstimatorHere(EstimatorHost):
    """The real host of a loop that runs in this process. here: the present one."""

    def __init__(self, make_line: MakeLine, limits: Limits, stale_ns: int, clock: HostClock) -> None:
        super().__init__(None, limits, stale_ns, clock=clock)
        self._make_line, self._real_ns = make_line, clock.real_ns
        self.here: LoopHere | None = None

    def launch(self, fds: tuple[int, ...]) -> LoopHere:
        link, *rings = (os.dup(fd) for fd in fds[:7])
        with ExitStack() as opened:
            ends = opened.enter_context(socket.socket(fileno=link))
            frames = opened.enter_context(Ring(FRAMES, RingFds(*rings[:3])))
            poses = opened.enter_context(Ring(POSES, RingFds(*rings[3:])))
            loop = Estimator(ends, frames, poses, self._make_line, real_ns=self._real_ns)
            self.here = LoopHere(loop, opened.pop_all())
        return self.here

    @property
    def has_spoken(self) -> bool:
        """Since the last tick."""
        try:
            return self._link is not None and bool(self._link.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT))
        except OSError:
            return False
