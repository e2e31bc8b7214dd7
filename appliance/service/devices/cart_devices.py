"""Owns the threads of all devices of the cart: scanner, tracker, outputs."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from probewatch.appliance.configuration.config import Config
from probewatch.appliance.service.devices.device_thread import DeviceThread
from probewatch.appliance.service.devices.output_thread import OutputThread
from probewatch.appliance.service.devices.rate_meter import RateMeter
from probewatch.appliance.service.devices.source_thread import CaptureThread, TrackerThread
from probewatch.appliance.supervision.annunciator import Role
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.device_api import AlarmOutput, TrackerSource, VideoSource
from probewatch.drivers.registry import open_output, open_tracker, open_video
from probewatch.drivers.samples import Sample

_JOIN_S = 1.0
"""s, how long the end waits for the thread of a device that hangs: a good one ends within its read of 0.1 s."""


@dataclass(frozen=True, slots=True)
class Openers:
    """Holds the functions that open a device from its URL; drivers.registry states what they raise."""

    video: Callable[[str, HostClock], VideoSource] = open_video
    tracker: Callable[[str, HostClock], TrackerSource] = open_tracker
    output: Callable[[str, HostClock], AlarmOutput] = open_output


class CartDevices:
    """Owns the threads of the devices. deliver: takes each sample of scanner and tracker; never blocks."""

    def __init__(self, config: Config, deliver: Callable[[Sample], None], clock: HostClock, openers: Openers) -> None:
        self.video = CaptureThread("video", config.video.url, openers.video, deliver, clock)
        self.tracker = TrackerThread("tracker", config.tracker.url, openers.tracker, deliver, clock)
        self.outputs = [OutputThread(output.signal, output.url, openers.output, clock) for output in config.output]
        self.threads: tuple[DeviceThread, ...] = (*self.outputs, self.video, self.tracker)
        self._fps = {"video": RateMeter(), "tracker": RateMeter()}

    def start(self) -> None:
        """Opens all devices, each in its thread."""
        for thread in self.threads:
            thread.start()

    def close(self) -> None:
        """Closes the devices, outputs first; the thread of a device that hangs is abandoned after a second."""
        for thread in self.threads:
            thread.stop()
        for thread in self.threads:
            thread.join(_JOIN_S)

    def command(self, energised: Mapping[Role, bool], since_ns: int) -> None:
        """Commands each output to show its signal. since_ns: when the cause of a change became known."""
        for output in self.outputs:
            output.command(energised[output.signal], since_ns)

    def note_overload(self, since_ns: int | None) -> None:
        """Records since when this computer has been short of time; None while it is not."""
        for thread in self.threads:
            thread.overload_ns = since_ns

    def note_rates(self, now_ns: int) -> None:
        """Updates the sample rates, once a tick."""
        self._fps["video"].note(now_ns, self.video.samples)
        self._fps["tracker"].note(now_ns, self.tracker.samples)

    @property
    def failures(self) -> tuple[BaseException | None, ...]:
        """Returns the failure of each thread, see DeviceThread."""
        return tuple(thread.failure for thread in self.threads)

    @property
    def fps(self) -> dict[str, float]:
        """Returns the samples per second of scanner and tracker."""
        return {name: round(meter.per_s, 2) for name, meter in self._fps.items()}

    @property
    def output_ns(self) -> int | None:
        """Returns the last completed write of the output that lags most; None while one has completed none."""
        written = [output.written_ns for output in self.outputs]
        known = [written_ns for written_ns in written if written_ns is not None]
        return min(known) if len(known) == len(written) else None

    @property
    def writes(self) -> int:
        """Returns the number of completed writes of all outputs together."""
        return sum(output.writes for output in self.outputs)

    @property
    def losses(self) -> int:
        """Returns how often a device was lost since the start."""
        return sum(thread.losses for thread in self.threads)

    @property
    def losses_by_role(self) -> dict[str, int]:
        """Returns the losses of the scanner, of the tracker, and of all outputs together."""
        losses = Counter[str]()
        for thread in self.threads:
            losses[thread.role] += thread.losses
        return dict(losses)

    @property
    def lost(self) -> dict[str, str]:
        """Returns what is wrong with each device that is lost now."""
        return {f"{one.role} {one.url}": one.lost for one in self.threads if one.lost is not None}
