"""Runs a recorder: it listens to the feed, asks for the status, answers `probewatch record`, and writes.

Three threads listen, one writes; whatever the disk does, the service does not wait: what does not fit into the queue
stays with the feed, which leaves samples out and reports how many.
"""

import json
import os
import queue
import secrets
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from pathlib import Path
from typing import Any, Self

import click

from probewatch.appliance.configuration.config import Config
from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.service.control.rights import Onlookers
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.service.feed.message import FeedMessage
from probewatch.appliance.service.feed.request import FeedRequest
from probewatch.appliance.service.host.unix_socket import Lines, connected, listening
from probewatch.drivers.errors import ConfigurationError, DeviceLost, ProbewatchError, system_words
from probewatch.drivers.files.atomic_file import make_folder
from probewatch.drivers.files.lock import held_lock
from probewatch.drivers.printable import printable
from probewatch.tools.recorder.recorder import Keeping, Recorder
from probewatch.tools.recorder.ring import Bounds, DiskRing
from probewatch.tools.shared.feed import Feed

_QUEUED = 96
"""Messages that wait to be written, 32 pictures or 1 s; 16 MB more wait in the feed: a disk may pause for that long.
More takes memory, of which the largest pictures need 4 MB each."""
_STATUS_EVERY_S = 0.25
"""Seconds between two questions, and until a change of the state is known; an alarm is minutes long in the files."""
_AGAIN_S = 0.02
"""Seconds before a feed that is not there is asked for again. On a quick computer an estimator that was replaced has
its first sample within 0.1 s of its feed: with 0.2 s that line was not recorded from its first sample, in three of four
runs. Shorter takes the processor for nothing: 0.15 % of it now, while there is no service."""
_ANSWER_S = 2.0
"""Seconds for either side of the recorder's own socket to send its whole line."""
_LONGEST_LINE = 4096  # bytes, as on the control socket
_GB = 1e9  # bytes, as disks are sold

_Task = Callable[[int], None]
"""(CLOCK_MONOTONIC ns) → nothing; what the writing thread is to do."""


class RecorderService:
    """Holds all of a recorder. Leave the context to end its file. Raises ConfigurationError where it cannot begin."""

    def __init__(self, config: Config, say: Callable[[str], None] = lambda text: click.echo(text, err=True)) -> None:
        self._config, self._settings, self._say = config, config.recorder, say
        if config.feed_socket is None:
            remedy = "Set [feed] offered = true and reload the service"
            raise ConfigurationError("the service offers no feed to record", "[feed]", remedy)
        self._feed_path, self._onlookers = config.feed_socket, Onlookers.of(config).refused
        self._lock, self._listener, self.recorder = _begun(config, say)
        self._listener.settimeout(_AGAIN_S)
        self._tasks: queue.Queue[_Task] = queue.Queue(_QUEUED)
        self._ended = threading.Event()
        self._feed: Feed | None = None
        self._threads = [
            threading.Thread(target=body, name=name, daemon=True)
            for name, body in (("feed", self._hear), ("status", self._ask), ("socket", self._answer))
        ]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        if self._feed is not None:
            self._feed.close()
        self._drain()
        for thread in self._threads:
            thread.join(2 * _ANSWER_S)
        self._drain()
        self.recorder.close()
        self._listener.close()
        self._settings.socket.unlink(missing_ok=True)
        os.close(self._lock)

    def run(self, ended: Callable[[], bool]) -> None:
        """Writes until ended() returns true."""
        while not ended():
            with suppress(queue.Empty):
                self._tasks.get(timeout=_STATUS_EVERY_S)(time.monotonic_ns())

    def _drain(self) -> None:
        with suppress(queue.Empty):
            while True:
                self._tasks.get_nowait()(time.monotonic_ns())

    def _do(self, task: _Task) -> None:
        """Queues a task. It waits for room, so that the feed keeps what does not fit, until the recorder ends."""
        while not self._ended.is_set():
            with suppress(queue.Full):
                self._tasks.put(task, timeout=_STATUS_EVERY_S)
                return

    def _hear(self) -> None:
        silent = False
        while not self._ended.is_set():
            try:
                with Feed(self._feed_path, FeedRequest(every=self._settings.every)) as feed:
                    self._feed, silent = feed, False
                    for message in feed:
                        self._do(_taking(self.recorder, message))
            except ProbewatchError as error:
                why = str(error)
                if not silent and not self._ended.is_set():
                    self._say(f"waiting for the service: {why}")
                    self._do(lambda now_ns, why=why: self.recorder.interrupted(why, now_ns))  # type: ignore[misc]
                silent = True
            self._ended.wait(_AGAIN_S)

    def _ask(self) -> None:
        while not self._ended.is_set():
            with suppress(ProbewatchError, ValueError, KeyError), ControlClient(self._config.control.socket) as client:
                while not self._ended.is_set():
                    status = client.status()
                    self._do(lambda now_ns, status=status: self.recorder.state(status, now_ns))  # type: ignore[misc]
                    self._ended.wait(_STATUS_EVERY_S)
            self._ended.wait(_STATUS_EVERY_S)

    def _answer(self) -> None:
        while not self._ended.is_set():
            with suppress(OSError):
                link, _ = self._listener.accept()
                with link:
                    reply = self._reply(_line(link, _ANSWER_S), _uid(link))
                    link.settimeout(_ANSWER_S)
                    link.sendall(json.dumps(reply).encode() + b"\n")

    def _reply(self, line: bytes, uid: int) -> dict[str, Any]:
        try:
            asked = json.loads(line)
            do, reason = str(asked["do"]), printable(str(asked.get("reason", "")))
        except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
            return {"ok": False, "error": "a request is one line of JSON with do"}
        if do not in ("start", "stop", "status"):
            return {"ok": False, "error": "it knows start, stop, status"}
        if do != "status" and uid in self._onlookers:
            return {"ok": False, "error": "your user may look on and request nothing (viewers of [control] and [feed])"}
        done: queue.Queue[str] = queue.Queue()
        self._do(lambda now_ns: done.put(self._marked(do, reason, now_ns)))
        with suppress(queue.Empty):
            refused = done.get(timeout=_ANSWER_S)
            return {"ok": False, "error": refused} if refused else {"ok": True, **self.recorder.fields()}
        return {"ok": False, "error": "the recorder is busy; is its disk?"}

    def _marked(self, do: str, reason: str, now_ns: int) -> str:
        """Carries out a request, and returns why it was refused; empty where it was not."""
        try:
            if do != "status":
                self.recorder.mark(do, reason, now_ns)
        except ValueError as error:
            return str(error)
        return ""


