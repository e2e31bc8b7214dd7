"""Watches whether the picture is still the one with which the probe came to rest: a gradual change breaks no chain.

Every picture of a rest is compared with the first of that rest, which no gradual change drags along. Tissue that moves
under a probe at rest comes back with the next breath, and passes through what lies between; a picture that has become
another one does not come back, and one that fades, or is wiped, shows nothing in between but the two.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from probewatch.appliance.core.detectors.magnification import magnified, pressed_between
from probewatch.appliance.core.detectors.picture_change import PictureChange, lines_turned_by, stretch_of
from probewatch.appliance.core.detectors.picture_link import Link, View
from probewatch.appliance.core.detectors.strain_leap import LastingStrain, Strain, StrainLeap, is_across_alone
from probewatch.appliance.core.detectors.stretch import carried, seen_in_both, stretch_between
from probewatch.appliance.core.motion import out_of_plane_mm, predicted_motion
from probewatch.appliance.core.registration.keyframe import compose, warp_matrix
from probewatch.appliance.core.registration.pyramid import Array32
from probewatch.appliance.core.registration.realtime_tracker import Warp
from probewatch.appliance.core.times import COMPARE_NS, SLOW_BREATH_NS, TREMOR_NS
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import Matrix4

_STILL_MM, _STILL_IN_PLANE_MM = 0.5, 2.0
"""Distance, mm, out of the plane, and along an axis in it, up to which the probe rests. More compares pictures that
have nothing in common, less lets tremor end a rest. Not measured."""
_LEAST_LIKES = 3
"""Number of looks, half a second of them, that must find the first picture again before one that does not find it
counts: what a hand showed before it had come to rest is no measure. More misses what changes early in a rest."""
_BREATH_NS = 4 * SLOW_BREATH_NS // 3
"""Time, ns, for which no picture may be like the first: a slow breath, and a third. Less voids what was shown where a
patient breathes slowly, more lets a picture that has become another pass for longer. Over tissue that breathes by 2 to
12 mm, 12 to 15 times a minute, it came to 3.7 s at most (study, gesture-hold, 40 to 60 s, seeds 1 to 3)."""
_MEASURED_NS = 600_000_000
"""Time, ns, between two searches for a gradual magnification: each costs 3 ms, or 30 while the picture is not like the
first one."""
_KEPT_NS, _MOST_KEPT = 60_000_000, 66
"""Time, ns, between two pictures that are kept, and number of those kept: 4 s of them. Fewer miss what leaping tissue
shows in between, or slow fades; each costs 80 kB and .2 ms."""
_BLUR_PX = 1.5
"""Sigma, px of the small picture: speckle blurred by it differs from that of another place, but not from its own half a
px beside. More leaves too few grains."""
_UNLIKE, _MOST_BEYOND = 0.15, 0.025
"""Correlation below which two pictures are different ones, and how far each that lies between them may lie beyond both,
as a share of their difference squared. Tissue half way between two planes of so little likeness lies .06 and more
beyond, for Gaussian speckle; the fades of a held probe came to .02. Less misses fades over a hand's tremor, more takes
tissue for a fade."""
_MOST_LEAP_PX = 1.5
"""Largest change, px of the small picture, of the displacement of the tissue from one picture to the next: the
registration leaps to what fades in, while the tissue goes on. Not measured."""
_STRAINED_ACROSS = 0.04
"""The same across alone, whatever the press of the face: a press strains what lies below it down as well. At rest it
came to .022 at most with poor contact or a sliding organ in a narrow window, and to .006 over other tissue (study,
gesture-hold, twelve worlds, 112 runs of 20 s)."""
_LEAST_BETWEEN = 2
"""Fewest pictures between the two; with fewer the chain of pictures decides."""


@dataclass(frozen=True, slots=True, eq=False)
class _Kept:
    """Holds a picture of the rest. blurred: (h, w), from the small picture. path: displacement of the tissue since the
    rest began, px of the small picture and rad.
    """

    t_ns: int
    blurred: Array32
    path: Warp


class RestingPicture:
    """Compares every picture that continues the chain with the first one of the rest.

    link: returns the earlier picture where its tissue is in the later one, and how the later one continues it. aspect:
    λ_axial ÷ λ_lateral. most_turn_rad: angle beyond which no tissue turns. least_strain: smallest leap of the logarithm
    of an axis that counts.
    """

    def __init__(
        self,
        reference: Calibration,
        aspect: float,
        most_turn_rad: float,
        least_strain: float,
        link: Callable[[View, View], tuple[Array32, Link | None]],
    ) -> None:
        self._reference, self._aspect, self._most_turn_rad, self._link = reference, aspect, most_turn_rad, link
        self._leap, self._lasting = StrainLeap(least_strain), LastingStrain(least_strain)
        self.restart()

    def restart(self) -> None:
        """Forgets the first picture of the rest and all that was measured against it."""
        self._first: View | None = None
        self._likes = 0
        self._lasting.restart()
        self._still_ns = self._looked_ns = self._measured_ns = self._unlike_ns = 0
        self._kept: deque[_Kept] = deque(maxlen=_MOST_KEPT)
        self._path: Warp = (np.zeros(2), 0.0)
        self._way: Warp = (np.zeros(2), 0.0)

    def step(self, view: View, way: Warp) -> PictureChange | None:
        """Returns the change since the probe came to rest, unnamed where nothing shows what has become of the picture;
        None where there is none.

        way: displacement of its tissue since the picture before, px of the small picture and rad.
        """
        if view.pose is None:
            return None
        first = self._first
        if first is None or first.pose is None:
            self._begin(view)
            return None
        self._keep(view, way)
        since_ns = view.t_ns - self._looked_ns
        if since_ns < COMPARE_NS:
            return None
        self._looked_ns = view.t_ns
        if self._left(first.pose, view.pose):
            if view.t_ns - self._still_ns > TREMOR_NS:
                self._begin(view)
            return None
        self._still_ns = view.t_ns
        return self._look(view, first, since_ns)

    def _left(self, first: Matrix4, now: Matrix4) -> bool:
        """Returns whether the probe has left the place where the rest began."""
        moved_mm, _ = predicted_motion(self._reference, first, now)
        beside = float(np.max(np.abs(moved_mm[:2]))) > _STILL_IN_PLANE_MM
        return beside or out_of_plane_mm(self._reference, first, now) > _STILL_MM

    def _begin(self, view: View, strain: Strain | None = None) -> None:
        """Begins a rest with this picture. strain: that of the picture against the one with which the rest had begun,
        where that rest has not ended.
        """
        self.restart()
        self._first = view
        if strain is None:
            self._leap.begin(view.t_ns)
        else:
            self._leap.go_on(strain)
        self._still_ns = self._looked_ns = self._measured_ns = view.t_ns
        self._kept.append(_Kept(view.t_ns, _blurred(view.small), self._path))

    def _keep(self, view: View, way: Warp) -> None:
        leapt = np.max(np.abs(way[0] - self._way[0])) > _MOST_LEAP_PX
        self._way = self._way if leapt else way
        self._path = compose(self._path, self._way, self._aspect)
        if view.t_ns - self._kept[-1].t_ns >= _KEPT_NS:
            self._kept.append(_Kept(view.t_ns, _blurred(view.small), self._path))

    def _look(self, view: View, first: View, since_ns: int) -> PictureChange | None:
        placed, link = self._link(view, first)
        if link is None:
            return None
        alike = link.whole or link.covered
        strain = self._strain(placed, view, first)
        if strain is not None and self._leap.step(strain):
            return PictureChange()
        if view.t_ns - self._measured_ns >= _MEASURED_NS:
            change = self._magnified(strain, placed, view, first, alike)
            if change is not None:
                return change
        lasting = self._lasting.step(strain)
        if alike and not lasting:
            self._likes, self._unlike_ns = self._likes + 1, 0
            return None
        if self._likes < _LEAST_LIKES:
            self._begin(view, strain)
            return None
        self._unlike_ns += since_ns
        return PictureChange() if self._unlike_ns > _BREATH_NS or self._blended(view) else None

    def _strain(self, placed: Array32, view: View, first: View) -> Strain | None:
        found = stretch_between(*seen_in_both(placed, view.small), self._aspect, (1.0, 1.0))
        if found is None:
            return None
        return Strain(view.t_ns, np.log(found.magnification), pressed_between(self._reference, first, view))

    def _magnified(
        self, strain: Strain | None, placed: Array32, view: View, first: View, alike: bool
    ) -> PictureChange | None:
        """Returns the change for a magnification, turn or shear since the rest began, wherever one is to be seen; None
        where there is none. strain: that of the picture, used where the picture is alike.
        """
        self._measured_ns = view.t_ns
        if alike:
            log_zoom = np.zeros(2) if strain is None else strain.log_zoom
        else:
            stretch = stretch_of(placed, view.small, self._aspect)
            log_zoom = np.zeros(2) if stretch is None else np.log(stretch.zoom)
            turned_rad = lines_turned_by(placed, view.small, self._aspect, far=True) if stretch is None else None
            change = turned_or_sheared(turned_rad, self._most_turn_rad, self._reference, first, view)
            if change is not None:
                return change
        pressed = pressed_between(self._reference, first, view)
        if is_across_alone(log_zoom) and abs(log_zoom[0]) > _STRAINED_ACROSS:
            return PictureChange()
        return magnified(log_zoom, pressed)

    def _blended(self, view: View) -> bool:
        """Returns whether all pictures since the last that was a different one show nothing but that one and this."""
        now = _middle(_blurred(view.small))
        between: list[Array] = []
        for kept in reversed(self._kept):
            shown = _middle(self._carried(kept))
            if np.corrcoef(shown.ravel(), now.ravel())[0, 1] < _UNLIKE:
                return len(between) >= _LEAST_BETWEEN and _lie_between(between, shown, now)
            between.append(shown)
        return False

    def _carried(self, kept: _Kept) -> Array32:
        """Returns the kept picture, blurred, where its tissue is now."""
        turned = self._path[1] - kept.path[1]
        way_px = self._path[0] - warp_matrix(turned, self._aspect) @ kept.path[0]
        return carried(kept.blurred, (way_px, turned), self._aspect)


def turned_or_sheared(
    turned_rad: Array | None, most_rad: float, reference: Calibration, before: View, now: View
) -> PictureChange | None:
    """Returns an unnamed change where lines of the picture have turned by more than a hand and tissue can turn them;
    otherwise None.

    turned_rad: (2,) as in `Lines`, None where it is not known. most_rad: largest turn of tissue. Tissue shears by more
    where the face drags its skin along, or is pressed into it.
    """
    if turned_rad is None:
        return None
    across, down = turned_rad
    both = min(abs(across), abs(down)) if across * down < 0 else 0.0
    most = max(abs(across), abs(down))
    sheared_rad, mirrored_rad = _made_by_the_face(reference, before, now)
    if both <= most_rad + mirrored_rad and most <= most_rad + sheared_rad + mirrored_rad:
        return None
    return PictureChange()


def _made_by_the_face(reference: Calibration, before: View, now: View) -> tuple[float, float]:
    """Returns two angles by the tracker, rad: how far the motion of the face may shear lines, and how much more they
    turn where the picture is mirrored, so that it turns the other way than expected. Both are 0 where a pose is
    missing.
    """
    if before.pose is None or now.pose is None:
        return 0.0, 0.0
    moved_mm, turned_rad = predicted_motion(reference, before.pose, now.pose)
    height_mm = reference.image_size_px[1] * reference.scale_mm_per_px[1]
    sheared_rad = abs(moved_mm[0]) / height_mm + np.abs(pressed_between(reference, before, now)).sum()
    return float(sheared_rad), float(2 * abs(turned_rad[2]))


def _blurred(picture: Array32) -> Array32:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), _BLUR_PX), np.float32)


def _lie_between(pictures: list[Array], one: Array, other: Array) -> bool:
    """Returns whether the pixels of all pictures lie between those of `one` and `other`, within `_MOST_BEYOND`."""
    low, high = np.minimum(one, other), np.maximum(one, other)
    most = _MOST_BEYOND * float(np.sum((high - low) ** 2))
    return all(float(np.sum((shown - np.clip(shown, low, high)) ** 2)) <= most for shown in pictures)


def _middle(picture: Array32) -> Array:
    """Returns the picture without its edges, which may show another place."""
    rows, columns = picture.shape[0] // 8, picture.shape[1] // 8
    return np.asarray(picture[rows : picture.shape[0] - rows, columns : picture.shape[1] - columns], float)
