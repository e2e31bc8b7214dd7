"""Keeps the newest pictures and poses of the service's feed, which a thread reads only while a client asks for them."""

import os
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from probewatch.appliance.service.feed.message import FeedMessage, Taken
from probewatch.appliance.service.feed.request import FeedRequest
from probewatch.drivers.errors import ProbewatchError
from probewatch.drivers.samples import Frame, Pose, PoseStatus
from probewatch.tools.shared.feed import Feed
from probewatch.tools.shared.threaded import Threaded

_MOST_POSES = 64
"""Poses that wait for the server, a second at 60 Hz: beyond that the oldest are dropped. More hands on what is late,
less loses some while a picture is being sent."""

_AGAIN_S = 0.5
"""Seconds before a service that offers nothing is asked again, and until it is noticed that no client asks any more."""


class Wanted(NamedTuple):
    """Holds what clients have asked for."""

    pictures: bool = False
    poses: bool = False


class Passage(Threaded):
    """Reads the feed in a thread. feed: socket of the service. say: writes to the journal. trouble: why nothing comes,
    in words; empty while it does.
    """

    def __init__(self, feed: Path, say: Callable[[str], None]) -> None:
        self._feed, self._say = feed, say
        self._wanted = Wanted()
        self._changed, self._ended = threading.Event(), False
        self._frame: Frame | None = None
        self._poses: deque[Pose] = deque(maxlen=_MOST_POSES)
        self._read_fd, self._write_fd = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        super().__init__("feed")
        self.trouble = ""

    def close(self) -> None:
        """Ends the thread, and closes its descriptors."""
        self._ended = True
        self._changed.set()
        self._thread.join()
        os.close(self._read_fd)
        os.close(self._write_fd)

    def fileno(self) -> int:
        """Returns a descriptor that is readable when something has come."""
        return self._read_fd

    def want(self, wanted: Wanted) -> None:
        """Sets what is wanted from now on; the feed is left alone while nothing is."""
        before, self._wanted = self._wanted, wanted
        if (any(before), before.pictures) != (any(wanted), wanted.pictures):
            self._changed.set()

    def take(self) -> tuple[Frame | Pose, ...]:
        """Returns the samples since the last call, in the order of their times; of pictures the last one alone."""
        with suppress(BlockingIOError):
            os.read(self._read_fd, 1 << 12)
        found: list[Frame | Pose] = []
        with suppress(IndexError):
            while True:
                found.append(self._poses.popleft())
        frame, self._frame = self._frame, None
        if frame is not None:
            found.append(frame)
        return tuple(sorted(found, key=lambda sample: sample.stamp.t_ns))

    def _run(self) -> None:
        while True:
            self._changed.clear()
            if self._ended:  # checked after the event is cleared, or the end might be missed
                return
            wanted = self._wanted
            if not any(wanted):
                self._frame, self.trouble = None, ""
                self._poses.clear()
                self._changed.wait()
                continue
            try:
                with Feed(self._feed, FeedRequest(pictures=wanted.pictures)) as feed:
                    self._report("")
                    self._listen(feed)
            except ProbewatchError as error:
                self._report(str(error))
                self._changed.wait(_AGAIN_S)

    def _listen(self, feed: Feed) -> None:
        while not self._changed.is_set():
            message = feed.next(_AGAIN_S)
            if message is not None and self._keep(message):
                with suppress(BlockingIOError):
                    os.write(self._write_fd, b"\0")

    def _keep(self, message: FeedMessage) -> bool:
        """Keeps a sample, and returns whether it is worth waking the server. Poses without a matrix are dropped:
        clients may not know how to recognise them.
        """
        if not isinstance(message, Taken):
            return False
        sample = message.sample
        if isinstance(sample, Frame):
            self._frame = sample
        elif sample.status is PoseStatus.OK and self._wanted.poses:
            self._poses.append(sample)
        else:
            return False
        return True

    def _report(self, trouble: str) -> None:
        if trouble and not self.trouble:
            self._say(f"no pictures or poses: {trouble}")
        elif self.trouble and not trouble:
            self._say("pictures and poses come again")
        self.trouble = trouble
