"""Gathers what a page shows of a recording while the recording goes through the line."""

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from probewatch.appliance.core.line import Line
from probewatch.appliance.core.registration.pyramid import Bits
from probewatch.appliance.types import Motion, Verdict, VerdictKind
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import GreyImage, Pose, Sample
from probewatch.tools.shared.paths_followed import PathsFollowed

_EVERY_NS = 100_000_000
"""Nanoseconds between two points of a curve: a quarter of an hour has 9000, of which a plot shows 900."""


@dataclass
class Curve:
    """Holds one check: value and sigma at times, s; limit and unit as last reported."""

    t_s: list[float] = field(default_factory=list)
    value: list[float] = field(default_factory=list)
    sigma: list[float] = field(default_factory=list)
    shown: list[bool] = field(default_factory=list)
    limit: float = 1.0
    unit: str = ""


class Trace:
    """Follows a recording: call it with each sample; it observes and changes nothing.

    first: the first picture whose overlay is known, with the mask and how the tissue moved since the keyframe, px.
    """

    def __init__(self) -> None:
        self._start_ns: int | None = None
        self._noted_ns: int | None = None
        self._frames: dict[int, GreyImage] = {}
        self._motion: Motion | None = None
        self.curves: dict[str, Curve] = defaultdict(Curve)
        self.verdicts: list[tuple[float, VerdictKind]] = []
        self._followed = PathsFollowed()
        self.paths = self._followed.paths
        self.first: tuple[GreyImage, Bits, Array] | None = None
        self.duration_s = 0.0

    def __call__(self, sample: Sample, verdicts: tuple[Verdict, ...], line: Line) -> None:
        if self._start_ns is None:
            self._start_ns = sample.stamp.t_ns
        self.duration_s = max(self.duration_s, self._seconds(sample.stamp.t_ns))
        if isinstance(sample, Pose):
            self._followed.take(sample)
        elif self.first is None:
            self._frames = {**dict(list(self._frames.items())[-16:]), sample.sequence: sample.image}
        for verdict in verdicts:
            self._note(verdict)
        if line.motion is not None and line.motion is not self._motion:
            self._motion = line.motion
            self._followed.follow(line.motion, line.reference, self._seconds(line.motion.stamp.t_ns))
            self._show_first(line.motion, line.mask)

    def _seconds(self, t_ns: int) -> float:
        assert self._start_ns is not None
        return (t_ns - self._start_ns) / 1e9

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

    def _show_first(self, motion: Motion, mask: Bits | None) -> None:
        image = self._frames.get(motion.sequence)
        if self.first is None and mask is not None and image is not None and image.shape == mask.shape:
            self.first = image, mask, motion.u_px
            self._frames = {}
