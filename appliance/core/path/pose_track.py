"""Keeps the poses of the last seconds, and interpolates the tracker's path between them."""

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.times import MOST_APART_NS
from probewatch.drivers.rigid import Array, quaternion_from_rotation, rigid, rotation_from_quaternion
from probewatch.drivers.samples import Matrix4

_MOST_NEW = 1000
"""Number of new poses at which they are turned into arrays without being asked for; otherwise that waits for a
request.
"""
_NEIGHBOURS = 3.5
"""Distance, in times from one pose to the next, up to which the next but one counts for a slope: in a gap of more than
one lost pose a straight line is as good. Not varied.
"""
_HURRIES = np.array([10_000.0] * 3 + [50.0] * 4)
"""Accelerations that no hand reaches: mm/s² of each axis, and 1/s² of a quaternion, half of 100 rad/s². A greater one
is an outlier or a slip, which a curve would spread to the readings beside it: one pose that was off led to a lag of
−329 ms. The press of the gesture has 280 mm/s², noise of .1 mm at 60 Hz three times that. Not varied.
"""
_NO_TRACK = np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 4))
"""Times, positions and quaternions of no pose."""


def _steady(times_s: Array, places: Array) -> NDArray[np.bool_]:
    """Returns whether a hand may have moved from the pose before to the one after each, (n,); False at the ends.
    places: (n, 7).
    """
    steady = np.zeros(times_s.size, dtype=bool)
    apart_s = np.diff(times_s)
    speeds = np.diff(places, axis=0) / apart_s[:, None]
    gained = np.abs(np.diff(speeds, axis=0)) / np.minimum(apart_s[1:], apart_s[:-1])[:, None]
    steady[1:-1] = (gained < _HURRIES).all(axis=1)
    return steady


def _cubic(times_s: Array, steady: NDArray[np.bool_], after: NDArray[np.intp], share: Array) -> Array:
    """Returns the weights, (4, …), of the poses after − 2 to after + 1 at a share of the step from after − 1 to after.
    The slope at a pose is that between its neighbours; where no neighbour is near, or the motion is not steady, it is
    that of the straight line.
    """
    length = np.take(times_s, after) - np.take(times_s, after - 1)
    rise, fall = share * (1 - share) ** 2, share**2 * (1 - share)
    before_s = np.take(times_s, after) - np.take(times_s, np.maximum(after - 2, 0))
    beyond_s = np.take(times_s, np.minimum(after + 1, times_s.size - 1)) - np.take(times_s, after - 1)
    near = _NEIGHBOURS * length
    early = np.where(np.take(steady, after - 1) & (before_s < near), rise * length / before_s, 0.0)
    late = np.where(np.take(steady, after) & (beyond_s < near), fall * length / beyond_s, 0.0)
    whole_rise, whole_fall = np.where(early > 0, 0.0, rise), np.where(late > 0, 0.0, fall)
    step = share**2 * (3 - 2 * share)
    return np.stack([-early, 1 - step + late - whole_rise + whole_fall, step + early + whole_rise - whole_fall, -late])


class PoseTrack:
    """Keeps the poses of the last `span_ns`, and interpolates between the two that bracket a time."""

    def __init__(self, span_ns: int) -> None:
        self._span_ns = span_ns
        self._new: list[tuple[int, Matrix4]] = []
        self._times_ns, self._positions, self._turns = _NO_TRACK

    def add(self, t_ns: int, matrix: Matrix4) -> None:
        """Takes the next pose, in time order."""
        self._new.append((t_ns, matrix))
        if len(self._new) >= _MOST_NEW:
            self._take_new()

    def clear(self) -> None:
        """Discards all poses."""
        self._new.clear()
        self._times_ns, self._positions, self._turns = _NO_TRACK

    def forget(self, since_ns: int) -> None:
        """Discards the poses at or after since_ns, which were stamped wrongly."""
        self._take_new()
        kept = slice(None, np.searchsorted(self._times_ns, since_ns))
        self._times_ns, self._positions, self._turns = self._times_ns[kept], self._positions[kept], self._turns[kept]

    def arrays(self, origin_ns: int) -> tuple[Array, Array, Array]:
        """Returns times (m,), s since origin_ns, positions (m, 3), mm, and quaternions (m, 4) of continuous sign."""
        self._take_new()
        return (self._times_ns - origin_ns) / 1e9, self._positions, self._turns

    def at(self, t_s: Array, origin_ns: int) -> tuple[Array, NDArray[np.bool_]]:
        """Returns the poses (…, n, 4, 4) at t_s (…, n), and whether each time is bracketed. The steps are small, so
        quaternions are blended as numbers.

        A cubic (Catmull–Rom) goes through the poses: a straight line cuts the top off a motion to and fro, and a press
        that takes .65 s lost .3 % of its displacement between poses at 60 Hz, three quarters of a percent at 40 Hz.
        """
        times, positions, turns = self.arrays(origin_ns)
        if times.size < 2:
            return np.broadcast_to(np.eye(4), (*t_s.shape, 4, 4)), np.zeros(t_s.shape, dtype=bool)
        after = np.clip(np.searchsorted(times, t_s, side="right"), 1, times.size - 1)
        start_s, end_s = np.take(times, after - 1), np.take(times, after)
        share = np.clip((t_s - start_s) / (end_s - start_s), 0, 1)
        places = np.hstack([positions, turns])
        weights = _cubic(times, _steady(times, places), after, share)
        around = np.clip(after + np.arange(-2, 2).reshape(4, *[1] * t_s.ndim), 0, times.size - 1)
        p, q = np.split(np.einsum("k...,k...i->...i", weights, np.take(places, around, axis=0)), [3], axis=-1)
        q /= np.linalg.norm(q, axis=-1, keepdims=True)
        bracketed = (t_s >= times[0]) & (t_s <= times[-1]) & (end_s - start_s < MOST_APART_NS / 1e9)
        return rigid(rotation_from_quaternion(q), p), bracketed

    def as_now(self) -> "PoseTrack":
        """Returns a track of the poses so far, which does not change when poses are added or discarded here."""
        self._take_new()
        track = PoseTrack(self._span_ns)
        track._times_ns, track._positions, track._turns = self._times_ns, self._positions, self._turns
        return track

    def _take_new(self) -> None:
        if not self._new:
            return
        times = np.array([t for t, _ in self._new], dtype=np.int64)
        matrices = np.array([matrix for _, matrix in self._new])
        self._new.clear()
        turns = np.concatenate([self._turns, quaternion_from_rotation(matrices[:, :3, :3])])
        # A quaternion and its negative are one rotation: the sign nearer to the one before keeps the track continuous.
        known = max(len(self._turns), 1)
        opposed = np.sum(turns[known:] * turns[known - 1 : -1], axis=1) < 0
        turns[known:] *= np.cumprod(np.where(opposed, -1.0, 1.0))[:, None]
        times = np.concatenate([self._times_ns, times])
        kept = slice(np.searchsorted(times, times[-1] - self._span_ns), None)
        positions = np.concatenate([self._positions, matrices[:, :3, 3]])
        self._times_ns, self._positions, self._turns = times[kept], positions[kept], turns[kept]
