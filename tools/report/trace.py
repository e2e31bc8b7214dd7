"""Gathers what a page shows of a recording while the recording goes through the line."""

from bisect import bisect
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from probewatch.appliance.core.line import Line
from probewatch.appliance.core.registration.pyramid import Bits
from probewatch.appliance.types import Calibration, Motion, Verdict, VerdictKind
from probewatch.drivers.rigid import Array, interpolate, inverse, rigid
from probewatch.drivers.samples import GreyImage, Matrix4, Pose, Sample

_EVERY_NS = 100_000_000
"""Nanoseconds between two points of a curve: a quarter of an hour has 9000, of which a plot shows 900."""
_POSES_KEPT = 512
"""Poses among which that of a picture is looked for: some seconds at 60 Hz, more than a picture waits for its pose."""


@dataclass
class Curve:
    """Holds one check: value and sigma at times, s; limit and unit as last reported."""

    t_s: list[float] = field(default_factory=list)
    value: list[float] = field(default_factory=list)
    sigma: list[float] = field(default_factory=list)
    shown: list[bool] = field(default_factory=list)
    limit: float = 1.0
    unit: str = ""


@dataclass
class Paths:
    """Holds the way of the tissue through the picture, mm, by the picture and by tracker and reference, at times, s;
    NaN separates chains. Columns: lateral, axial.
    """

    t_s: list[float] = field(default_factory=list)
    picture: list[tuple[float, float]] = field(default_factory=list)
    tracker: list[tuple[float, float]] = field(default_factory=list)


class Trace:
    """Follows a recording: call it with each sample; it observes and changes nothing.

    first: the first picture whose overlay is known, with the mask and how the tissue moved since the keyframe, px.
    """

    def __init__(self) -> None:
        self._start_ns: int | None = None
        self._noted_ns: int | None = None
        self._poses: list[tuple[int, Matrix4]] = []
        self._frames: dict[int, GreyImage] = {}
        self._motion: Motion | None = None
        self._before: tuple[Motion, Matrix4] | None = None
        self._at = np.zeros(2)
        self.curves: dict[str, Curve] = defaultdict(Curve)
        self.verdicts: list[tuple[float, VerdictKind]] = []
        self.paths = Paths()
        self.first: tuple[GreyImage, Bits, Array] | None = None
        self.duration_s = 0.0

    def __call__(self, sample: Sample, verdicts: tuple[Verdict, ...], line: Line) -> None:
        if self._start_ns is None:
            self._start_ns = sample.stamp.t_ns
        self.duration_s = max(self.duration_s, self._seconds(sample.stamp.t_ns))
        if isinstance(sample, Pose):
            self._take_pose(sample)
        elif self.first is None:
            self._frames = {**dict(list(self._frames.items())[-16:]), sample.sequence: sample.image}
        for verdict in verdicts:
            self._note(verdict)
        if line.motion is not None and line.motion is not self._motion:
            self._motion = line.motion
            self._follow(line.motion, line.reference)
            self._show_first(line.motion, line.mask)

    def _seconds(self, t_ns: int) -> float:
        assert self._start_ns is not None
        return (t_ns - self._start_ns) / 1e9

    def _take_pose(self, pose: Pose) -> None:
        if pose.matrix is not None and (not self._poses or pose.stamp.t_ns > self._poses[-1][0]):
            self._poses.append((pose.stamp.t_ns, pose.matrix))
            del self._poses[:-_POSES_KEPT]

    def _note(self, verdict: Verdict) -> None:
        t_s = self._seconds(verdict.t_ns)
        self.verdicts.append((t_s, verdict.kind))
        if self._noted_ns is not None and 0 <= verdict.t_ns - self._noted_ns < _EVERY_NS:
            return
        self._noted_ns = verdict.t_ns
        for check in verdict.checks:
            curve = self.curves[check.name]
            curve.t_s.append(t_s)
            curve.value.append(check.value)
            curve.sigma.append(check.sigma)
            curve.shown.append(check.verdict is VerdictKind.OK and np.isfinite(check.value))
            curve.limit, curve.unit = check.limit, check.unit

    def _pose_at(self, t_ns: int) -> Matrix4 | None:
        place = bisect(self._poses, t_ns, key=lambda pose: pose[0])
        if place and self._poses[place - 1][0] == t_ns:
            return self._poses[place - 1][1]
        if not 0 < place < len(self._poses):
            return None
        (before_ns, before), (after_ns, after) = self._poses[place - 1], self._poses[place]
        return interpolate(before, after, (t_ns - before_ns) / (after_ns - before_ns))

    def _follow(self, motion: Motion, reference: Calibration) -> None:
        """Adds a point to the paths. The tracker's steps are put together as the picture's are, each in the plane of
        its own picture.
        """
        pose = self._pose_at(motion.stamp.t_ns)
        if pose is None:
            return
        scale = reference.scale_mm_per_px * reference.polarity
        if self._before is None or self._before[0].chain != motion.chain:
            self._at = motion.path_px * scale
            self._add(motion, (np.nan, np.nan), (np.nan, np.nan))
        else:
            X = rigid(reference.rotation, reference.offset_mm)
            A = X @ inverse(pose) @ self._before[1] @ inverse(X)
            turn = float(np.arctan2(A[1, 0] - A[0, 1], A[0, 0] + A[1, 1]))
            cos, sin = np.cos(turn), np.sin(turn)
            self._at = np.array([[cos, -sin], [sin, cos]]) @ self._at + A[:2, 3]
        picture = motion.path_px * scale
        self._add(motion, (float(picture[0]), float(picture[1])), (float(self._at[0]), float(self._at[1])))
        self._before = motion, pose

    def _add(self, motion: Motion, picture: tuple[float, float], tracker: tuple[float, float]) -> None:
        self.paths.t_s.append(self._seconds(motion.stamp.t_ns))
        self.paths.picture.append(picture)
        self.paths.tracker.append(tracker)

    def _show_first(self, motion: Motion, mask: Bits | None) -> None:
        image = self._frames.get(motion.sequence)
        if self.first is None and mask is not None and image is not None and image.shape == mask.shape:
            self.first = image, mask, motion.u_px
            self._frames = {}
