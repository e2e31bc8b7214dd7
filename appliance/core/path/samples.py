"""The path of the picture with the poses around it, and what every solution on it has in common."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.path.blocks import Blocks
from probewatch.appliance.core.path.steps import SensorSteps
from probewatch.drivers.rigid import Array

_LEAST_CHAIN = 4
_LEAST_PICTURES = 8
"""Pictures of one chain, and of all that count. Each chain spends one picture on an offset of its own; with fewer than
X has parameters nothing but the prior would answer.
"""


@dataclass(frozen=True, eq=False)
class PathSamples:
    """n pictures of one or more chains, in time order.

    t_s: (n,). chain: (n,) int. u_px: (n, 2), alpha_rad: (n,) path within the chain. poses: (n, 4, 4) sensor → tracker
    at t_s + latency; earlier_poses, later_poses: the same, half of `apart_s` before and after, for the derivative by
    latency. apart_s spans several pose periods, or tracker noise would drown the velocity. origin_ns: stamp that t_s
    counts from. rigid: whether the motion shows that the tissue does not give way, whose path it then is. clear_share:
    of the pictures, in which tissue is seen, mean. hides: share by which rigid tissue may follow a press.
    """

    t_s: Array
    chain: NDArray[np.int64]
    u_px: Array
    alpha_rad: Array
    poses: Array
    earlier_poses: Array
    later_poses: Array
    apart_s: float
    origin_ns: int = 0
    rigid: bool = False
    clear_share: float = 1.0
    hides: float = 0.0

    @cached_property
    def made(self) -> dict[tuple[object, ...], Any]:
        """What was made of these samples alone, for who asks again; each maker begins its keys with itself."""
        return {}

    @cached_property
    def kept(self) -> NDArray[np.bool_]:
        """(n,) in a chain long enough to show anything. Raises ValueError where too few are."""
        _, index, count = np.unique(self.chain, return_inverse=True, return_counts=True)
        kept = np.asarray(count[index] >= _LEAST_CHAIN)
        if kept.sum() < _LEAST_PICTURES:
            raise ValueError(
                f"{int(kept.sum())} registered pictures are too few to solve; {_LEAST_PICTURES} are needed"
            )
        return kept

    def stamp_ns(self, t_s: float) -> int:
        """Stamp of a time of t_s."""
        return self.origin_ns + round(t_s * 1e9)

    @cached_property
    def moved_ns(self) -> int:
        """Stamp at and after which half of the picture's way along each axis was gone, the older of the two."""
        later = np.flatnonzero(self.continues)
        u_px = self.u_px[self.kept]
        way = np.square(u_px[later] - u_px[later - 1]).cumsum(axis=0)
        half = min(int(np.searchsorted(along, along[-1] / 2)) for along in way.T)
        return self.stamp_ns(float(self.t_s[self.kept][later[half]]))

    @cached_property
    def continues(self) -> NDArray[np.bool_]:
        """Whether the picture before each kept one is of the same chain."""
        chain = self.chain[self.kept]
        return np.asarray(np.diff(chain, prepend=chain[0] - 1) == 0)

    @cached_property
    def period_s(self) -> float:
        """Usual time between two kept pictures."""
        return max(float(np.median(np.diff(self.t_s[self.kept]))), 1e-3)

    @cached_property
    def blocks(self) -> Blocks:
        """Blocks of the kept pictures."""
        return Blocks.of(self.t_s[self.kept], self.chain[self.kept])

    @cached_property
    def steps(self) -> SensorSteps:
        return SensorSteps.between(self.poses[self.kept])

    @cached_property
    def rates(self) -> SensorSteps:
        """Derivative of the steps by latency, per s."""
        around = (SensorSteps.between(poses[self.kept]) for poses in (self.earlier_poses, self.later_poses))
        return next(around).rate_until(next(around), self.apart_s)
