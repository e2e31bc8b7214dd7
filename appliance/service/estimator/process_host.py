"""Starts the estimator, receives its reports without waiting, and restarts it when it is dead or hung."""

import math
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Protocol

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.limits import Limits
from probewatch.appliance.service.estimator.link import EstimatorReport, LinkClosed, link_pair, receive, send
from probewatch.appliance.service.estimator.ring import FRAMES, POSES, Ring
from probewatch.appliance.service.estimator.tap import TapFds
from probewatch.appliance.service.host.child_process import ONE_THREAD
from probewatch.appliance.service.host.log import get_log
from probewatch.appliance.types import Calibration, Verdict
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.samples import Frame, Matrix4, Sample

_COMMAND = (sys.executable, "-m", "probewatch.appliance.service.estimator.process")
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.1, 5.0
"""s, the first and the longest wait before a new process is started; the wait doubles each time a process does not
last. More leaves the contact open for longer; less spends the processor on a process that cannot start.
"""
_HUNG_S, _LOADING_S = 5.0, 60.0
"""s, the silence after which the process is killed: once it has reported, and while it loads its libraries from a slow
disk. The contact is open by then (`Timeouts.estimator_ns`, `BEHIND_NS`), so these cost only recovery time; less would
kill a process that is merely slow.
"""
_WORKING_S = 0.3
"""s, the silence up to which the estimator counts as working: three of its reports."""
_REAP_TIMEOUT_S, _LAST_REAP_TIMEOUT_S = 0.05, 1.0
"""s, how long to wait for a killed process: during a tick, of which it may take one; at the end of the service. A
process that has not died by then is checked again each tick.
"""
_SIGNALS = {one.value: one.name for one in signal.Signals}


class Process(Protocol):
    """Describes what the host needs from the process that it has started."""

    @property
    def pid(self) -> int: ...
    def poll(self) -> int | None: ...
    def wait(self, timeout: float | None, /) -> int: ...
    def send_signal(self, number: int, /) -> None: ...


