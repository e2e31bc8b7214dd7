"""Holds the two paths of the last seconds side by side: the picture's along its keyframe chain, the sensor's from the
tracker.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.path.latency import Latency, estimate_latency, far_latency
from probewatch.appliance.core.path.pose_track import PoseTrack
from probewatch.appliance.core.path.samples import PathSamples
from probewatch.appliance.core.path.steps import predicted_path
from probewatch.appliance.core.path.tissue_compliance import TissueMotion, possible_tissue_motion
from probewatch.appliance.core.times import SWEEP_WINDOW_NS
from probewatch.appliance.types import DRAGS, PRESSES, Calibration, Motion
from probewatch.drivers.rigid import Array, ComplexArray, rigid, rotation_from_quaternion

_APART_S = 0.1
"""Time, s, between the poses from which the velocity is computed. With one shorter than some pose periods, tracker
noise drowns it; with a longer one, the turns of a hand are smoothed away.
"""
_BEFORE_S = 0.5
"""Time, s, before the first picture from which the search for the latency gets poses: more than the .38 s that it looks
back.
"""
_FAR_BEFORE_S = 1.5
"""The same for a whole recording, where the search looks back by 1.28 s."""
_SPARE_NS = 2_000_000_000
"""Time, ns, for which poses are kept longer than pictures: the latency search and the velocity reach beyond both ends
of the window.
"""


class PathWindow:
    """Holds the registered pictures of the last `span_ns` and the poses around them."""

    def __init__(self, reference: Calibration, span_ns: int = SWEEP_WINDOW_NS) -> None:
        self._reference = reference
        self._span_ns = span_ns
        self._seen: deque[Motion] = deque()
        self.poses = PoseTrack(span_ns + _SPARE_NS)
        self._arrays_known: tuple[Array, NDArray[np.int64], Array, Array] | None = None
        self._tissue = TissueMotion(DRAGS | PRESSES)
        self._samples_known: dict[float, PathSamples] = {}

    def __len__(self) -> int:
        return len(self._seen)

    def add(self, motion: Motion) -> None:
        """Takes one usable motion."""
        self._changed()
        self._seen.append(motion)
        while self._seen[0].stamp.t_ns < motion.stamp.t_ns - self._span_ns:
            self._seen.popleft()

    def restart(self) -> None:
        """Discards the pictures and keeps the poses, because another calibration applies from now on."""
        self._changed()
        self._seen.clear()

    def forget_tissue(self) -> None:
        """Assumes again that the tissue may follow a press and drag, because the probe may be on other tissue
        by now.
        """
        self._changed()
        self._tissue = TissueMotion(DRAGS | PRESSES)

    def forget(self, since_ns: int) -> None:
        """Discards motion at or after since_ns, which was stamped wrongly."""
        self._changed()
        while self._seen and self._seen[-1].stamp.t_ns >= since_ns:
            self._seen.pop()

    def _changed(self) -> None:
        self._arrays_known = None
        self._samples_known.clear()

    @property
    def now_ns(self) -> int:
        """Returns the time of the latest motion; 0 while there is none."""
        return self._seen[-1].stamp.t_ns if self._seen else 0

    @property
    def start_ns(self) -> int:
        """Returns the time of the first motion; 0 while there is none."""
        return self._seen[0].stamp.t_ns if self._seen else 0

    @property
    def span_ns(self) -> int:
        """Returns the time from the first motion to the latest."""
        return self._seen[-1].stamp.t_ns - self._seen[0].stamp.t_ns if self._seen else 0

    @property
    def stamps_err_s(self) -> float:
        """Returns the mean bound of the error of the stamps, s: what they may be wrong by together; 0 while there is no
        motion.
        """
        return float(np.mean([motion.stamp.err_ns for motion in self._seen])) / 1e9 if self._seen else 0.0

    def since(self, start_ns: int) -> "PathWindow":
        """Returns a window on what is not older than start_ns, which shares the poses."""
        window = PathWindow(self._reference, self._span_ns)
        window.poses, window._tissue = self.poses, self._tissue
        window._seen.extend(motion for motion in self._seen if motion.stamp.t_ns >= start_ns)
        return window

    def as_now(self) -> "PathWindow":
        """Returns a window on the pictures and poses so far, which does not change when any are added or discarded
        here.
        """
        window = self.since(self.start_ns)
        window.poses = self.poses.as_now()
        return window

    def latency(self, about_s: float = 0.0) -> Latency | None:
        """Returns the lag of the tracker from the two paths, near about_s; None where the motion does not show it."""
        paths = self._paths(about_s, _BEFORE_S)
        found = None if paths is None else estimate_latency(*paths)
        return None if found is None else Latency(found.value_s + about_s, found.sigma_s)

    def far_latency(self) -> Latency | None:
        """Returns the lag up to a second, positive or negative, from all motion that is kept; None also where two lags
        explain it.
        """
        paths = self._paths(0.0, _FAR_BEFORE_S)
        return None if paths is None else far_latency(*paths)

    def _paths(self, about_s: float, before_s: float) -> tuple[Array, NDArray[np.int64], Array, Array, Array] | None:
        """Returns the arguments of `estimate_latency` at a lag of about_s, with poses from before_s before the first
        picture.
        """
        if len(self._seen) < 2:
            return None
        t_s, chain, u_px, alpha = self._arrays()
        times, positions, turns = self.poses.arrays(self._seen[0].stamp.t_ns)
        times = times - about_s
        reach = slice(np.searchsorted(times, t_s[0] - before_s), None)
        if times[reach].size < 2:
            return None
        poses = rigid(rotation_from_quaternion(turns[reach]), positions[reach])
        path = self._picture_path(u_px, alpha)
        return t_s, chain, np.stack([path.real, path.imag]), times[reach], predicted_path(poses, self._reference)

    def picture_steps(self) -> tuple[Array, NDArray[np.int64], Array] | None:
        """Returns t_s (n,) and chain (n,) of the pictures, and their steps added up within each chain, (3, n): lateral
        and axial in the axes of the later picture, mm, and turn, rad. Returns None below two pictures.
        """
        if len(self._seen) < 2:
            return None
        t_s, chain, u_px, alpha = self._arrays()
        lateral, axial = self._reference.polarity
        path = (u_px * self._reference.scale_mm_per_px * self._reference.polarity) @ np.array([1, 1j])
        turn = np.diff(alpha, prepend=alpha[0]) * (lateral * axial)
        moved = path - np.exp(1j * turn) * np.concatenate([path[:1], path[:-1]])
        same = np.diff(chain, prepend=chain[0]) == 0
        way = np.cumsum(moved * same)
        return t_s, chain, np.stack([way.real, way.imag, np.cumsum(turn * same)])

    def samples(self, latency_s: float) -> PathSamples:
        """Returns the pictures whose poses are bracketed at the given latency."""
        if not self._seen:
            return _NOTHING
        if latency_s not in self._samples_known:
            self._samples_known[latency_s] = self._samples(latency_s)
        return self._samples_known[latency_s]

    def _samples(self, latency_s: float) -> PathSamples:
        t_s, chain, u_px, alpha = self._arrays()
        asked_s = t_s + latency_s + np.array([[0.0], [-_APART_S / 2], [_APART_S / 2]])
        around, known = self.poses.at(asked_s, self._seen[0].stamp.t_ns)
        keep = known.all(axis=0)
        poses, earlier, later = around[:, keep]
        seen = t_s[keep], chain[keep], u_px[keep], alpha[keep]
        clear = float(np.mean([motion.tissue.clear_share for motion in self._seen if motion.tissue] or [1.0]))
        origin_ns, rigid_tissue = self._seen[0].stamp.t_ns, not self.tissue & PRESSES
        hides = self._tissue.hides
        return PathSamples(*seen, poses, earlier, later, _APART_S, origin_ns, rigid_tissue, clear, hides)

    @property
    def tissue(self) -> int:
        """Returns DRAGS and PRESSES, unless motion had excluded them when `look_at_tissue` was last called; 0 is rigid
        tissue, also where the latest motion has no path of tissue.
        """
        return 0 if self._seen and self._seen[-1].tissue is None else self._tissue.may

    @property
    def registered_as(self) -> int:
        """Returns the bits that registration allows: those of `tissue`, and PRESSES while rigid tissue may hide a
        share. Tissue that follows by .05 shows .01 of it if registered as rigid, and .04 if it may follow.
        """
        return self.tissue | PRESSES * (self._tissue.surely > 0)

    def look_at_tissue(self, lag_s: float, scale_limit: float) -> int:
        """Judges the tissue by all of the window and returns `tissue`. lag_s: that of the tracker. scale_limit:
        relative, as for `possible_tissue_motion`.
        """
        if self._seen and self._seen[-1].tissue is not None:
            self._changed()
            origin_ns = self._seen[0].stamp.t_ns
            t_s = np.array([(s.stamp.t_ns - origin_ns) / 1e9 for s in self._seen]) + lag_s
            poses, known = self.poses.at(t_s, origin_ns)
            known &= np.array([motion.tissue is not None for motion in self._seen])
            seen = [motion for motion, there in zip(self._seen, known, strict=True) if there]
            before = self._tissue
            found = possible_tissue_motion(before.may, seen, poses[known], self._reference, scale_limit)
            self._tissue = found.after(before)
        return self.tissue

    def take_tissue(self, other: "PathWindow") -> None:
        """Takes over what another window has computed about the tissue from the same motion."""
        self._changed()
        self._tissue = other._tissue

    def _arrays(self) -> tuple[Array, NDArray[np.int64], Array, Array]:
        if self._arrays_known is None:
            origin_ns, tissue = self._seen[0].stamp.t_ns, self.tissue
            t_s = np.array([(s.stamp.t_ns - origin_ns) / 1e9 for s in self._seen])
            chain = np.array([s.chain for s in self._seen], dtype=np.int64)
            path = [
                (s.path_px, s.path_rad) if s.tissue is None else (s.tissue.path_px[tissue], s.tissue.path_rad[tissue])
                for s in self._seen
            ]
            u_px, alpha_rad = np.array([u for u, _ in path]), np.array([alpha for _, alpha in path])
            self._arrays_known = t_s, chain, u_px, alpha_rad
        return self._arrays_known

    def _picture_path(self, u_px: Array, alpha: Array) -> ComplexArray:
        """Returns the image centre in the axes of the chain's first picture, (n,) mm, lateral + i · axial:
        −R(−α) Λ u.
        """
        lateral, axial = (u_px * self._reference.scale_mm_per_px).T
        return np.asarray(-np.exp(-1j * alpha) * (lateral + 1j * axial))


_NO_POSES = np.zeros((0, 4, 4))  # a (4, 4) matrix for each of no times
_NOTHING = PathSamples(
    t_s=np.zeros(0),
    chain=np.zeros(0, dtype=np.int64),
    u_px=np.zeros((0, 2)),
    alpha_rad=np.zeros(0),
    poses=_NO_POSES,
    earlier_poses=_NO_POSES,
    later_poses=_NO_POSES,
    apart_s=_APART_S,
)
"""Samples without a picture."""
