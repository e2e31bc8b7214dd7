"""Follows the way of the tissue through the picture, by the picture and by the tracker, and compares both."""

from bisect import bisect
from dataclasses import dataclass, field

import numpy as np

from probewatch.appliance.core.line import Line
from probewatch.appliance.types import Calibration, Motion
from probewatch.drivers.rigid import interpolate, inverse, rigid
from probewatch.drivers.samples import Matrix4, Pose, Sample

_POSES_KEPT = 512
"""Poses among which that of a picture is looked for: some seconds at 60 Hz, more than a picture waits for its pose."""
_STEP_S = 0.3
"""Length, s, of the steps of the paths that are compared: a third of a turn of the hand. Longer ones hold less motion
that a late tracker does not hide, shorter ones more noise.
"""
_LEAST_MM = 30.0
"""Length, mm, of all steps of the picture's path from which on it is compared: less is noise of a probe at rest."""
_ALIKE = 0.7
"""Least correlation of both paths' steps. Less takes breathing below a resting probe for motion of the probe; more
misses rocking, whose lever is in mm whatever the poses are in.
"""
_TENFOLD = (7.0, 14.0)
"""Bounds of the ratio of both paths that is taken for a factor of 10: tissue follows a probe by a third at most."""


@dataclass
class Paths:
    """Holds the way of the tissue through the picture, mm, by the picture and by tracker and reference, at times, s;
    NaN separates chains. Columns: lateral, axial. lever: the part of the tracker's that turns of the marker body and
    its offset from the picture make, whatever unit the poses are in.
    """

    t_s: list[float] = field(default_factory=list)
    picture: list[tuple[float, float]] = field(default_factory=list)
    tracker: list[tuple[float, float]] = field(default_factory=list)
    lever: list[tuple[float, float]] = field(default_factory=list)


class PathsFollowed:
    """Follows both paths: give it each pose, and each motion once."""

    def __init__(self) -> None:
        self.paths = Paths()
        self._poses: list[tuple[int, Matrix4]] = []
        self._before: tuple[Motion, Matrix4] | None = None
        self._motion: Motion | None = None
        self._at = self._lever = np.zeros(2)

    def step(self, sample: Sample, line: Line, start_ns: int) -> None:
        """Takes a sample that the line has just taken."""
        if isinstance(sample, Pose):
            self.take(sample)
        if line.motion is not None and line.motion is not self._motion:
            self._motion = line.motion
            self.follow(line.motion, line.reference, (line.motion.stamp.t_ns - start_ns) / 1e9)

    def take(self, pose: Pose) -> None:
        if pose.matrix is not None and (not self._poses or pose.stamp.t_ns > self._poses[-1][0]):
            self._poses.append((pose.stamp.t_ns, pose.matrix))
            del self._poses[:-_POSES_KEPT]

    def _pose_at(self, t_ns: int) -> Matrix4 | None:
        place = bisect(self._poses, t_ns, key=lambda pose: pose[0])
        if place and self._poses[place - 1][0] == t_ns:
            return self._poses[place - 1][1]
        if not 0 < place < len(self._poses):
            return None
        (before_ns, before), (after_ns, after) = self._poses[place - 1], self._poses[place]
        return interpolate(before, after, (t_ns - before_ns) / (after_ns - before_ns))

    def follow(self, motion: Motion, reference: Calibration, t_s: float) -> None:
        """Adds a point to the paths. The tracker's steps are put together as the picture's are, each in the plane of
        its own picture.
        """
        pose = self._pose_at(motion.stamp.t_ns)
        if pose is None:
            return
        scale = reference.scale_mm_per_px * reference.polarity
        if self._before is None or self._before[0].chain != motion.chain:
            self._at = self._lever = motion.path_px * scale
            self._add(t_s, (np.nan, np.nan), (np.nan, np.nan))
        else:
            X = rigid(reference.rotation, reference.offset_mm)
            step = inverse(pose) @ self._before[1]
            A, turned = X @ step @ inverse(X), X @ rigid(step[:3, :3], np.zeros(3)) @ inverse(X)
            turn = float(np.arctan2(A[1, 0] - A[0, 1], A[0, 0] + A[1, 1]))
            cos, sin = np.cos(turn), np.sin(turn)
            in_plane = np.array([[cos, -sin], [sin, cos]])
            self._at, self._lever = in_plane @ self._at + A[:2, 3], in_plane @ self._lever + turned[:2, 3]
        picture = motion.path_px * scale
        self._add(t_s, (float(picture[0]), float(picture[1])), (float(self._at[0]), float(self._at[1])))
        self._before = motion, pose

    def _add(self, t_s: float, picture: tuple[float, float], tracker: tuple[float, float]) -> None:
        self.paths.t_s.append(t_s)
        self.paths.picture.append(picture)
        self.paths.tracker.append(tracker)
        self.paths.lever.append((float(self._lever[0]), float(self._lever[1])))


def unit_asked(paths: Paths) -> str:
    """Returns the question whether the poses are in cm, where the picture moves ten times as far as they say; empty
    where it does not.
    """
    if not paths.t_s:
        return ""
    t_s, chains = np.array(paths.t_s), np.cumsum(np.isnan(np.array(paths.picture)[:, 0]))
    ends = np.minimum(np.searchsorted(t_s, t_s + _STEP_S), len(t_s) - 1)
    lever = np.array(paths.lever)
    places = np.array([paths.picture - lever, paths.tracker - lever])
    steps = places[:, ends] - places
    seen, told = steps[:, (chains[ends] == chains) & np.isfinite(steps).all(axis=(0, 2))]
    along, told_2, seen_2 = float(np.sum(seen * told)), float(np.sum(told**2)), float(np.sum(seen**2))
    length_mm = float(np.linalg.norm(seen, axis=1).sum()) * float(np.median(np.diff(t_s, append=t_s[-1]))) / _STEP_S
    if length_mm < _LEAST_MM or along < _ALIKE * np.sqrt(told_2 * seen_2) or along <= 0:
        return ""
    ratio = along / told_2
    asked = f"the picture moves {ratio:.0f} times as far as the poses say: are they in mm, or in cm?"
    return asked if _TENFOLD[0] <= ratio <= _TENFOLD[1] else ""
