"""Measures how much the picture has been magnified little by little: an animated zoom never breaks a chain of pictures.

Each picture is compared with an earlier one that it is still like, which the registration has followed to where it is
now; what is measured between such pictures is added up.
"""

from collections import deque
from dataclasses import dataclass
from math import ceil, floor

import numpy as np

from probewatch.appliance.core.detectors.picture_change import PictureChange
from probewatch.appliance.core.detectors.picture_link import View
from probewatch.appliance.core.detectors.stretch import carried, likeness_in_place, stretch_between
from probewatch.appliance.core.motion import predicted_motion
from probewatch.appliance.core.registration.keyframe import compose, warp_matrix
from probewatch.appliance.core.registration.pyramid import Array32
from probewatch.appliance.core.registration.realtime_tracker import Warp
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array

_OVER_NS = 1_000_000_000
"""Time, ns, over which magnification is added up. Longer adds up more noise, and the strain of tissue under a hand that
presses; shorter misses slow animations: scanners take a quarter to half a second."""
_ALIKE, _EVERY_NS = 0.8, 400_000_000
"""Likeness below which, and time, ns, after which the next magnification is measured: a stretch by 5 % leaves .8. Less
likeness leaves fewer parts to measure, more adds up the noise of more measurements."""
_LEAST_SIDE_PX = 48
"""Least side, px of the small picture, of what both pictures show: less leaves too few parts side by side."""
_MOST_TURN_RAD = np.deg2rad(0.5)
"""Largest turn, rad, between the two pictures: speckle that turns in a beam that does not turn looks shrunk across it,
by 1 % a degree and more."""
_LEAST = 0.07
"""Least change of the logarithm of an axis for a zoom: one of 1.3 over half a second changes it by .018 from picture to
picture. In five healthy sessions of the study it came to .046 at most. Less takes noise for a zoom, more misses what is
animated."""
_LEAST_STRAIN = 0.12
"""The same where one axis changes more than the other: tissue under a hand is strained, and the edge of a shadow draws
one axis."""
_EVEN = 0.6
"""Ratio of the smaller of both axes to the larger, from which the change is a zoom: tissue that is pressed is strained
along one axis. The press of the face, as a share of the picture's height, is allowed in addition: no tissue between the
face and the lower edge of the picture is strained by more on average, nor as much to either side. A press of 3 mm
strained 21 mm of a half space by .14 and .1 (study, gesture, half-20)."""


_LEAST_GAIN = 0.4
"""Least ratio of the motion that the measured stretches explain beyond shifts and turns (`gained_px`) to the distance
by which they moved parts apart (`apart_px`). For zooms by 30, 10 and −20 % and a stretch by 20 % in half a second,
in-plane over rigid and half-30+deep, it was .46 to .97; for an organ that slid by 8 mm under its wall −.53 to .35 in
twelve cases that were taken for a zoom or a stretch (study, organ-8-lateral, seeds 1, 2, 30 s). Less takes sliding for
a zoom, more misses slow zooms under a quick hand."""


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    """Holds a comparison of two pictures. log_zoom: (2,) logarithm of the magnification, lateral and axial. pressed:
    (2,) as in `pressed_between`. apart_px, gained_px: as in `Stretch`.
    """

    t_ns: int
    log_zoom: Array
    pressed: Array
    apart_px: float
    gained_px: float


