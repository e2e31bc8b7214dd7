"""Opens `opencv:FILE`, `opencv:rtsp://host/stream`, `opencv:0`: whatever OpenCV can read, for sources that no other
scheme serves.

Its options are the rows of OPENCV, in the folder's `__init__.py`. A picture of a device or stream is stamped at its
arrival less delay_ms, as OpenCV gives no reliable times. A file plays at its own rate from the moment it is opened and
is lost at its end. The counter counts what was read, so losses before OpenCV do not show: prefer v4l2: where it works.
In the address of a stream write %3F for a question mark.
"""

import math
import os
import threading
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import cv2
import numpy as np

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable
from probewatch.drivers.device_api import Description
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.samples import Frame, GreyImage, Stamp
from probewatch.drivers.video import OPENCV
from probewatch.drivers.video.crop import Cut, cut_from
from probewatch.drivers.video.no_film import why_no_film

_OPEN_MS, _READ_MS = 5000, 2000
"""Time limits for FFmpeg on a stream, ms. A camera that does not answer holds the thread that long before the next
attempt; less gives up on one that is slow to start. tests/live/test_network_video.py allows 8 s until it is lost, and
40 until it is back.
"""

_WAITING = 4
"""Pictures that wait for their reader, 0.13 s at 30 Hz; when there are more, the oldest is dropped. More passes on
older pictures after a delay; fewer loses some of them.
"""

_MOST_PX = 1 << 24
"""Pixels of a picture, 4096 × 4096: four times those of a screen of 2560 × 1600, which is the most that the service
takes. A picture of 12000 × 12000 takes OpenCV 1.6 GB, more than the unit may have.
"""

_LEAVE_S = 0.5
"""Seconds for the thread to leave its read at the end. More delays the service's end; less leaves threads behind."""

_RATES_HZ = (0.1, 1000.0)
"""Picture rates that a file may state, Hz; others mean a damaged header or a film without one."""

_CHECK = "Check the address, and that the device sends"


def open_video(target: str, options: dict[str, str], clock: HostClock) -> "OpenCvVideo":
    """Opens the source; see drivers.registry for what is raised."""
    where = f"opencv:{target}"
    delay_ms, error_ms, cut = checked(target, options)
    is_stream = "://" in target
    source: str | int = int(target) if target.isdecimal() else unquote(target) if is_stream else target
    is_file = not is_stream and not target.isdecimal() and not Path(target).is_char_device()
    if is_file and not Path(target).is_file():
        raise DeviceLost("no such file", where, "Correct the path")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    # OpenCV writes its guesses about a source that it cannot read to stderr, between the lines of the log.
    cv2.utils.logging.setLogLevel(0)
    capture = _open(source, is_stream)
    if refused := why_no_film(capture, "OpenCV cannot read it", _CHECK):
        raise DeviceLost(refused[0], where, refused[1])
    width, height = (round(capture.get(side)) for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
    if width * height > _MOST_PX:
        capture.release()
        what = f"sends pictures of {width} x {height} pixels, more than {_MOST_PX}"
        raise DeviceLost(what, where, "Have it send smaller ones: no picture of a scanner is so large")
    rate_hz = float(capture.get(cv2.CAP_PROP_FPS)) or math.nan
    if is_file and not _RATES_HZ[0] <= rate_hz <= _RATES_HZ[1]:
        capture.release()
        raise DeviceLost("the file does not state its picture rate", where, "Convert it, or record again")
    return OpenCvVideo(capture, where, _Times(clock, is_file, rate_hz, delay_ms, error_ms), cut)


def checked(target: str, options: dict[str, str]) -> tuple[float, float, Cut]:
    """Returns (delay, ms; its error, ms; what to cut out). Raises ConfigurationError that names the option."""
    given = OPENCV.given(options, f"opencv:{target}")
    return given.number("delay_ms"), given.number("error_ms"), cut_from(given)


def _open(source: str | int, is_stream: bool) -> Any:
    """Opens the source in OpenCV. Its backend knows the timeouts for streams alone."""
    if not is_stream:
        return cv2.VideoCapture(source)
    limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _OPEN_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, _READ_MS]
    return cv2.VideoCapture(source, cv2.CAP_FFMPEG, limits)


