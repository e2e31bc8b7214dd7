"""Runs the loop of the estimator process: samples in from two rings, verdicts out over the link. It opens no device."""

import math
import select
import signal
import socket
import time
from collections.abc import Callable
from typing import Protocol

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.limits import Limits
from probewatch.appliance.service.estimator.link import EstimatorReport, LinkClosed, receive, send
from probewatch.appliance.service.estimator.ring import FRAMES, POSES, Ring, RingFds
from probewatch.appliance.service.estimator.tap import Tap, TapFds
from probewatch.appliance.service.host.child_process import end_with_parent
from probewatch.appliance.types import Calibration, Verdict
from probewatch.drivers.samples import Matrix4, Sample

_REPORT_EVERY_NS = 100_000_000
"""ns, the interval between reports while there is no verdict. Ten must be missing before `Timeouts.estimator_ns` counts
the estimator as silent.
"""


class Stepper(Protocol):
    """Describes the line as this process sees it."""

    @property
    def relative_pose(self) -> Matrix4 | None: ...

    def step(self, sample: Sample) -> tuple[Verdict, ...]: ...


MakeLine = Callable[[Calibration, Limits, int, Matrix4 | None], Stepper]
"""Makes a line from (reference, limits, stale_ns, relative_pose), which are those of `EstimatorSettings`."""


class Estimator:
    """Runs the loop around the line. A sample or new settings wake it.

    It reports at once when there is a verdict, and every 0.1 s when there is none. tap: receives every step after that
    report; None where no client may connect. real_ns: CLOCK_MONOTONIC.
    """

    def __init__(
        self,
        link: socket.socket,
        frames: Ring,
        poses: Ring,
        make_line: MakeLine,
        tap: Tap | None = None,
        real_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._link, self._frames, self._poses, self._make_line, self._tap = link, frames, poses, make_line, tap
        self._real_ns = real_ns
        self._line: Stepper | None = None
        self._generation = 0
        self._counts = [0, 0]
        self._dropped = [0, 0]
        self._reported_ns = 0
        self._waking = select.poll()
        for source in (link, frames, poses):
            self._waking.register(source, select.POLLIN)

    def run(self) -> None:
        """Runs until the peer closes the link."""
        readable = True
        try:
            while True:
                self.step(readable)
                readable = self._wait()
        except LinkClosed:
            return

    def step(self, readable: bool = True) -> None:
        """Takes the samples that are there and reports if a report is due; never waits. readable: the link has
        something to read.

        Raises LinkClosed.
        """
        if readable:
            self._apply_settings()
        self._compute()
        self._send_report(())

    def _apply_settings(self) -> None:
        while (settings := receive(self._link)) is not None:
            assert isinstance(settings, EstimatorSettings)
            if self._line is None:
                self._discard()
            self._line = self._make_line(settings.reference, settings.limits, settings.stale_ns, settings.relative_pose)
            self._generation = settings.generation
            if self._tap is not None:
                self._tap.begin(settings)

    def _compute(self) -> None:
        line, tap = self._line, self._tap
        if line is None and (tap is None or not tap.wanted):
            self._discard()
            return
        for sample in self._take():
            verdicts = () if line is None else line.step(sample)
            self._send_report(verdicts)
            if tap is not None:
                tap.publish(sample, verdicts)

    def _discard(self) -> None:
        """Discards, uncounted, what came before there was anyone to take it: it is old."""
        for ring in (self._frames, self._poses):
            ring.discard()

    def _take(self) -> list[Sample]:
        """Returns both streams merged by the time at which the samples were true."""
        samples: list[Sample] = []
        for index, ring in enumerate((self._frames, self._poses)):
            taken, dropped = ring.take()
            samples += taken
            self._counts[index] += len(taken)
            self._dropped[index] += dropped
        return sorted(samples, key=lambda sample: sample.stamp.t_ns)

    def _wait(self) -> bool:
        """Waits for a sample, settings or the next report. Returns whether the link has settings or has closed."""
        pending = self._frames.pending or self._poses.pending
        left_ns = 0 if pending else self._reported_ns + _REPORT_EVERY_NS - self._real_ns()
        ready = self._waking.poll(max(0, math.ceil(left_ns / 1e6)))
        return any(fd == self._link.fileno() for fd, _ in ready)

    def _send_report(self, verdicts: tuple[Verdict, ...]) -> None:
        now_ns = self._real_ns()
        if verdicts or now_ns - self._reported_ns >= _REPORT_EVERY_NS:
            self._reported_ns = now_ns
            relative_pose = None if self._line is None else self._line.relative_pose
            (frames, poses), dropped = self._counts, self._dropped
            send(
                self._link,
                EstimatorReport(
                    self._generation, now_ns, verdicts, frames, poses, dropped[0], dropped[1], relative_pose
                ),
            )


def serve(arguments: list[str], make_line: MakeLine) -> None:
    """Runs the body of the process.

    arguments: the file descriptors of the link, then three of each ring, frames first; then those of the tap, if any
    client may connect to the feed.
    """
    link_fd, *ring_fds = (int(argument) for argument in arguments)
    tap = Tap(TapFds.of(ring_fds[6:])) if ring_fds[6:] else None
    end_with_parent(signal.SIGKILL)  # if the parent died before this call, it has closed the link
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with (
        socket.socket(fileno=link_fd) as link,
        Ring(FRAMES, RingFds(*ring_fds[:3])) as frames,
        Ring(POSES, RingFds(*ring_fds[3:6])) as poses,
    ):
        Estimator(link, frames, poses, make_line, tap).run()
