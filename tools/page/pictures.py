"""Encodes the newest picture of the service's feed as a JPEG, only while a browser shows it."""

import threading
import time
from collections import deque
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from probewatch.appliance.service.feed.message import Taken
from probewatch.appliance.service.feed.request import FeedRequest
from probewatch.drivers.errors import ProbewatchError
from probewatch.drivers.samples import Frame, GreyImage
from probewatch.tools.shared.feed import Feed
from probewatch.tools.shared.threaded import Threaded

_EVERY, _MOST_PX = 3, 960
"""One picture of three, ten a second of a scanner at 30 Hz; the longest side, px. More shows smoother motion and takes
the cart's processor: encoding one of 640 × 480 takes 3 ms."""
_QUALITY = 80
"""Quality of the JPEG: speckle is not to be measured here. 640 × 480 takes some 60 kB. Not varied."""
_LOOKED_AT_S = 3.0
"""Seconds after the last request for a picture before the feed is left alone. Longer keeps it for nobody; shorter
leaves and joins again between two requests of a slow tablet."""
_KEPT = 12
"""Number of the last pictures that are kept: a second, so that the crossing has been looked for in one of them."""
_AGAIN_S = 0.5
"""Seconds before a service that offers nothing is asked again."""


class Picture(NamedTuple):
    """Holds one encoded picture. number: counts the pictures of this page."""

    number: int
    t_ns: int
    jpeg: bytes


class Pictures(Threaded):
    """Reads the feed and keeps its last pictures. feed: socket of the service. trouble: why there is no picture, in
    words; empty while there is.
    """

    def __init__(self, feed: Path) -> None:
        self._feed = feed
        self._wanted_s = -_LOOKED_AT_S
        self._ended, self._wanted = threading.Event(), threading.Event()
        self._last: deque[Picture] = deque(maxlen=_KEPT)
        self._number = 0
        super().__init__("pictures")
        self.trouble = ""

    def close(self) -> None:
        """Ends the thread."""
        self._ended.set()
        self._wanted.set()
        self._thread.join(2 * _LOOKED_AT_S)

    def newest(self, looked_ns: int | None = None) -> Picture | None:
        """Returns the newest picture, None while there is none, and keeps the feed running. looked_ns: time that it
        must not be after.
        """
        self._wanted_s = time.monotonic()
        self._wanted.set()
        known = tuple(self._last)
        return next((one for one in reversed(known) if looked_ns is None or one.t_ns <= looked_ns), None)

    def _run(self) -> None:
        while not self._ended.is_set():
            if not self._looked_at:
                self._last.clear()
                self._wanted.clear()
                self._wanted.wait()
                continue
            try:
                with Feed(self._feed, FeedRequest(every=_EVERY, most_px=_MOST_PX)) as feed:
                    self._listen(feed)
            except ProbewatchError as error:
                self._last.clear()
                self.trouble = error.what
                self._ended.wait(_AGAIN_S)

    @property
    def _looked_at(self) -> bool:
        return time.monotonic() - self._wanted_s < _LOOKED_AT_S

    def _listen(self, feed: Feed) -> None:
        while self._looked_at and not self._ended.is_set():
            message = feed.next(_AGAIN_S)
            if isinstance(message, Taken) and isinstance(message.sample, Frame):
                self._number += 1
                self._last.append(Picture(self._number, message.sample.stamp.t_ns, jpeg(message.sample.image)))
                self.trouble = ""


def jpeg(image: GreyImage) -> bytes:
    """Returns the picture as a JPEG. image: (h, w)."""
    _, encoded = cv2.imencode(".jpg", np.ascontiguousarray(image), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return encoded.tobytes()