class _Times:
    """Determines the times of pictures. paced: whether it is a file, whose pictures are due a period apart."""

    def __init__(self, clock: HostClock, paced: bool, rate_hz: float, delay_ms: float, error_ms: float) -> None:
        self.clock, self.paced, self.rate_hz, self.error_ms = clock, paced, rate_hz, error_ms
        self._delay_ns, self._error_ns = round(delay_ms * 1e6), round(error_ms * 1e6)
        self._first_ns = clock.now_ns()

    def due_ns(self, number: int) -> int:
        """Returns when picture `number`, from 0, of a file is due."""
        return self._first_ns + round(number * 1e9 / self.rate_hz)

    def stamp(self, number: int) -> Stamp:
        """Returns the stamp of the picture that has just been read; that of a file is exact by definition."""
        if self.paced:
            return Stamp(self.due_ns(number), round(0.5e9 / self.rate_hz))
        return Stamp(self.clock.now_ns() - self._delay_ns, self._error_ns)


class OpenCvVideo(Closable):
    """Reads pictures in a thread, as OpenCV may block for any time; a new picture replaces the oldest waiting one."""

    def __init__(self, capture: Any, where: str, times: _Times, cut: Cut) -> None:
        self._capture, self._where, self._times, self._cut = capture, where, times, cut
        self._frames: deque[Frame] = deque(maxlen=_WAITING)
        self._news, self._closing = threading.Condition(), threading.Event()
        self._end: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="opencv", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends the reading. A read that hangs is left behind after a timeout; its thread then releases the device."""
        self._closing.set()
        self._thread.join(_LEAVE_S)

    def describe(self) -> Description:
        """See drivers.device_api.Identified."""
        if self._times.paced:
            remark = "a file: it plays at its own rate"
        else:
            remark = f"stamped at arrival, to ± {self._times.error_ms:g} ms by error_ms="
        return Description(f"OpenCV {self._where.partition(':')[2]}", rate_hz=self._times.rate_hz, remarks=(remark,))

    def read(self, timeout_s: float) -> Frame | None:
        """Returns the next picture, or None when none came within timeout_s of the clock. Raises DeviceLost."""
        with self._news:
            self._news.wait_for(lambda: self._frames or self._end, self._times.clock.real_s(timeout_s))
            if self._frames:
                return self._frames.popleft()
            if self._end is not None:
                raise self._end
            return None

    def _run(self) -> None:
        try:
            self._pump()
        except BaseException as error:
            self._finish(error)
        finally:
            with suppress(cv2.error):
                self._capture.release()

    def _pump(self) -> None:
        number = 0
        while not self._closing.is_set():
            there, image = self._capture.read()
            if not there and not number:
                remedy = "Convert the film, or have the device send another codec, such as H.264"
                raise DeviceLost("no picture of it can be decoded", self._where, remedy)
            if not there:
                what = "the film has ended" if self._times.paced else "sends no more pictures"
                raise DeviceLost(what, self._where, _CHECK)
            if self._times.paced and not self._wait_until(self._times.due_ns(number)):
                return
            frame = Frame(self._times.stamp(number), number, self._cut.apply(_grey(image), self._where))
            with self._news:
                self._frames.append(frame)
                self._news.notify()
            number += 1

    def _wait_until(self, due_ns: int) -> bool:
        """Waits until due_ns. Returns False where the source was closed meanwhile."""
        clock = self._times.clock
        return not self._closing.wait(max(0.0, clock.real_s((due_ns - clock.now_ns()) / 1e9)))

    def _finish(self, error: BaseException) -> None:
        with self._news:
            self._end = error
            self._news.notify()


def _grey(image: np.ndarray) -> GreyImage:
    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.asarray(image, np.uint8)
