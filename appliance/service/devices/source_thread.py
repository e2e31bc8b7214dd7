"""Runs the capture and tracker threads: each reads a source, notes the arrival of a sample and passes it on."""

import threading
from collections import deque
from collections.abc import Callable, Iterable
from statistics import median
from typing import Any

from probewatch.appliance.core.acquisition.input_validation import refused_picture
from probewatch.appliance.service.devices.device_thread import DeviceThread
from probewatch.appliance.supervision.device_health import Replies
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.device_api import BumpDetector, Description, Identified, TrackerSource, VideoSource, Watched
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.samples import Frame, MarkerBody, Pose, Sample

_READ_S = 0.1
"""s, the timeout of a read. More delays the end and a person's requests to the tracker; less costs wake-ups."""
_REOPEN_AFTER_NS = 3_000_000_000
"""ns of silence after which an open device is opened again. The alarm does not wait for it (`Timeouts`). Less
interrupts a device that is about to resume; more adds to the time to recover.
"""
_LOOK_NS = 200_000_000
_LOOKS = 5
"""The marker body is checked every _LOOK_NS, and the median of _LOOKS checks counts: one second, in which two bad fits
are outvoted. More reports a bent body later.
"""
_LISTEN_NS = 1_000_000_000
"""ns between two reads of a tracker's remarks, such as a low battery, which are for a person to read."""


class SourceThread(DeviceThread):
    """Reads a source. deliver takes each sample; it never blocks, and raises ValueError for one too large to pass on.

    samples: number passed on. early_stamps: number refused because they were stamped later than they arrived.
    """

    def __init__(
        self,
        role: str,
        url: str,
        open_source: Callable[[str, HostClock], VideoSource | TrackerSource],
        deliver: Callable[[Sample], None],
        clock: HostClock,
    ) -> None:
        super().__init__(role, url, clock)
        self._open, self._deliver = open_source, deliver
        self.samples = self.early_stamps = 0

    def note(self, sample: Sample, now_ns: int) -> None:
        """Keeps what the watchers need to know about this sample."""
        raise NotImplementedError

    def tend(self, source: VideoSource | TrackerSource) -> None:
        """Serves the open device between two reads; does nothing unless a kind of source overrides it."""

    def work(self) -> None:
        with self._open(self.url, self._clock) as source:
            last_ns = self._clock.now_ns()
            while not self._stopping.is_set():
                self.tend(source)
                sample = source.read(_READ_S)
                now_ns = self._clock.now_ns()
                if sample is not None:
                    last_ns = now_ns
                    self._pass_on(sample, now_ns)
                elif now_ns - last_ns > _REOPEN_AFTER_NS:
                    raise self._silent(source)

    def _silent(self, source: VideoSource | TrackerSource) -> DeviceLost:
        """Returns the error for a silent source. A server that sends data by other names has no cable to check."""
        described = source.describe() if isinstance(source, Identified) else Description("")
        if described.absent:
            return DeviceLost(described.absent, self.url, described.remedy)
        return DeviceLost("is open but sends nothing", self.url, "Check its cable and that it is running")

    def _pass_on(self, sample: Sample, now_ns: int) -> None:
        if sample.stamp.later_than(now_ns):
            self._refuse_early(sample, now_ns)
            return
        try:
            self._deliver(sample)
        except ValueError as error:
            raise DeviceLost(str(error), self.url, "Lower the picture size of the source") from None
        self.samples += 1
        self.note(sample, now_ns)
        self.note_success()

    def _refuse_early(self, sample: Sample, now_ns: int) -> None:
        """Counts a sample that is stamped later than it arrived and drops it: it would seem fresh until that time."""
        if self.early_stamps == 0:
            ahead_ms = (sample.stamp.t_ns - now_ns) / 1e6
            self._log.warning("stamped later than it arrived, refused", ahead_ms=round(ahead_ms, 3))
        self.early_stamps += 1


class CaptureThread(SourceThread):
    """Reads the scanner. frame_ns: arrival of the last frame. size_px: (width, height) of the last frame that the line
    can use. gaps: frames that the device counted and that never came.
    """

    frame_ns: int | None = None
    size_px: tuple[int, int] | None = None
    gaps = 0
    _sequence: int | None = None

    def note(self, sample: Sample, now_ns: int) -> None:
        assert isinstance(sample, Frame)
        if self._sequence is not None:
            self.gaps += max(0, sample.sequence - self._sequence - 1)
        self._sequence = sample.sequence
        if not refused_picture(sample.image):
            self.size_px = sample.image.shape[1], sample.image.shape[0]
        self.frame_ns = now_ns


class TrackerThread(SourceThread):
    """Reads the tracker. replies, body: as in appliance.supervision.device_health.DeviceHealth.

    remarks: what the tracker reports besides its poses, such as a low battery; first, why the last pose has no number.
    """

    replies = Replies()
    body: MarkerBody | None = None
    remarks: tuple[str, ...] = ()
    _reason = ""
    _look_ns = _listen_ns = 0
    _described: tuple[str, ...] = ()
    _has_bump_detector = False

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._looks = deque[MarkerBody](maxlen=_LOOKS)
        self._bump_checked = threading.Event()

    def work(self) -> None:
        self.body, self._look_ns, self._listen_ns = None, 0, 0
        self._looks.clear()
        try:
            super().work()
        finally:
            self._has_bump_detector, self.remarks = False, ()
            self._bump_checked.clear()

    def note(self, sample: Sample, now_ns: int) -> None:
        assert isinstance(sample, Pose)
        self.replies, self._reason = self.replies.noted(sample.status, now_ns), sample.reason

    def tend(self, source: VideoSource | TrackerSource) -> None:
        """Reads the tracker's report of its own condition at intervals, and clears a bump that a person has checked."""
        now_ns = self._clock.now_ns()
        if now_ns < self._look_ns:
            return
        self._look_ns = now_ns + _LOOK_NS
        self._look(source)
        if now_ns >= self._listen_ns:
            self._listen_ns = now_ns + _LISTEN_NS
            self._described = source.describe().remarks if isinstance(source, Identified) else ()
        self.remarks = tuple(filter(None, (self._reason, *self._described)))
        self._has_bump_detector = isinstance(source, BumpDetector)
        if isinstance(source, BumpDetector) and self._bump_checked.is_set():
            source.clear_bump()
            self._bump_checked.clear()
            self._log.info("bump cleared")

    def clear_bump(self) -> bool:
        """Asks the open tracker to trust its position sensor again; returns False where no tracker can be asked."""
        if self._has_bump_detector:
            self._bump_checked.set()
        return self._has_bump_detector

    def _look(self, source: VideoSource | TrackerSource) -> None:
        if isinstance(source, Watched):
            self._looks.append(source.body())
            self.body = _middle(self._looks)


def _middle(bodies: Iterable[MarkerBody]) -> MarkerBody:
    """Returns the median of each figure, so that one bad fit is not taken for a bad body."""
    fits, shapes, indicators = zip(*((b.fit_mm, b.shape_mm, b.indicator) for b in bodies), strict=True)
    return MarkerBody(*(_median(figures) for figures in (fits, shapes, indicators)))


def _median(figures: Iterable[float | None]) -> float | None:
    known = [figure for figure in figures if figure is not None]
    return median(known) if known else None
