"""Finds how the picture has changed within half a second, while the hand was still.

A picture that dissolves into another, or is wiped, is like the one before at every step, so it breaks no chain.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from probewatch.appliance.core.detectors.magnification import is_even, pressed_between
from probewatch.appliance.core.detectors.picture_change import (
    PictureChange,
    flip_or_zoom_of,
    lines_turned_by,
    searchable,
    shift_of,
    stretch_of,
)
from probewatch.appliance.core.detectors.picture_link import SMALL_PX, Link, View
from probewatch.appliance.core.detectors.resting_picture import turned_or_sheared
from probewatch.appliance.core.detectors.stretch import carried, stretch_between
from probewatch.appliance.core.motion import out_of_plane_mm
from probewatch.appliance.core.registration.pyramid import Array32
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array

_EARLIER_NS, _LOOKS_NS = 600_000_000, 150_000_000
"""Age, ns, of the picture that is compared with the newest one while the hand is still, and time, ns, between two such
looks: what dissolves into another picture, or is wiped, breaks no chain. An older one shows slower changes, but tissue
has moved on by then; looking more often costs 2 ms each time."""
_STILL_MM, _LOST = 0.5, 0.35
"""Distance, mm, out of the plane up to which the hand is still, and share of parts alike below which a look becomes a
search, of 40 to 80 ms. Not measured on tissue that moves out of the plane."""
_STEPS = 3
"""Number of steps from picture to picture whose median is the displacement of the tissue: a single leap of the
registration does not count. More lag behind tissue that turns back."""
_AS_IT_WAS = 0.95
"""Share of parts alike from which a look asks no more: each that does costs 4 ms. Of coarse speckle that was turned by
5°, .79 are alike. More asks whenever tissue moves a little, less misses small turns."""
_NAMED = 0.1
"""Change of the logarithm of a zoom found here, from which it is named; a smaller one voids what was shown. Breathing
by 12 mm presses soft tissue against a face that rests, and came to .058 and .067 (study, gesture-hold over
half-20+drag-1+deep+breath-12-axial, seeds 1, 2). Less names a zoom where a patient breathes, more leaves small zooms to
be found from motion."""


@dataclass(frozen=True, slots=True, eq=False)
class _Earlier:
    """Holds an earlier picture. gone_px: (2,) displacement of its tissue since the detector was made, px of a small
    one.
    """

    view: View
    gone_px: Array


class DissolvedPicture:
    """Compares every picture that continues the chain with one of half a second before.

    link: returns the earlier picture where its tissue is in the later one, and how the later one continues it.
    """

    def __init__(
        self,
        reference: Calibration,
        limits: Limits,
        link: Callable[[View, View], tuple[Array32, Link | None]],
    ) -> None:
        self._reference, self._link = reference, link
        self._scale_limit, self._offset_limit = limits.scale_percent, limits.offset_mm
        self._rotation_limit_rad = float(np.deg2rad(limits.rotation_deg))
        self._px_per_mm = min(1.0, SMALL_PX / reference.image_size_px[0]) / reference.scale_mm_per_px
        self._aspect = float(reference.scale_mm_per_px[1] / reference.scale_mm_per_px[0])
        self._earlier: deque[_Earlier] = deque()
        self._gone_px, self._steps_px = np.zeros(2), deque[Array](maxlen=_STEPS)

    def restart(self) -> None:
        """Forgets the earlier pictures; the displacement of the tissue adds up as before."""
        self._earlier.clear()

    def note_step(self, way_px: Array) -> None:
        """Takes the displacement of the tissue since the picture before, by the registration. That leaps to what fades
        in, while the tissue goes on, so the median of the last steps counts.
        """
        self._steps_px.append(way_px)
        self._gone_px = self._gone_px + np.median(self._steps_px, axis=0)

    def note_way(self, way_px: Array) -> None:
        """Takes the displacement of the tissue over pictures that were not followed."""
        self._gone_px = self._gone_px + way_px

    def still(self, view: View) -> bool:
        """Returns whether, by the tracker, the hand has stayed in its plane since the earliest picture that is kept;
        False where a pose is missing.
        """
        return self._still_between(self._earlier[0].view if self._earlier else view, view)

    def step(self, view: View) -> PictureChange | None:
        """Returns the change within the last half second, if the hand was still; None where there is none."""
        if view.pose is None or (self._earlier and view.t_ns - self._earlier[-1].view.t_ns < _LOOKS_NS):
            return None
        self._earlier.append(_Earlier(view, self._gone_px))
        while view.t_ns - self._earlier[0].view.t_ns > _EARLIER_NS:
            self._earlier.popleft()
        earlier = self._earlier[0]
        before = earlier.view
        if before is view or not self._still_between(before, view):
            return None
        placed, link = self._link(view, before)
        if link is None or link.alike >= _AS_IT_WAS or not searchable(placed, view.small):
            return None
        change = None
        # The search is slow, so that it runs only where few parts are alike.
        if lost := link.alike < _LOST:
            change = stretch_of(placed, view.small, self._aspect) or flip_or_zoom_of(placed, view.small)
            change = None if change is None else self._not_tissue(change, before, view, placed)
        if change is None:
            turned_rad = lines_turned_by(placed, view.small, self._aspect, far=lost)
            change = turned_or_sheared(turned_rad, self._rotation_limit_rad, self._reference, before, view)
        return self._moved(before, view, self._gone_px - earlier.gone_px) if change is None else change

    def _still_between(self, before: View, view: View) -> bool:
        if before.pose is None or view.pose is None:
            return False
        return out_of_plane_mm(self._reference, before.pose, view.pose) <= _STILL_MM

    def _moved(self, before: View, view: View, gone_px: Array) -> PictureChange | None:
        """Returns an unnamed change where the picture is elsewhere than its tissue has gone, by more than the limit of
        the offset; otherwise None.
        """
        expected = carried(before.small, (gone_px, 0.0), self._aspect)
        shift_px = shift_of(before.small, view.small, expected)
        if shift_px is None:
            return None
        beside_mm = np.abs(shift_px - gone_px) / self._px_per_mm
        return PictureChange() if np.max(beside_mm) > self._offset_limit else None

    def _not_tissue(self, change: PictureChange, before: View, view: View, placed: Array32) -> PictureChange | None:
        """Returns the change; None where tissue under a hand that presses may look the same: where it is less than the
        limit of a scale and the press of the face together.

        Looks at tissue that slid out of the plane came to −2 and −4 %, which added up to a zoom by −6 %. What breathing
        may do is unnamed: a breath of 12 mm stretched half a space of 20 mm by 14 % down and shrank it by 4 % across
        (study, gesture-hold over half-20+breath-12-axial, seed 1). So is a zoom that its parts do not show: organs that
        slid by 8 mm along the beam came to +17 and +13 % in this way (organ-8-axial, seed 3).
        """
        if change.polarity != (1, 1):
            return change
        log_zooms = np.log(change.zoom)
        log_zoom = float(np.max(np.abs(log_zooms)))
        pressed = float(np.abs(pressed_between(self._reference, before, view)).sum())
        if log_zoom < np.log1p(self._scale_limit / 100) + pressed:
            return None
        even = is_even(log_zooms) and log_zoom >= _NAMED + pressed
        shown = even and stretch_between(placed, view.small, self._aspect, change.zoom) is not None
        return change if shown else PictureChange()
