"""Determines how late the tracker is, from a probe moved up and down over the bottom of a water tank. Pure.

The bottom is one bright line across the picture whose depth follows the probe. Its depth over time must be a linear map
of the probe's position, at the right lag; appliance.core.path.latency finds that lag, as it does for the path of
tissue. This is the published method of temporal calibration (Rousseau, Hellier, Barillot 2006; the PLUS toolkit) with a
sigma of its own.
"""

import numpy as np

from probewatch.appliance.core.path.latency import Latency, far_latency
from probewatch.appliance.types import Vector
from probewatch.drivers.samples import Frame, GreyImage, Pose

_BAND = 0.1
"""Share of the width, about the middle, whose columns are averaged: a line aslant by 10° blurs by only a few pixels."""
_BESIDE = 0.1
"""Share of the width, from the middle of the picture to the middle of the band on either side in which the line must
continue. More separates lines from spots better, less takes what a convex face shows of the bottom. In the real tank of
PLUS it continues in 87 % of the pictures with something bright, in PLUS's two N-wire phantoms in 2 and 0 %."""
_LEAST_SHARE = 0.5
"""Share of the pictures with something bright that moves in which it must be a line; half way between these figures."""
_SMOOTH_ROWS = 2.0
"""Sigma of the smoothing, px: speckle disappears, while the line of five to ten pixels stays."""
_HALF_LINE_PX = 12
"""Rows about the brightest that give the line's depth, and by which the line may bend between the bands. Not varied."""
_LEAST_GREY = 12.0
"""Grey levels by which the line must exceed its own usual profile. Less follows noise, more loses weak bottoms."""
_ROUGH_MM_PER_PX = 0.075
"""mm per pixel: it only gives the depth a sensible unit; the map to the probe's position finds the scale itself."""
_LEAST_PICTURES = 30
"""The least number of pictures: with fewer, the usual profile is that of the line itself."""

_LONGEST_S = 600.0
"""Time, s, from the first picture to the last, at most: forty times what is asked for. Stamps that jump by hours, as
from a clock that was set, show no lag, and the grid of times between them takes memory without end."""


class BottomLine:
    """Takes the frames and poses of the session in any order, and determines the latency from them."""

    def __init__(self) -> None:
        self._times_ns: list[int] = []
        self._profiles: list[Vector] = []
        self._pose_ns: list[int] = []
        self._places: list[Vector] = []

    def step(self, sample: Frame | Pose) -> None:
        """Takes the next sample; poses that are not OK are left out."""
        if isinstance(sample, Frame):
            self._times_ns.append(sample.stamp.t_ns)
            self._profiles.append(_profile(sample.image))
        elif sample.matrix is not None:
            self._pose_ns.append(sample.stamp.t_ns)
            self._places.append(sample.matrix[:3, 3])

    @property
    def pictures(self) -> int:
        return len(self._times_ns)

    @property
    def seen(self) -> int:
        """Returns the number of pictures with a line."""
        return int(np.isfinite(self.depth_px()).sum())

    def depth_px(self) -> Vector:
        """Returns the row of the line in the middle of each picture, (n,), NaN where there is none that continues to
        both sides.

        Where most of what is bright continues to neither side, as with the wires of a phantom, what does continue is
        chance: all are NaN.
        """
        none = np.full(len(self._profiles), np.nan)
        if len(self._profiles) < _LEAST_PICTURES:
            return none
        profiles = np.array(self._profiles)
        moved = profiles - np.median(profiles, axis=0)
        left, middle, right = (np.array([_peak(row) for row in moved[:, band]]) for band in range(3))
        across = np.abs(left + right - 2 * middle) <= _HALF_LINE_PX
        if across.sum() < _LEAST_SHARE * np.isfinite(middle).sum():
            return none
        return np.where(across, middle, np.nan)

    def latency(self) -> Latency | None:
        """Returns the tracker's latency; None where the line or the motion does not show it."""
        depth = self.depth_px()
        seen = np.isfinite(depth)
        if seen.sum() < _LEAST_PICTURES or len(self._pose_ns) < _LEAST_PICTURES:
            return None
        origin_ns = self._times_ns[0]
        t_s = (np.array(self._times_ns)[seen] - origin_ns) / 1e9
        if np.ptp(t_s) > _LONGEST_S:
            return None
        pose_t_s = (np.array(self._pose_ns) - origin_ns) / 1e9
        path_mm = np.stack([np.zeros(seen.sum()), depth[seen] * _ROUGH_MM_PER_PX])
        return far_latency(t_s, np.zeros(len(t_s), np.int64), path_mm, pose_t_s, np.array(self._places).T)


def _profile(image: GreyImage) -> Vector:
    """Returns the mean grey of three bands, smoothed along the rows, (3, h): left of the middle, in the middle, right
    of it.
    """
    width = image.shape[1]
    reach = round(3 * _SMOOTH_ROWS)
    weights = np.exp(-((np.arange(-reach, reach + 1) / _SMOOTH_ROWS) ** 2) / 2)
    bands = []
    for centre in (0.5 - _BESIDE, 0.5, 0.5 + _BESIDE):
        band = image[:, round(width * (centre - _BAND / 2)) : round(width * (centre + _BAND / 2)) + 1].mean(axis=1)
        bands.append(np.convolve(band, weights / weights.sum(), mode="same"))
    return np.array(bands)


def _peak(profile: Vector) -> float:
    """Returns the centre, px, of what stands out about the highest row; NaN where nothing does."""
    top = int(np.argmax(profile))
    if profile[top] < _LEAST_GREY:
        return np.nan
    first, last = max(0, top - _HALF_LINE_PX), min(len(profile), top + _HALF_LINE_PX + 1)
    weight = np.clip(profile[first:last] - profile[top] / 2, 0, None)
    return float(np.sum(weight * np.arange(first, last)) / weight.sum())
