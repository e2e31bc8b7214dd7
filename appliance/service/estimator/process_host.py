"""The hardware process's side of the estimator: starts it, hears it without waiting, restarts it when dead or hung."""

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
"""Before a new process is started, doubled each time one does not last. Longer leaves the contact open for longer;
shorter spends the processor on what cannot start.
"""
_HUNG_S, _LOADING_S = 5.0, 60.0
"""Silence after which it is killed: once it has spoken, and while it loads its libraries from a slow disk. The contact
is open by then (`Timeouts.estimator_ns`, `BEHIND_NS`), so these cost only recovery: shorter would kill one that is
merely slow.
"""
_WORKING_S = 0.3
"""Silence up to which the estimator counts as working: three of its reports."""
_REAP_TIMEOUT_S, _LAST_REAP_TIMEOUT_S = 0.05, 1.0
"""How long a killed process is waited for: in a tick, of which it may take one; at the end of the service. One that
does not die by then is looked for again each tick.
"""
_SIGNALS = {one.value: one.name for one in signal.Signals}


class Process(Protocol):
    """What the host asks of the process that it has started."""

    @property
    def pid(self) -> int: ...
    def poll(self) -> int | None: ...
    def wait(self, timeout: float | None, /) -> int: ...
    def send_signal(self, number: int, /) -> None: ...


class EstimatorHost:
    """Owner of the rings and of the process. All times inside are real seconds, whatever the cart's clock does.

    reference: None until set_reference() gives one; without it nothing is judged. stale_ns: as in `EstimatorSettings`.
    slowness: factor of the timeouts, for an emulated machine. clock: whose real time it is.

    restarts: processes started after the first. ended: how the last to end did so, and which restart followed; None
    before any did. last: its last report, None before the first. sent_ns: when the first verdict of the last poll was
    sent. tap: makes, for each new process, the tap of the feed; None where no client may connect.
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
        """Process id of the running process, None between two of them."""
        return None if self._process is None else self._process.pid

    @property
    def reporting(self) -> bool:
        """Whether the present process has reported; False from the death of one to the first report of the next."""
        return self._has_reported

    @property
    def waiting_frames(self) -> int:
        """Pictures that it has not taken yet; 0 while it does not work."""
        working = self._has_reported and self._now_s() - self._heard_s < _WORKING_S
        return self._frames.backlog if working else 0

    @property
    def reference(self) -> Calibration | None:
        """The calibration that verdicts speak of."""
        return None if self._settings is None else self._settings.reference

    @property
    def relative_pose(self) -> Matrix4 | None:
        """The pose of a second marker body relative to the first, as learned with that calibration."""
        return None if self._settings is None else self._settings.relative_pose

    def put(self, sample: Sample) -> None:
        """Hand a sample on; never blocks. One thread for frames, one for poses. Raises ValueError when too large."""
        (self._frames if isinstance(sample, Frame) else self._poses).put(sample)

    def set_reference(self, reference: Calibration, relative_pose: Matrix4 | None = None) -> None:
        """Verify against another reference from now on; what is said of the old one is no longer passed on.

        relative_pose: as of `EstimatorSettings`.
        """
        generation = 1 + (0 if self._settings is None else self._settings.generation)
        self._settings = EstimatorSettings(generation, reference, self._limits, self._stale_ns, relative_pose)
        self._send_settings()

    def set_limits(self, limits: Limits, stale_ns: int) -> None:
        """Verify within other limits from now on."""
        self._limits, self._stale_ns = limits, stale_ns
        if self._settings is not None:
            self.set_reference(self._settings.reference, self._settings.relative_pose)

    def wait(self, real_s: float) -> None:
        """Wait until it reports, or for real_s at most."""
        if self._link is None:
            time.sleep(real_s)
        else:
            waiting = select.poll()  # select() refuses descriptors from 1024 on
            waiting.register(self._link, select.POLLIN)
            waiting.poll(math.ceil(real_s * 1e3))

    def poll(self) -> tuple[bool, tuple[Verdict, ...]]:
        """(heard anything, verdicts on the present reference). Never blocks; call it every tick."""
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
        """The next process goes on with it."""
        known = [report.relative_pose for report in reports if report.generation == generation]
        if known and self._settings is not None:
            self._settings = replace(self._settings, relative_pose=known[-1])

    def close(self) -> None:
        """Stop the process and free the rings."""
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
        """How it has ended, or must be, in words; empty while it is well."""
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
        """The process that computes, with these descriptors: see loop.serve. Raises OSError."""
        command = [*self._command, *(str(fd) for fd in fds)]
        return subprocess.Popen(command, pass_fds=fds, env=os.environ | ONE_THREAD)

    def _launched(self) -> Process:
        """Raises OSError where this process may open no more files, or the machine has no room for another one."""
        self._link, theirs = link_pair()
        self._link.setblocking(False)
        with theirs:
            tap = self.tap()
            fds = (theirs.fileno(), *self._frames.fds, *self._poses.fds, *(() if tap is None else tap.flat))
            return self.launch(fds)

    def _note_end(self, how: str, now_s: float) -> None:
        """Say it once, however often the same is tried in vain, and try again later each time."""
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
        """Without a link the process ends by itself, or is found dead at the next tick."""
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
        """Collect the processes that are dead by now; one that waits in the kernel for a disk cannot die before it."""
        for process in tuple(self._dying):
            with suppress(subprocess.TimeoutExpired):
                process.wait(timeout_s)
                self._dying.remove(process)
