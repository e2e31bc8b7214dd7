"""Provides the simulated world as a source of pictures and a source of poses, without a protocol between."""

import math
from abc import ABC, abstractmethod
from math import ceil
from typing import Generic, TypeVar

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp
from probewatch.drivers.twins.scene.world import World
from probewatch.drivers.twins.tool_motion import PROBE, WITNESS, world_motion

_POSE_HZ = 60.0
"""Poses a second, as a Polaris Spectra measures them."""

_LONGEST_COST_S = 0.2
"""Seconds of the clock: cost of one sample at most, as in drivers.twins.scanner."""

_S = TypeVar("_S", Frame, Pose)


class _Paced(Closable, Generic[_S], ABC):
    """Numbers samples by time, so that one that was too late is a gap. Each is made ahead and handed out on time."""

    def __init__(self, world: World, clock: HostClock, rate_hz: float) -> None:
        self._world, self._clock, self._rate_hz = world, clock, rate_hz
        self._number = -1
        self._cost_s = 0.0
        self._made: _S | None = None

    def close(self) -> None:
        """Does nothing, because nothing is open."""

    @abstractmethod
    def _make(self, number: int, t_s: float, stamp: Stamp) -> _S:
        """Returns the sample of t_s, seconds of the world."""

    def read(self, timeout_s: float) -> _S | None:
        """Returns the next sample once its time has come, None when that is later than timeout_s of the clock."""
        end_ns = self._clock.now_ns() + round(timeout_s * 1e9)
        made = self._made = self._made or self._ahead()
        self._clock.sleep_until(min(made.stamp.t_ns, end_ns))
        if made.stamp.t_ns > end_ns:
            return None
        self._made = None
        return made

    def _ahead(self) -> _S:
        began_ns, origin_ns = self._clock.now_ns(), self._clock.origin_ns
        due_s = (began_ns - origin_ns) / 1e9 + self._cost_s
        self._number = max(self._number + 1, ceil(due_s * self._rate_hz))
        t_s = self._number / self._rate_hz
        made = self._make(self._number, t_s, Stamp(origin_ns + round(t_s * 1e9), 0))
        cost_s = min((self._clock.now_ns() - began_ns) / 1e9, _LONGEST_COST_S)
        self._cost_s += 0.2 * (cost_s - self._cost_s)
        return made


class WorldVideo(_Paced[Frame]):
    """Provides pictures of the world; see drivers.device_api.VideoSource."""

    def __init__(self, world: World, clock: HostClock) -> None:
        super().__init__(world, clock, world.settings.fps)

    def _make(self, number: int, t_s: float, stamp: Stamp) -> Frame:
        return Frame(stamp, number, self._world.frame(t_s, number))


class WorldTracker(_Paced[Pose]):
    """Provides poses of the world, with a second body on the probe; see drivers.device_api.TrackerSource."""

    def __init__(self, world: World, clock: HostClock) -> None:
        super().__init__(world, clock, _POSE_HZ)
        self._pose_at = world_motion(world)

    def _make(self, number: int, t_s: float, stamp: Stamp) -> Pose:
        probe, witness = self._pose_at(PROBE, t_s, number), self._pose_at(WITNESS, t_s, number)
        return Pose(stamp, number, probe, math.nan, PoseStatus.OK, witness=witness)
