"""Implements the hardware process's side of the feed: its socket, and the process that serves it while there are
clients.

Whatever happens to the feed, the service continues to monitor: what cannot be made or started is logged and shown in
the status.
"""

import os
import select
import socket
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path

from probewatch.appliance.service.estimator.link import link_pair
from probewatch.appliance.service.estimator.ring import FRAMES, Ring
from probewatch.appliance.service.estimator.tap import NOTHING, FeedCounts, Subscription, TapFds
from probewatch.appliance.service.host.child_process import ONE_THREAD
from probewatch.appliance.service.host.log import get_log
from probewatch.appliance.service.host.unix_socket import listening

_COMMAND = (sys.executable, "-m", "probewatch.appliance.service.feed.process")
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.5, 30.0
"""s, the first and the longest wait before a process that died is started again; the wait doubles each time one does
not last. More leaves viewers without a picture for longer; less spends the processor on a process that cannot start.
"""
_LASTED_S = 60.0
"""s, the lifetime after which the death of a process does not mean that it cannot run."""
_REAP_TIMEOUT_S = 1.0
"""s, how long the end of the service waits for a killed process."""
_BACKLOG = 128
"""Clients that the kernel queues, in order, so that a crowd that sends nothing keeps no client out for long."""


class FeedHost:
    """Owns the feed's socket and starts its process. No other service may run here: what lies at the path is removed.

    path: of the socket, mode 0660, of `group` if one is named, and of `onlookers`, by id; None offers no feed.
    without_pictures: users who are shown no pictures. refused: why there is no socket, in words; None where there is
    one.
    """

    def __init__(
        self,
        path: Path | None,
        group: str = "",
        onlookers: Iterable[int] = (),
        without_pictures: Iterable[int] = (),
        command: Sequence[str] = _COMMAND,
    ) -> None:
        self._path, self._command = path, (*command, ",".join(str(uid) for uid in sorted(without_pictures)))
        self._log = get_log(feed=str(path))
        self._process: subprocess.Popen[bytes] | None = None
        self._dying: list[subprocess.Popen[bytes]] = []
        self._tap: _TapEnds | None = None
        self._started_s = self._start_at_s = 0.0
        self._wait_s = _FIRST_WAIT_S
        self._listener: socket.socket | None = None
        self.refused: str | None = None
        if path is None:
            self.refused = "[feed] offered = false"
            return
        try:
            self._listener = listening(path, group, _BACKLOG, onlookers)
        except (OSError, LookupError) as error:
            self.refused = str(error)
            self._log.warning("the feed is not offered", why=self.refused)

    @property
    def pid(self) -> int | None:
        """Returns the process id of the feed, None while it has no client."""
        return None if self._process is None else self._process.pid

    @property
    def counts(self) -> FeedCounts:
        """Returns the counts of the feed."""
        return FeedCounts() if self._tap is None else self._tap.subscription.counts

    def tap(self) -> TapFds | None:
        """Returns descriptors for a new estimator; closes those of the one before and drops its clients.

        Returns None where there is no socket, or this process may open no more files: the estimator has priority.
        """
        if self._listener is None:
            return None
        self._end_process()
        self._close_tap()
        try:
            self._tap = _TapEnds()
        except OSError as error:
            self._log.warning("the feed is not offered", why=error.strerror or str(error))
            return None
        return self._tap.fds

    def look_after(self) -> None:
        """Starts the process when a client waits, and reaps it when it has ended; once a tick and without blocking."""
        self._reap()
        now_s = time.monotonic()
        if self._process is not None:
            if self._process.poll() is not None:
                self._note_end(self._process.returncode, now_s)
        elif self._tap is not None and now_s >= self._start_at_s and self._client_waits():
            self._start(self._tap, now_s)

    def close(self) -> None:
        """Ends the process and removes the socket."""
        self._end_process()
        self._reap(_REAP_TIMEOUT_S)
        self._close_tap()
        if self._listener is not None and self._path is not None:
            self._listener.close()
            self._listener = None
            with suppress(OSError):
                self._path.unlink(missing_ok=True)

    def _client_waits(self) -> bool:
        waiting = select.poll()
        assert self._listener is not None
        waiting.register(self._listener, select.POLLIN)
        return bool(waiting.poll(0))

    def _start(self, tap: "_TapEnds", now_s: float) -> None:
        assert self._listener is not None
        fds = (self._listener.fileno(), tap.listens.fileno(), *tap.frames.fds, tap.subscription.fd)
        try:
            command = [*self._command, *(str(fd) for fd in fds)]
            self._process = subprocess.Popen(command, pass_fds=fds, env=os.environ | ONE_THREAD)
        except OSError as error:
            self._start_at_s = now_s + self._wait_s
            self._log.warning("the feed cannot be started", why=error.strerror or str(error))
            return
        self._started_s = now_s

    def _note_end(self, code: int, now_s: float) -> None:
        """Records the end of the process. One that ended because it had no clients did not fail."""
        self._process = None
        assert self._tap is not None
        self._tap.subscription.want(NOTHING)
        if code == 0:
            self._wait_s = _FIRST_WAIT_S
            return
        lasted = now_s - self._started_s > _LASTED_S
        self._wait_s = _FIRST_WAIT_S if lasted else min(2 * self._wait_s, _LONGEST_WAIT_S)
        self._start_at_s = now_s + self._wait_s
        self._log.warning("the feed's process died", exit_code=code)

    def _end_process(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._dying.append(self._process)
            self._process = None

    def _reap(self, timeout_s: float = 0.0) -> None:
        for process in tuple(self._dying):
            with suppress(subprocess.TimeoutExpired):
                process.wait(timeout_s)
                self._dying.remove(process)

    def _close_tap(self) -> None:
        if self._tap is not None:
            self._tap.close()
            self._tap = None


class _TapEnds:
    """Holds both ends of the estimator's tap in this process, so that either of the other processes may be replaced."""

    def __init__(self) -> None:
        """Raises OSError, and then leaves nothing open."""
        with ExitStack() as made:
            self._sends, self.listens = link_pair()
            made.callback(self._sends.close)
            made.callback(self.listens.close)
            self.frames = made.enter_context(Ring(FRAMES))
            self.subscription = Subscription()
            made.pop_all()
        self.fds = TapFds(self._sends.fileno(), self.frames.fds, self.subscription.fd)

    def close(self) -> None:
        self._sends.close()
        self.listens.close()
        self.frames.close()
        self.subscription.close()