def ask(path: Path, do: str, reason: str = "", start: str = "probewatch record") -> dict[str, Any]:
    """Sends a request to a running recorder, and returns its fields. start: the command that starts one for this cart.
    Raises DeviceLost where none answers, ControlRefused where it does not do it now.
    """
    try:
        with connected(path, 2 * _ANSWER_S) as link:
            link.sendall(json.dumps({"do": do, "reason": reason}).encode() + b"\n")
            reply = json.loads(_line(link, 2 * _ANSWER_S))
    except (OSError, ValueError) as error:
        raise DeviceLost(f"no recorder answers ({system_words(error)})", str(path), f"Start it: {start}") from None
    if not isinstance(reply, dict) or not ("error" in reply or reply.get("ok")):
        raise DeviceLost("what answers is no recorder", str(path), f"Start it: {start}")
    if not reply.get("ok"):
        raise ControlRefused(printable(str(reply["error"])))
    return reply


def _taking(recorder: Recorder, message: FeedMessage) -> _Task:
    return lambda now_ns: recorder.take(message, now_ns)


def _uid(link: socket.socket) -> int:
    """Returns the user of the process that asks, as the kernel knows it."""
    _pid, uid, _gid = struct.unpack("3i", link.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i")))
    return int(uid)


def _line(link: socket.socket, timeout_s: float) -> bytes:
    """Returns a line; one that is too long counts as none. Raises OSError."""
    try:
        return Lines(link, _LONGEST_LINE).next(timeout_s)
    except ValueError:
        return b""


@contextmanager
def _needing(key: str, path: Path) -> Iterator[None]:
    """Raises ConfigurationError that names the key whose path cannot be used."""
    try:
        yield
    except BlockingIOError:
        what, remedy = "another recorder writes there", "Stop that one first, or give this cart a folder of its own"
        raise ConfigurationError(what, f"[recorder] {key} = {str(path)!r}", remedy) from None
    except OSError as error:
        remedy = f"Give [recorder] {key} a place that exists and that this user may write to"
        said = error.strerror or str(error)
        raise ConfigurationError(f"cannot be used ({said})", f"[recorder] {key} = {str(path)!r}", remedy) from None
    except LookupError as error:
        remedy = "Create the group, or name another one in [control] group"
        raise ConfigurationError(f"cannot be used ({error})", f"[recorder] {key} = {str(path)!r}", remedy) from None


def _begun(config: Config, say: Callable[[str], None]) -> tuple[int, socket.socket, Recorder]:
    """Returns lock, socket and recorder. An existing folder is locked before the socket of a running recorder is
    replaced; nothing is made in a folder, nor the folder itself, before the socket exists. Raises ConfigurationError.
    """
    folder, own = config.recorder.folder, config.recorder.socket
    with ExitStack() as begun:
        with _needing("folder", folder):
            lock = _locked(folder) if folder.is_dir() else None
        with _needing("socket", own):
            listener = begun.enter_context(listening(own, config.control.group, 8))
        begun.callback(own.unlink, missing_ok=True)
        with _needing("folder", folder):
            make_folder(folder, 0o750)
            lock = _locked(folder) if lock is None else lock
            recorder = _recorder(config, say)
        begun.pop_all()
        return lock, listener, recorder


def _locked(folder: Path) -> int:
    """Returns the descriptor of a lock that another recorder of this folder would hold. Raises OSError; BlockingIOError
    where one does.
    """
    return held_lock(folder / ".lock")


def _recorder(config: Config, say: Callable[[str], None]) -> Recorder:
    settings = config.recorder
    bounds = Bounds(round(settings.ring_gb * _GB), round(settings.kept_gb * _GB), round(settings.leave_free_gb * _GB))
    before_ns, after_ns = (round(s * 1e9) for s in (settings.before_alarm_s, settings.after_alarm_s))
    keeping = Keeping(before_ns, after_ns, settings.every, settings.text == "blacken")
    ring = DiskRing(settings.folder, bounds)
    return Recorder(ring, keeping, secrets.token_hex(4), f"probewatch {version('probewatch')}", _utc, say)


def _utc(now_ns: int) -> str:
    ago = timedelta(microseconds=(time.monotonic_ns() - now_ns) / 1e3)
    return (datetime.now(UTC) - ago).isoformat(timespec="milliseconds")
