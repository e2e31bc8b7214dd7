"""A service that recalibrates, as far as a live scan needs one: a real control socket, a real feed of a wire scan."""

import os
import socket
import threading
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Self

from probewatch.appliance.limits import Limits
from probewatch.appliance.service.control.server import ControlRefused, Peer
from probewatch.appliance.service.estimator.link import EstimatorSettings, link_pair
from probewatch.appliance.service.estimator.ring import FRAMES, Ring, RingFds
from probewatch.appliance.service.estimator.tap import Subscription, Tap, TapFds
from probewatch.appliance.service.feed.server import FeedServer
from probewatch.appliance.service.host.unix_socket import listening
from probewatch.appliance.types import Calibration
from probewatch.drivers.samples import Sample
from tests.support.answering import Answers, recorded


class RecalibratingService(Answers):
    """Grants what a supervisor would. state: it may be put into another. refuse: answers no request but the status.

    asked: all requests but those for the status. holder: who began last. proposal: what it says of a new calibration.
    """

    def __init__(self, folder: Path, reference: Calibration | None) -> None:
        super().__init__(folder / "control")
        self.feed = folder / "feed"
        self.reference = reference
        self.state, self.sha256, self.refuse = "monitoring", "before", False
        self.proposal: dict[str, Any] = {"text": "hardly", "confirm": False, "sha256": "new"}
        self.asked: list[str] = []
        self.holder: Peer | None = None
        self.taken: bytes | None = None

    @property
    def is_held(self) -> bool:
        """The connection on which the recalibration hangs is open."""
        return self.holder is not None and self._server.is_open(self.holder.link)

    def _held_by(self, who: Peer) -> dict[str, Any] | None:
        if self.state != "recalibrating" or self.holder is None:
            return None
        return {"who": f"process {self.holder.pid}", "yours": self.holder.pid == who.pid, "ended": None}

    def _answer(self, do: str, request: dict[str, Any], who: Peer) -> dict[str, Any]:
        if do == "status":
            reference = {**recorded()["reference"], "sha256": self.sha256}
            told = {"state": self.state, "recalibration": self._held_by(who), "t_ns": time.monotonic_ns()}
            status = recorded(**told, reference=reference, simulated=["sim:x"])
            return {"status": status}
        if self.refuse:
            raise ControlRefused(f"not possible while {self.state}")
        self.asked.append(do)
        if do == "begin-recalibration":
            self.state, self.holder = "recalibrating", who if "hold_s" in request else None
        elif do == "abort-recalibration":
            self.state, self.sha256 = "not verified", "before"
        elif do == "end-recalibration":
            self.taken, self.sha256 = Path(request["file"]).read_bytes(), "new"
        return {"proposal": self.proposal}


class Scan:
    """The feed of that service while the block runs: tells the samples, each when the last was taken."""

    def __init__(self, service: RecalibratingService, samples: Iterable[Sample]) -> None:
        self._service, self._samples = service, samples
        self._ended = threading.Event()

    def __enter__(self) -> Self:
        tells, listens = link_pair()
        self._frames, self._subscription = Ring(FRAMES), Subscription()
        ring = RingFds(*(os.dup(fd) for fd in self._frames.fds))
        self._tap = Tap(TapFds(tells.detach(), ring, os.dup(self._subscription.fd)))
        self._listener = listening(self._service.feed, "", 8)
        self._feed = FeedServer(self._listener, listens, self._frames, self._subscription, frozenset(), "test")
        self._threads = [threading.Thread(target=self._feed.run), threading.Thread(target=self._tell)]
        self._listens: socket.socket = listens
        for thread in self._threads:
            thread.start()
        return self

    def _tell(self) -> None:
        reference = self._service.reference
        if reference is not None:
            self._tap.begin(EstimatorSettings(1, reference, Limits(), 500_000_000))
        while not self._tap.wanted and not self._ended.wait(0.005):
            pass
        for sample in self._samples:
            if self._ended.wait(0.004):  # as fast as a scan is looked at, so that none is lost
                return
            self._tap.publish(sample, ())

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._feed.stop()
        for thread in self._threads:
            thread.join()
        self._feed.close()
        for part in (self._listener, self._listens, self._tap, self._frames, self._subscription):
            part.close()
        self._service.feed.unlink()
