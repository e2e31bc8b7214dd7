"""Holds the path of the picture with the poses around it, and what every solution on it has in common."""

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
"""Least number of pictures of one chain, and of all that count. Each chain spends one picture on an offset of its own;
with fewer than X has parameters, nothing but the prior would answer.
"""


@dataclass(frozen=True, eq=False)
class PathSamples:
    """Holds n pictures of one or more chains, in time order.

    t_s: (n,). chain: (n,) int. u_px: (n, 2), alpha_rad: (n,) path within the chain. poses: (n, 4, 4) sensor → tracker
    at t_s + latency; earlier_poses, later_poses: the same, half of `apart_s` before and after, for the derivative by
    latency. apart_s spans several pose periods, or tracker noise would drown the velocity. origin_ns: stamp from which
    t_s counts. rigid: whether the motion shows that the tissue does not give way; the path is then that of such tissue.
    clear_share: share of the pictures in which tissue is seen, their mean. hides: share by which rigid tissue may
    follow a press.
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
        """Returns the cache of what was made of these samples alone; each maker begins its keys with itself."""
        return {}

    @cached_property
    def kept(self) -> NDArray[np.bool_]:
        """Returns whether each picture is in a chain long enough to show anything, (n,). Raises ValueError where too
        few are.
        """
        _, index, count = np.unique(self.chain, return_inverse=True, return_counts=True)
        kept = np.asarray(count[index] >= _LEAST_CHAIN)
        if kept.sum() < _LEAST_PICTURES:
            raise ValueError(
                f"{int(kept.sum())} registered pictures are too few to solve; {_LEAST_PICTURES} are needed"
            )
        return kept

    def stamp_ns(self, t_s: float) -> int:
        """Returns the stamp, ns, of a time on the scale of t_s."""
        return self.origin_ns + round(t_s * 1e9)

    @cached_property
    def moved_ns(self) -> int:
        """Returns the stamp, ns, on either side of which half of the picture's displacement along an axis lies; of the
        two axes', the older.
        """
        later = np.flatnonzero(self.continues)
        u_px = self.u_px[self.kept]
        way = np.square(u_px[later] - u_px[later - 1]).cumsum(axis=0)
        half = min(int(np.searchsorted(along, along[-1] / 2)) for along in way.T)
        return self.stamp_ns(float(self.t_s[self.kept][later[half]]))

    @cached_property
    def continues(self) -> NDArray[np.bool_]:
        """Returns whether the picture before each kept one is of the same chain."""
        chain = self.chain[self.kept]
        return np.asarray(np.diff(chain, prepend=chain[0] - 1) == 0)

    @cached_property
    def period_s(self) -> float:
        """Returns the usual time, s, between two kept pictures."""
        return max(float(np.median(np.diff(self.t_s[self.kept]))), 1e-3)

    @cached_property
    def blocks(self) -> Blocks:
        """Returns the blocks of the kept pictures."""
        return Blocks.of(self.t_s[self.kept], self.chain[self.kept])

    @cached_property
    def steps(self) -> SensorSteps:
        return SensorSteps.between(self.poses[self.kept])

    @cached_property
    def rates(self) -> SensorSteps:
        """Returns the derivative of the steps by latency, per s."""
        around = (SensorSteps.between(poses[self.kept]) for poses in (self.earlier_poses, self.later_poses))
        return next(around).rate_until(next(around), self.apart_s)