class Magnification:
    """Adds up the magnification over pictures, each of which was followed from the one before."""

    def __init__(self, aspect: float) -> None:
        """aspect: λ_axial ÷ λ_lateral."""
        self._aspect = aspect
        self.restart()

    def restart(self) -> None:
        """Starts again: later pictures are not compared with earlier ones."""
        self._base: Array32 | None = None
        self._base_ns = 0
        self._path: Warp = (np.zeros(2), 0.0)
        self._pressed = np.zeros(2)
        self._measured: deque[_Look] = deque()

    def step(self, t_ns: int, picture: Array32, way: Warp, pressed: Array) -> None:
        """Takes the next small picture. way: displacement of its tissue since the picture before, px of the small one
        and rad. pressed: that since the picture before, as in `pressed_between`.
        """
        self._path = compose(self._path, way, self._aspect)
        self._pressed += pressed
        if self._base is None:
            self._begin(t_ns, picture)
            return
        before, now = self._in_both(picture)
        small = min(now.shape) < _LEAST_SIDE_PX
        if not small and t_ns - self._base_ns < _EVERY_NS and likeness_in_place(before, now) >= _ALIKE:
            return
        turned = abs(self._path[1]) > _MOST_TURN_RAD
        found = None if small or turned else stretch_between(before, now, self._aspect, (1.0, 1.0))
        if found is not None:
            log_zoom = np.log(found.magnification)
            self._measured.append(_Look(t_ns, log_zoom, self._pressed, found.apart_px, found.gained_px))
        while self._measured and self._measured[0].t_ns <= t_ns - _OVER_NS:
            self._measured.popleft()
        self._begin(t_ns, picture)

    def crept(self) -> PictureChange | None:
        """Returns the magnification of the last second, once; None where a hand or sliding tissue makes it."""
        if sum(look.gained_px for look in self._measured) < _LEAST_GAIN * sum(look.apart_px for look in self._measured):
            return None
        log_zoom = sum((look.log_zoom for look in self._measured), np.zeros(2))
        change = magnified(log_zoom, sum((look.pressed for look in self._measured), np.zeros(2)))
        if change is not None:
            self._measured.clear()
        return change

    def _in_both(self, picture: Array32) -> tuple[Array32, Array32]:
        """Returns what the base and this picture both show: as of the base, carried to its place now, and as it is."""
        assert self._base is not None
        height, width = picture.shape
        M, middle = warp_matrix(self._path[1], self._aspect), (np.array([width, height]) - 1) / 2
        # What both show lies within the inner bounds of the base's carried corners, clipped to the picture.
        corners = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]]) * middle @ M.T + middle + self._path[0]
        left, right = max(corners[:2, 0].max(), 0), min(corners[2:, 0].min(), width - 1)
        top, bottom = max(corners[::2, 1].max(), 0), min(corners[1::2, 1].min(), height - 1)
        seen = np.s_[ceil(top) : floor(max(bottom, 0)) + 1, ceil(left) : floor(max(right, 0)) + 1]
        return carried(self._base, self._path, self._aspect)[seen], picture[seen]

    def _begin(self, t_ns: int, picture: Array32) -> None:
        self._base, self._base_ns, self._path = picture, t_ns, (np.zeros(2), 0.0)
        self._pressed = np.zeros(2)


def pressed_between(reference: Calibration, before: View, now: View) -> Array:
    """Returns the shares of the picture's height, (2,), by which the face went down and by which one end of it was
    rocked, by the tracker; 0 where a pose is missing.
    """
    if before.pose is None or now.pose is None:
        return np.zeros(2)
    moved_mm, turned_rad = predicted_motion(reference, before.pose, now.pose)
    width_mm, height_mm = reference.image_size_px * reference.scale_mm_per_px
    return np.array([moved_mm[1], turned_rad[2] * width_mm / 2]) / height_mm


def is_even(log_zoom: Array) -> bool:
    """Returns whether the logarithms of a zoom, (2,), are alike: a scanner's are, those of pressed tissue are not."""
    first, second = log_zoom
    return bool(first and second and min(first / second, second / first) >= _EVEN)


def magnified(log_zoom: Array, pressed: Array) -> PictureChange | None:
    """Returns the change that a gradual magnification makes; None where a hand alone explains it.

    log_zoom: (2,), lateral and axial. pressed: that of the face meanwhile, as in `pressed_between`. The change is
    unnamed for a stretch along one axis, because strained tissue looks alike: it voids what was shown.
    """
    even = is_even(log_zoom)
    if np.max(np.abs(log_zoom)) < (_LEAST if even else _LEAST_STRAIN) + np.abs(pressed).sum():
        return None
    across, down = np.exp(log_zoom)
    return PictureChange(zoom=(float(across), float(down))) if even else PictureChange()
