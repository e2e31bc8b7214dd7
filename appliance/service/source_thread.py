"""Capture and tracker threads: read a source, note the arrival, hand the sample on."""

from collections.abc import Callable

from appliance.service.device_thread import DeviceThread
from drivers.errors import DeviceLost
from drivers.hosttime import HostClock
from drivers.ports import TrackerSource, VideoSource
from drivers.samples import Frame, Pose, PoseStatus, Sample

_READ_S = 0.1
_REOPEN_AFTER_NS = 3_000_000_000
_IN_SERVICE = frozenset(PoseStatus) - {PoseStatus.DISABLED, PoseStatus.FAULT}


class SourceThread(DeviceThread):
    """deliver takes each sample; it never blocks, and raises ValueError for one too large to pass on."""

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
        self.samples = 0

    def note(self, sample: Sample, now_ns: int) -> None:
        """Keep what the watchers need to know of this sample."""
        raise NotImplementedError

    def work(self) -> None:
        with self._open(self.url, self._clock) as source:
            last_ns = self._clock.now_ns()
            while not self._stopping.is_set():
                sample = source.read(_READ_S)
                now_ns = self._clock.now_ns()
                if sample is not None:
                    last_ns = now_ns
                    self._pass_on(sample, now_ns)
                elif now_ns - last_ns > _REOPEN_AFTER_NS:
                    raise DeviceLost("is open but sends nothing", self.url, "Check its cable and that it is running")

    def _pass_on(self, sample: Sample, now_ns: int) -> None:
        try:
            self._deliver(sample)
        except ValueError as error:
            raise DeviceLost(str(error), self.url, "Lower the picture size of the source") from None
        self.samples += 1
        self.note(sample, now_ns)
        self.note_success()


class CaptureThread(SourceThread):
    """frame_ns: arrival of the last frame. gaps: frames that the device counted and nobody saw."""

    frame_ns: int | None = None
    gaps = 0
    _sequence: int | None = None

    def note(self, sample: Sample, now_ns: int) -> None:
        assert isinstance(sample, Frame)
        if self._sequence is not None:
            self.gaps += max(0, sample.sequence - self._sequence - 1)
        self._sequence = sample.sequence
        self.frame_ns = now_ns


class TrackerThread(SourceThread):
    """Arrival times as appliance.supervision.watchers.facts.Facts names them."""

    reply_ns: int | None = None
    fresh_ns: int | None = None
    pose_ns: int | None = None
    pose_status: PoseStatus | None = None

    def note(self, sample: Sample, now_ns: int) -> None:
        assert isinstance(sample, Pose)
        if sample.status in _IN_SERVICE:
            self.reply_ns = now_ns
        if sample.status is not PoseStatus.STALE:
            self.fresh_ns = now_ns
        if sample.status is PoseStatus.OK:
            self.pose_ns = now_ns
        self.pose_status = sample.status
