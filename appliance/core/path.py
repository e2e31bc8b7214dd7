"""The two paths of the last seconds side by side: the picture's along its keyframe chain, the sensor's from the
tracker.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from appliance.core.geometry import Array, inverse, quaternion_from_rotation, rigid
from appliance.core.latency import Latency, estimate_latency
from appliance.core.path_samples import PathSamples
from appliance.core.picture_steps import predicted_path
from appliance.types import Calibration, Motion
from drivers.samples import Matrix4

_APART_S = 0.1
_BEFORE_S = 0.5
_SORT_S = 0.3
_OUT_RATIO = 1.5
_OUT_FLOOR_MM = 0.3


class PoseTrack:
    """Poses of the last `span_ns`, interpolated between the two that bracket a time."""

    def __init__(self, span_ns: int) -> None:
        self._span_ns = span_ns
        self._poses: deque[tuple[int, Matrix4, Array]] = deque()
        self._arrays: tuple[Array, Array, Array] | None = None
        self._origin_ns = 0

    def add(self, t_ns: int, matrix: Matrix4) -> None:
        """Poses older than the newest one are ignored."""
        if self._poses and t_ns <= self._poses[-1][0]:
            return
        q = quaternion_from_rotation(matrix[:3, :3])
        if self._poses and q @ self._poses[-1][2] < 0:
            q = -q
        self._poses.append((t_ns, matrix, q))
        self._arrays = None
        while self._poses[0][0] < t_ns - self._span_ns:
            self._poses.popleft()

    def clear(self) -> None:
        """Forget everything."""
        self._poses.clear()
        self._arrays = None

    def arrays(self, origin_ns: int) -> tuple[Array, Array, Array]:
        """Times s since origin_ns (m,), positions mm (m, 3), quaternions (m, 4) of continuous sign."""
        if self._arrays is None or self._origin_ns != origin_ns:
            times = np.array([(t - origin_ns) / 1e9 for t, _, _ in self._poses])
            positions = np.array([m[:3, 3] for _, m, _ in self._poses]).reshape(-1, 3)
            turns = np.array([q for _, _, q in self._poses]).reshape(-1, 4)
            self._arrays, self._origin_ns = (times, positions, turns), origin_ns
        return self._arrays

    def at(self, t_s: Array, origin_ns: int) -> tuple[Array, NDArray[np.bool_]]:
        """(n,) s → (n, 4, 4) poses and whether each time is bracketed; small steps, so quaternions blend linearly."""
        times, positions, turns = self.arrays(origin_ns)
        if times.size < 2:
            return np.tile(np.eye(4), (t_s.size, 1, 1)), np.zeros(t_s.size, dtype=bool)
        after = np.clip(np.searchsorted(times, t_s, side="right"), 1, times.size - 1)
        span = times[after] - times[after - 1]
        share = np.clip((t_s - times[after - 1]) / span, 0, 1)[:, None]
        q = (1 - share) * turns[after - 1] + share * turns[after]
        q /= np.linalg.norm(q, axis=1, keepdims=True)
        p = (1 - share) * positions[after - 1] + share * positions[after]
        bracketed = (t_s >= times[0]) & (t_s <= times[-1]) & (span < 0.25)
        return rigid(_rotation_from_quaternion(q), p), bracketed


class PathWindow:
    """Registered pictures of the last `span_ns` and the poses around them."""

    def __init__(self, reference: Calibration, span_ns: int = 30_000_000_000) -> None:
        self._reference = reference
        self._span_ns = span_ns
        self._seen: deque[Motion] = deque()
        self.poses = PoseTrack(span_ns + 2_000_000_000)
        self._arrays_known: tuple[Array, NDArray[np.int64], Array, Array] | None = None
        self._samples_known: dict[tuple[float, bool], PathSamples] = {}

    def __len__(self) -> int:
        return len(self._seen)

    def add(self, motion: Motion) -> None:
        """Take one usable motion."""
        self._changed()
        self._seen.append(motion)
        while self._seen[0].stamp.t_ns < motion.stamp.t_ns - self._span_ns:
            self._seen.popleft()

    def restart(self) -> None:
        """What comes next obeys another calibration: forget the pictures, keep the poses."""
        self._changed()
        self._seen.clear()

    def _changed(self) -> None:
        self._arrays_known = None
        self._samples_known.clear()

    @property
    def now_ns(self) -> int:
        """Time of the latest motion; 0 while there is none."""
        return self._seen[-1].stamp.t_ns if self._seen else 0

    @property
    def span_ns(self) -> int:
        """From the first motion to the latest."""
        return self._seen[-1].stamp.t_ns - self._seen[0].stamp.t_ns if self._seen else 0

    @property
    def stamps_err_s(self) -> float:
        """Mean bound of the error of the stamps: what they may be wrong by together; 0 while there is no motion."""
        return float(np.mean([motion.stamp.err_ns for motion in self._seen])) / 1e9 if self._seen else 0.0

    def since(self, start_ns: int) -> "PathWindow":
        """A window on what is not older than start_ns, sharing the poses."""
        window = PathWindow(self._reference, self._span_ns)
        window.poses = self.poses
        window._seen.extend(motion for motion in self._seen if motion.stamp.t_ns >= start_ns)
        return window

    def latency(self) -> Latency | None:
        """Lag of the tracker from the two paths; None where the motion does not show it."""
        if len(self._seen) < 2:
            return None
        t_s, chain, u_px, alpha = self._arrays()
        times, positions, turns = self.poses.arrays(self._seen[0].stamp.t_ns)
        reach = times >= t_s[0] - _BEFORE_S
        if np.count_nonzero(reach) < 2:
            return None
        poses = rigid(_rotation_from_quaternion(turns[reach]), positions[reach])
        sensor_path = predicted_path(poses, self._reference)
        return estimate_latency(t_s, chain, self._picture_path(u_px, alpha), times[reach], sensor_path)

    def samples(self, latency_s: float, weigh_hidden: bool) -> PathSamples:
        """The pictures whose poses are bracketed at the given latency.

        weigh_hidden: where the probe moved mostly out of the picture plane, what the picture did counts less.
        """
        if not self._seen:
            return _NOTHING
        asked = (latency_s, weigh_hidden)
        if asked not in self._samples_known:
            self._samples_known[asked] = self._samples(*asked)
        return self._samples_known[asked]

    def _samples(self, latency_s: float, weigh_hidden: bool) -> PathSamples:
        t_s, chain, u_px, alpha = self._arrays()
        origin_ns = self._seen[0].stamp.t_ns
        poses, known = self.poses.at(t_s + latency_s, origin_ns)
        earlier, known_earlier = self.poses.at(t_s + latency_s - _APART_S / 2, origin_ns)
        later, known_later = self.poses.at(t_s + latency_s + _APART_S / 2, origin_ns)
        keep = known & known_earlier & known_later
        hidden_mm = (
            self._hidden_mm(t_s, chain, u_px, alpha, poses) if weigh_hidden and keep.any() else np.zeros_like(t_s)
        )
        around = poses[keep], earlier[keep], later[keep]
        return PathSamples(t_s[keep], chain[keep], u_px[keep], alpha[keep], *around, _APART_S, hidden_mm[keep])

    def _arrays(self) -> tuple[Array, NDArray[np.int64], Array, Array]:
        if self._arrays_known is None:
            origin_ns = self._seen[0].stamp.t_ns
            t_s = np.array([(s.stamp.t_ns - origin_ns) / 1e9 for s in self._seen])
            chain = np.array([s.chain for s in self._seen], dtype=np.int64)
            u_px = np.array([s.path_px for s in self._seen])
            self._arrays_known = t_s, chain, u_px, np.array([s.path_rad for s in self._seen])
        return self._arrays_known

    def _picture_path(self, u_px: Array, alpha: Array) -> Array:
        """(n, 2) mm, image centre in the axes of the chain's first picture: −R(−α) Λ u."""
        mm = u_px * self._reference.scale_mm_per_px
        c, s = np.cos(alpha), np.sin(alpha)
        return -np.stack([c * mm[:, 0] + s * mm[:, 1], -s * mm[:, 0] + c * mm[:, 1]], axis=1)

    def _hidden_mm(self, t_s: Array, chain: NDArray[np.int64], u_px: Array, alpha: Array, poses: Array) -> Array:
        """(n,) way between each picture and the one before that is absent from the picture, 0 where most of it is seen.

        Only lengths are compared, so a wrong rotation of X cannot make in-plane motion look out-of-plane.
        """
        centre = -self._reference.rotation.T @ self._reference.offset_mm
        where = np.einsum("nij,j->ni", poses[:, :3, :3], centre) + poses[:, :3, 3]
        path = self._picture_path(u_px, alpha)
        first = np.searchsorted(t_s, t_s - _SORT_S / 2)
        last = np.minimum(np.searchsorted(t_s, t_s + _SORT_S / 2), t_s.size - 1)
        tracker = np.linalg.norm(where[last] - where[first], axis=1)
        picture = np.linalg.norm(path[last] - path[first], axis=1)
        hidden = np.sqrt(np.maximum(tracker**2 - picture**2, 0)) - _OUT_RATIO * picture - _OUT_FLOOR_MM
        share = np.diff(t_s, prepend=t_s[0]) / np.maximum(t_s[last] - t_s[first], 1e-3)
        return np.asarray(np.where(chain[first] == chain[last], np.maximum(hidden, 0) * share, 0.0))


_NO_POSES = np.zeros((0, 4, 4))
_NOTHING = PathSamples(
    t_s=np.zeros(0),
    chain=np.zeros(0, dtype=np.int64),
    u_px=np.zeros((0, 2)),
    alpha_rad=np.zeros(0),
    poses=_NO_POSES,
    earlier_poses=_NO_POSES,
    later_poses=_NO_POSES,
    apart_s=_APART_S,
    hidden_mm=np.zeros(0),
)


def _rotation_from_quaternion(q: Array) -> Array:
    """(n, 4) unit (w, x, y, z) → (n, 3, 3)."""
    w, x, y, z = q.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def sensor_jump(before: Matrix4, after: Matrix4) -> Matrix4:
    """(4, 4) D with after = before · D: how the marker body moved in its own axes."""
    return np.asarray(inverse(before) @ after)
