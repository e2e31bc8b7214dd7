"""A feed that hands on what the test wants, over its real socket, with the real tap of an estimator."""

import os
import socket
import threading
import time
from pathlib import Path

import numpy as np

from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.limits import Limits
from probewatch.appliance.service.estimator.link import link_pair
from probewatch.appliance.service.estimator.ring import FRAMES, Ring, RingFds
from probewatch.appliance.service.estimator.tap import FeedCounts, Subscription, Tap, TapFds
from probewatch.appliance.service.feed.server import FeedServer
from probewatch.appliance.service.host.unix_socket import connected, listening
from probewatch.appliance.types import Calibration
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp

SHIFT_NS = 40_000_000
"""Samples were true so long before they are told."""


class ScriptedFeed:
    """path: of its socket. clients, wanted: who listen now, and what they want (see the tap)."""

    def __init__(self, path: Path, size_px: tuple[int, int] = (64, 48)) -> None:
        self.path, self.number, self._size_px = path, 0, size_px
        self._listener = listening(path, "", 8)
        tells, self._hears = link_pair()
        self._frames, self._subscription = Ring(FRAMES), Subscription()
        frames = RingFds(*(os.dup(fd) for fd in self._frames.fds))
        self.tap = Tap(TapFds(tells.detach(), frames, os.dup(self._subscription.fd)))
        calibration = Calibration(np.eye(3), (1, 1), np.array([0.1, 0.1]), np.zeros(3), size_px)
        self.tap.begin(EstimatorSettings(1, calibration, Limits(), 500_000_000))
        self._server = FeedServer(self._listener, self._hears, self._frames, self._subscription, frozenset(), "test")
        self._thread = threading.Thread(target=self._server.run)
        self._thread.start()

    @property
    def counts(self) -> FeedCounts:
        return self._subscription.counts

    @property
    def wanted(self) -> int:
        return self._subscription.wanted

    def show(self) -> Frame:
        """The next picture: its grey is its number."""
        self.number += 1
        image = np.full(self._size_px[::-1], self.number % 256, np.uint8)
        frame = Frame(self._stamp(), self.number, image)
        self.tap.publish(frame, ())
        return frame

    def track(self, status: PoseStatus = PoseStatus.OK) -> Pose:
        """The next pose: its x is its number."""
        self.number += 1
        matrix = np.eye(4)
        matrix[0, 3] = self.number
        pose = Pose(self._stamp(), self.number, matrix if status is PoseStatus.OK else None, 0.1, status)
        self.tap.publish(pose, ())
        return pose

    def close(self) -> None:
        self._server.stop()
        connected(self.path, 5).close()  # which wakes it
        self._thread.join()
        self.tap.close()
        self._server.close()
        for part in (self._listener, self._hears, self._frames, self._subscription):
            part.close()
        self.path.unlink(missing_ok=True)

    def _stamp(self) -> Stamp:
        return Stamp(time.monotonic_ns() - SHIFT_NS, 1_000_000)


def unread(link: socket.socket) -> None:
    """A receive buffer as small as the kernel lets it be."""
    link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