class EstimatorHost:
    """Owns the rings and the process. All its times are real seconds, whatever the cart's clock does.

    reference: None until set_reference() gives one; without it nothing is judged. stale_ns: as in `EstimatorSettings`.
    slowness: factor of the timeouts, for an emulated machine. clock: the clock whose real time is used.

    restarts: processes started after the first. ended: how the last process that ended did so, and which restart
    followed; None before any ended. last: the last report, None before the first. sent_ns: when the first verdict of
    the last poll was sent. tap: makes the tap of the feed for each new process; None where no client may connect.
    """

    def __init__(
        self,
        reference: Calibration | None,
        limits: Limits,
        stale_ns: int,
        command: Sequence[str] = _COMMAND,
        slowness: float = 1.0,
        clock: HostClock | None = None,
    ) -> None:
        self._clock = HostClock() if clock is None else clock
        self._command, self._limits, self._stale_ns, self._slowness = tuple(command), limits, stale_ns, slowness
        self._settings = None if reference is None else EstimatorSettings(1, reference, limits, stale_ns)
        self._frames, self._poses = Ring(FRAMES), Ring(POSES)
        self._process: Process | None = None
        self._dying: list[Process] = []
        self._link: socket.socket | None = None
        self._started_s = self._heard_s = self._start_at_s = 0.0
        self._has_reported = False
        self._wait_s = _FIRST_WAIT_S
        self._log = get_log()
        self.restarts = -1
        self.ended: str | None = None
        self.last: EstimatorReport | None = None
        self.sent_ns = 0
        self.tap: Callable[[], TapFds | None] = lambda: None

    @property
    def pid(self) -> int | None:
        """Returns the process id of the running process, None between two of them."""
        return None if self._process is None else self._process.pid

    @property
    def reporting(self) -> bool:
        """Returns whether the present process has reported: False from the end of one until the next has reported."""
        return self._has_reported

    @property
    def waiting_frames(self) -> int:
        """Returns the number of pictures that the estimator has not taken yet; 0 while it is not working."""
        working = self._has_reported and self._now_s() - self._heard_s < _WORKING_S
        return self._frames.backlog if working else 0

    @property
    def reference(self) -> Calibration | None:
        """Returns the calibration that the verdicts refer to."""
        return None if self._settings is None else self._settings.reference

    @property
    def relative_pose(self) -> Matrix4 | None:
        """Returns the pose of a second marker body relative to the first, as learned with the present calibration."""
        return None if self._settings is None else self._settings.relative_pose

    def put(self, sample: Sample) -> None:
        """Passes a sample on; never blocks. One thread may put frames, one poses.

        Raises ValueError for a sample that is too large.
        """
        (self._frames if isinstance(sample, Frame) else self._poses).put(sample)

    def set_reference(self, reference: Calibration, relative_pose: Matrix4 | None = None) -> None:
        """Verifies against another reference from now on; verdicts on the old one are no longer passed on.

        relative_pose: as in `EstimatorSettings`.
        """
        generation = 1 + (0 if self._settings is None else self._settings.generation)
        self._settings = EstimatorSettings(generation, reference, self._limits, self._stale_ns, relative_pose)
        self._send_settings()

    def set_limits(self, limits: Limits, stale_ns: int) -> None:
        """Verifies within other limits from now on."""
        self._limits, self._stale_ns = limits, stale_ns
        if self._settings is not None:
            self.set_reference(self._settings.reference, self._settings.relative_pose)

    def wait(self, real_s: float) -> None:
        """Waits until the estimator reports, for real_s at most."""
        if self._link is None:
            time.sleep(real_s)
        else:
            waiting = select.poll()  # select() refuses descriptors from 1024 on
            waiting.register(self._link, select.POLLIN)
            waiting.poll(math.ceil(real_s * 1e3))

    def poll(self) -> tuple[bool, tuple[Verdict, ...]]:
        """Returns (whether any report came, verdicts on the present reference). Never blocks; call it every tick."""
        reports = self._received_reports()
        now_s = self._now_s()
        if reports:
            self._heard_s, self._has_reported, self.last = now_s, True, reports[-1]
        self._look_after(now_s)
        generation = None if self._settings is None else self._settings.generation
        self._note_relative_pose(reports, generation)
        present = [report for report in reports if report.generation == generation and report.verdicts]
        self.sent_ns = present[0].sent_ns if present else self._clock.real_ns()
        return bool(reports), tuple(verdict for report in present for verdict in report.verdicts)

    def _note_relative_pose(self, reports: list[EstimatorReport], generation: int | None) -> None:
        """Keeps the latest relative pose, so that the next process continues with it."""
        known = [report.relative_pose for report in reports if report.generation == generation]
        if known and self._settings is not None:
            self._settings = replace(self._settings, relative_pose=known[-1])

    def close(self) -> None:
        """Stops the process and frees the rings."""
        self._stop(_LAST_REAP_TIMEOUT_S)
        self._frames.close()
        self._poses.close()

    def _now_s(self) -> float:
        return self._clock.real_ns() / 1e9

    def _received_reports(self) -> list[EstimatorReport]:
        reports: list[EstimatorReport] = []
        try:
            while self._link is not None and (report := receive(self._link)) is not None:
                assert isinstance(report, EstimatorReport)
                reports.append(report)
        except LinkClosed:
            self._drop_link()
        return reports

    def _look_after(self, now_s: float) -> None:
        self._reap()
        if self._process is None:
            if now_s >= self._start_at_s:
                self._start(now_s)
        elif how := self._ending(self._process, now_s):
            self._note_end(how, now_s)
            self._stop()

    def _ending(self, process: Process, now_s: float) -> str:
        """Returns in words how the process has ended, or why it must be ended; empty while it is well."""
        code = process.poll()
        if code is None:
            return f"hung, silent for {now_s - self._heard_s:.1f} s" if self._hung(now_s) else ""
        return f"killed by {_SIGNALS.get(-code, -code)}" if code < 0 else f"ended with exit code {code}"

    def _hung(self, now_s: float) -> bool:
        return now_s - self._heard_s > (_HUNG_S if self._has_reported else _LOADING_S) * self._slowness

    def _start(self, now_s: float) -> None:
        try:
            self._process = self._launched()
        except OSError as error:
            self._drop_link()
            self._note_end(f"cannot be started ({error.strerror})", now_s)
            return
        self._started_s = self._heard_s = now_s
        self._has_reported = False
        self.restarts += 1
        self._send_settings()

    def launch(self, fds: tuple[int, ...]) -> Process:
        """Starts the estimator process with these descriptors (see loop.serve). Raises OSError."""
        command = [*self._command, *(str(fd) for fd in fds)]
        return subprocess.Popen(command, pass_fds=fds, env=os.environ | ONE_THREAD)

    def _launched(self) -> Process:
        """Returns a new process with its link. Raises OSError where this process may open no more files, or the machine
        has no room for another process.
        """
        self._link, theirs = link_pair()
        self._link.setblocking(False)
        with theirs:
            tap = self.tap()
            fds = (theirs.fileno(), *self._frames.fds, *self._poses.fds, *(() if tap is None else tap.flat))
            return self.launch(fds)

    def _note_end(self, how: str, now_s: float) -> None:
        """Records how the process ended and lengthens the wait for the next start. The same failure is logged once."""
        lived_s, ended = now_s - self._started_s, f"{how}, restart {self.restarts + 1}"
        self._wait_s = _FIRST_WAIT_S if self._has_reported and lived_s > 10 else min(2 * self._wait_s, _LONGEST_WAIT_S)
        self._start_at_s = now_s + self._wait_s
        if ended != self.ended:
            self._log.error("estimator ended", how=how, lived_s=round(lived_s, 1), restart=self.restarts + 1)
        self.ended = ended

    def _send_settings(self) -> None:
        if self._link is not None and self._settings is not None:
            try:
                send(self._link, self._settings)
            except (LinkClosed, BlockingIOError):
                self._drop_link()

    def _drop_link(self) -> None:
        """Closes the link: without it the process ends by itself, or is found dead at the next tick."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def _stop(self, timeout_s: float = _REAP_TIMEOUT_S) -> None:
        self._drop_link()
        if self._process is not None:
            self._process.send_signal(signal.SIGKILL)
            self._dying.append(self._process)
            self._process, self._has_reported = None, False
            self._reap(timeout_s)

    def _reap(self, timeout_s: float = 0.0) -> None:
        """Collects the processes that are dead by now: one that waits in the kernel for a disk cannot die yet."""
        for process in tuple(self._dying):
            with suppress(subprocess.TimeoutExpired):
                process.wait(timeout_s)
                self._dying.remove(process)
