"""The newest picture of the service's feed as a JPEG, made anew for nobody: only while somebody looks."""

import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from appliance.service.feed.message import Taken
from appliance.service.feed.request import FeedRequest
from drivers.errors import ProbewatchError
from drivers.samples import Frame, GreyImage
from tools.shared.feed import Feed

_EVERY, _MOST_PX = 3, 960
"""One picture of three, ten a second of a scanner at 30 Hz; longest side. More shows smoother motion and takes the
cart's processor: encoding one of 640 × 480 takes 3 ms."""
_QUALITY = 80
"""Of the JPEG: speckle is not to be measured here. 640 × 480 takes some 60 kB. Not varied."""
_LOOKED_AT_S = 3.0
"""After the last request for a picture before the feed is left alone. Longer keeps it for nobody; shorter leaves and
joins again between two requests of a slow tablet."""
_AGAIN_S = 0.5
"""Before a service that offers nothing is asked again."""


class Pictures:
    """feed: socket of the service. trouble: why there is no picture, in words; empty while there is."""

    def __init__(self, feed: Path) -> None:
        self._feed = feed
        self._wanted_s = -_LOOKED_AT_S
        self._ended, self._wanted = threading.Event(), threading.Event()
        self._newest: tuple[int, int, bytes] | None = None
        self._number = 0
        self._thread = threading.Thread(target=self._run, name="pictures", daemon=True)
        self.trouble = ""

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self._ended.set()
        self._wanted.set()
        self._thread.join(2 * _LOOKED_AT_S)

    def newest(self) -> tuple[int, int, bytes] | None:
        """(number, t_ns, JPEG); None while there is none. Asking keeps them coming."""
        self._wanted_s = time.monotonic()
        self._wanted.set()
        return self._newest

    def _run(self) -> None:
        while not self._ended.is_set():
            if not self._looked_at:
                self._newest = None
                self._wanted.clear()
                self._wanted.wait()
                continue
            try:
                with Feed(self._feed, FeedRequest(every=_EVERY, most_px=_MOST_PX)) as feed:
                    self._listen(feed)
            except ProbewatchError as error:
                self._newest, self.trouble = None, error.what
                self._ended.wait(_AGAIN_S)

    @property
    def _looked_at(self) -> bool:
        return time.monotonic() - self._wanted_s < _LOOKED_AT_S

    def _listen(self, feed: Feed) -> None:
        while self._looked_at and not self._ended.is_set():
            message = feed.next(_AGAIN_S)
            if isinstance(message, Taken) and isinstance(message.sample, Frame):
                self._number += 1
                self._newest = self._number, message.sample.stamp.t_ns, jpeg(message.sample.image)
                self.trouble = ""


def jpeg(image: GreyImage) -> bytes:
    """image: (h, w)."""
    _, encoded = cv2.imencode(".jpg", np.ascontiguousarray(image), [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    return encoded.tobytes()
