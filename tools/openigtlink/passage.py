"""The newest pictures and poses of the service's feed, read by a thread of its own, and only while somebody asks."""

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
"""That wait for the server, a second of 60 Hz: then the oldest go. More hands on what is late, less loses some while a
picture is being sent."""

_AGAIN_S = 0.5
"""Before a service that offers nothing is asked again, and until it is noticed that nobody asks any more."""


class Wanted(NamedTuple):
    """What clients have asked for."""

    pictures: bool = False
    poses: bool = False


class Passage(Threaded):
    """feed: socket of the service. say: for the journal. trouble: why nothing comes, in words; empty while it does."""

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
        """See Closable."""
        self._ended = True
        self._changed.set()
        self._thread.join()
        os.close(self._read_fd)
        os.close(self._write_fd)

    def fileno(self) -> int:
        """Can be read from when something has come."""
        return self._read_fd

    def want(self, wanted: Wanted) -> None:
        """Set what is wanted from now on; the feed is left alone while nothing is."""
        before, self._wanted = self._wanted, wanted
        if (any(before), before.pictures) != (any(wanted), wanted.pictures):
            self._changed.set()

    def take(self) -> tuple[Frame | Pose, ...]:
        """What has come since, of pictures the last one alone, in the order of their times."""
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
            if self._ended:  # looked at after the event is cleared, or the end might be missed
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
        """Whether it is worth waking the server. Poses that are none stay here: clients may not know how to ask."""
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
