"""The simulated world as a source of pictures and a source of poses, without a protocol between."""

import math
from math import ceil
from types import TracebackType
from typing import Self

from drivers.clock.host_clock import HostClock
from drivers.samples import Frame, Pose, PoseStatus, Stamp
from drivers.twins.scene.world import World

_POSE_HZ = 60.0
"""As a Polaris Spectra."""


class _Paced:
    """Numbers by time, so that one that was too late is a gap."""

    def __init__(self, clock: HostClock, rate_hz: float) -> None:
        self._clock, self._rate_hz = clock, rate_hz
        self._number = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        """Nothing is open."""

    def _next(self, timeout_s: float) -> tuple[int, float, Stamp] | None:
        """(number, world seconds, stamp) of the next one once its time has come, None when that is later."""
        now_ns, origin_ns = self._clock.now_ns(), self._clock.origin_ns
        number = max(self._number + 1, ceil((now_ns - origin_ns) / 1e9 * self._rate_hz))
        t_ns = origin_ns + round(number / self._rate_hz * 1e9)
        end_ns = now_ns + round(timeout_s * 1e9)
        self._clock.sleep_until(min(t_ns, end_ns))
        if t_ns > end_ns:
            return None
        self._number = number
        return number, number / self._rate_hz, Stamp(t_ns, 0)


class WorldVideo(_Paced):
    """See drivers.device_api.VideoSource."""

    def __init__(self, world: World, clock: HostClock) -> None:
        super().__init__(clock, world.settings.fps)
        self._world = world

    def read(self, timeout_s: float) -> Frame | None:
        """Next picture, rendered when its time has come."""
        due = self._next(timeout_s)
        return None if due is None else Frame(due[2], due[0], self._world.frame(due[1], due[0]))


class WorldTracker(_Paced):
    """See drivers.device_api.TrackerSource."""

    def __init__(self, world: World, clock: HostClock) -> None:
        super().__init__(clock, _POSE_HZ)
        self._world = world

    def read(self, timeout_s: float) -> Pose | None:
        """Next pose."""
        due = self._next(timeout_s)
        if due is None:
            return None
        return Pose(due[2], due[0], self._world.measured_pose(due[1], due[0]), math.nan, PoseStatus.OK)
