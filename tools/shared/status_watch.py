"""Polls the status of the service in a thread of its own, so that no client waits for it."""

import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.service.control.starting import NoService
from probewatch.drivers.errors import ProbewatchError
from probewatch.tools.shared.named_cart import start_of
from probewatch.tools.shared.threaded import Threaded

_ANSWER_S = 1.0
"""Seconds for the service to answer: twenty ticks. Longer reports later that it does not."""

_AGAIN_S = 0.5
"""Seconds before a service that does not answer is asked again. A shorter time only fills its queue."""

_IDLE_S = 0.25
"""Seconds between two requests while there is no listener, so that a new one gets a fresh status: the pace of `status
--watch`."""

_STALE_NS = 500_000_000
"""ns, age beyond which a status counts no more: then the service is silent. Twice as long as a command to an alarm
output is valid, because a busy computer delays this process more than the service; longer would show an OK for longer
than it is known."""


@dataclass(frozen=True, slots=True)
class Seen:
    """Holds the status as docs/control.md describes it, None while the service does not send it; `silence` says why.
    `t_ns` is the CLOCK_MONOTONIC time of the status.
    """

    status: dict[str, Any] | None
    t_ns: int
    silence: str = ""


class StatusWatch(Threaded):
    """Keeps the latest status. `path` is the control socket, `every_s` the polling interval while there are
    listeners.
    """

    def __init__(self, path: Path, every_s: float) -> None:
        self._path, self._every_s = path, every_s
        self._start = start_of(path)  # reads click's context, which only the command's thread has
        self._listened_to = False
        self._ended = threading.Event()
        self._last: Seen | None = None
        self._why = "it was not asked yet"
        super().__init__("status")

    def close(self) -> None:
        """Ends the thread, see Closable."""
        self._ended.set()
        self._thread.join(2 * _ANSWER_S)

    def want(self, listeners: int) -> None:
        """Sets the number of listeners."""
        self._listened_to = listeners > 0

    def seen(self) -> Seen:
        """Returns the latest status while it is fresh, else the reason why there is none."""
        last, now_ns = self._last, time.monotonic_ns()
        if last is None:
            return Seen(None, now_ns, self._why)
        age_ns = now_ns - last.t_ns
        if age_ns > _STALE_NS:
            return Seen(None, now_ns, self._why or f"it has said nothing for {age_ns / 1e9:.1f} s")
        return last

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                with ControlClient(self._path, _ANSWER_S) as client:
                    self._listen(client)
            except NoService as error:
                self._last, self._why = None, str(NoService(error.what, error.where, self._start))
            except (ProbewatchError, ValueError, KeyError) as error:
                self._last, self._why = None, str(error)
            self._ended.wait(_AGAIN_S)

    def _listen(self, client: ControlClient) -> None:
        while not self._ended.is_set():
            asked_ns = time.monotonic_ns()
            status = client.status()
            t_ns = int(status["t_ns"])
            near = asked_ns - _STALE_NS < t_ns <= time.monotonic_ns()
            self._last, self._why = Seen(status, t_ns if near else asked_ns), ""
            self._ended.wait(self._every_s if self._listened_to else max(self._every_s, _IDLE_S))
