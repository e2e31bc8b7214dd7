"""Detects changes of the picture's geometry from one live picture to another, whatever lies between, and needs no
motion.

What motion has shown of a calibration holds for a chain of pictures that show the same tissue in the same geometry. A
picture that the Real-time Tracker follows, and that is as much like the one before as usual, continues the chain. Any
other is compared with the last picture of the chain: mirrored, magnified or stretched, it shows what the operator, or
the frame grabber, has changed; where it shows the same tissue, where the tracker says it should be, the chain goes on.
Until a picture continues it, the line sees nothing that it could compare with the reference, and soon nothing counts as
shown any more.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from probewatch.appliance.core.detectors.detector import Detector
from probewatch.appliance.core.detectors.dissolved_picture import DissolvedPicture
from probewatch.appliance.core.detectors.double_exposure import DoubleExposure
from probewatch.appliance.core.detectors.magnification import Magnification, pressed_between
from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.core.detectors.picture_change import (
    LEAST_STRETCH,
    PictureChange,
    Stretched,
    closest_stretch,
    flip_or_zoom_of,
    searchable,
)
from probewatch.appliance.core.detectors.picture_link import (
    SMALL_PX,
    Link,
    View,
    comparable,
    link_between,
    small,
)
from probewatch.appliance.core.detectors.polarity import MOST_FLIPPED
from probewatch.appliance.core.detectors.resting_picture import RestingPicture
from probewatch.appliance.core.detectors.stretch import carried, likeness_in_place, lines_turned
from probewatch.appliance.core.motion import out_of_plane_mm, predicted_motion
from probewatch.appliance.core.registration.pyramid import Array32, Bits
from probewatch.appliance.core.registration.realtime_tracker import Warp
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration, Check, Fault, VerdictKind
from probewatch.drivers.rigid import Array

REPORTS_FAULTS = (Fault.POLARITY, Fault.SCALE)

_CALM_FRAMES = 5
"""Number of pictures a chain must have before what comes after it is explained. Fewer explain what comes after a scene
that was lost anyway; more miss two events in close succession. Not measured."""
_FELL = 0.12
"""Fall of the likeness to the picture before, carried on as the registration has it, below that of the last pictures,
from which a picture is compared with the last of the chain although it was followed. In healthy motion one picture in a
hundred falls so far, of pictures stretched by 6 % all do (six sessions of two seconds). Less compares more often, 20 ms
each time, more misses small stretches."""
_FELL_LITTLE = 0.03
"""Fall of the same likeness from which the picture is searched for a stretch only. In windows of 19 mm that were
stretched laterally by 4 to 6 % it fell by .05 to .13. Of healthy pictures one to ten in a hundred fall so far, and none
of 768 had a stretch by 1.5 % or more (eighteen sessions of nine worlds, with a window and without). Less searches more
often, 2 ms each time; more misses small stretches."""
_LEAST_OF_LIMIT = 0.8
"""Smallest stretch that counts ÷ limit of a scale. Less voids what was shown because of changes within the limit, more
misses those just beyond it. A measured stretch is accurate to .2 %. Not varied."""
_SEARCHES = 3
"""Number of searches for a flip or a zoom, 40 ms each, after the chain has ended: the first pictures may be black, or
half of another."""
_LEFT_PX = 1.5
"""Displacement of the picture's edge, px of the small picture, up to which a turn is not applied: parts are searched
for 1 px beside."""
_SWEPT_MM, _SWEPT_MM_PER_S = 0.7, 20.0
"""Distance, mm, out of the plane from one picture to the next, and speed, mm/s, from which pictures continue the chain
though nothing in them does. Less lets a change pass that comes at the very picture of a quick sweep and is not
recognised by what is left of the speckle; more voids what was shown whenever a hand suddenly goes elsewhere."""
_TISSUE_MM, _TISSUE_MM_PER_S = 0.5, 10.0
"""Distance, mm, from the place given by the poses at which tissue may be after a break, and speed, mm/s, at which it
moves by itself: a breath of 12 mm, fifteen a minute, moves it by 9.4 mm/s. More takes a picture that was moved on the
screen for tissue that moved, less voids what was shown whenever the picture goes blank over a breathing patient."""
_COVERED = 5
"""Number of pictures in a row, covered in part, after which the cover belongs to the picture: a torn one is alone."""


@dataclass(frozen=True, slots=True, eq=False)
class _Course:
    """Holds the velocity of the tissue in the picture. per_ns: (2,) picture widths per ns. turn_per_ns: rad per ns."""

    per_ns: Array = field(default_factory=lambda: np.zeros(2))
    turn_per_ns: float = 0.0

    def after(self, ns: int, width_px: int) -> Warp:
        """Returns how far the tissue goes in `ns`, px and rad."""
        return self.per_ns * ns * width_px, self.turn_per_ns * ns

    def changed(self, change: PictureChange) -> "_Course":
        """Returns the same course in the picture as it is after the change."""
        turned = self.turn_per_ns * change.polarity[0] * change.polarity[1]
        return _Course(self.per_ns * change.polarity * np.array(change.zoom), turned)


class PictureChain(Detector):
    """Adds up the changes since the reference came into force.

    A change is named once the picture after it does not revert it: one spoilt picture withdraws the OK but raises no
    alarm.

    tissue: returns the registration's mask, (h, w) bool, None until it is known. unaveraged: returns whether pictures
    are known to hold nothing of those before them: what an averaging scanner smears of a quick hand loses contrast as a
    fade does. most_ns: time for which the chain waits for a picture that continues it; then another begins, and a
    caller that relies on the first must have given it up. linked: whether the latest picture continues the chain.
    """

    def __init__(
        self,
        limits: Limits,
        reference: Calibration,
        tissue: Callable[[], Bits | None],
        unaveraged: Callable[[], bool],
        most_ns: int,
    ) -> None:
        self._scale_limit, self._offset_limit = limits.scale_percent, limits.offset_mm
        self._rotation_limit_rad = float(np.deg2rad(limits.rotation_deg))
        self._least = min(LEAST_STRETCH, _LEAST_OF_LIMIT * limits.scale_percent / 100)
        self._reference, self._tissue, self._unaveraged, self._most_ns = reference, tissue, unaveraged, most_ns
        self._px_per_mm = min(1.0, SMALL_PX / reference.image_size_px[0]) / reference.scale_mm_per_px
        self._aspect = float(reference.scale_mm_per_px[1] / reference.scale_mm_per_px[0])
        self._last: View | None = None
        self._course = _Course()
        self._magnification = Magnification(self._aspect)
        self._double_exposure = DoubleExposure()
        self._dissolving = DissolvedPicture(reference, limits, self._link)
        self._resting = RestingPicture(reference, self._aspect, self._rotation_limit_rad, self._least, self._link)
        self._followed = self._searches = self._covered = 0
        self._likenesses: deque[float] = deque(maxlen=_CALM_FRAMES)
        self._newest, self._fell = 1.0, 0.0
        self._just_changed = False
        self._polarity = (1, 1)
        self._log_zoom = np.zeros(2)
        self._covered_ns: int | None = None
        self._astray_px = np.zeros(2)
        self.linked = self._direct = False

    def see(self, seen: Observation) -> bool:
        """See Detector."""
        return not seen.repeated and self.step(seen) is not None

    def step(self, seen: Observation) -> PictureChange | None:
        """Returns the change between the last picture of the chain and this one; None where there was none."""
        view = View(seen.t_ns, small(seen.image, self._tissue()), seen.pose)
        direct, last = self._direct, self._last
        self.linked = self._direct = False
        known, self._just_changed = self._followed >= _CALM_FRAMES or self._just_changed, False
        if last is None or not 0 < view.t_ns - last.t_ns <= self._most_ns:
            carried_on = self._covered_ns is not None and 0 < view.t_ns - self._covered_ns <= self._most_ns
            self._begin(view)
            # Pictures that are covered in part kept the sight, so that the gap rule of the line has voided nothing.
            return PictureChange() if carried_on else None
        own = self._own_course(seen, view, last) if direct else None
        way = None if own is None else own.after(view.t_ns - last.t_ns, last.small.shape[1])
        followed = None if way is None else carried(last.small, way, self._aspect)
        if way is not None and followed is not None and self._goes_on(followed, view):
            change = self._stretched(followed, view, last) if known else None
            self._go_on(view, last, own)
            change = change or self._magnification.crept() or self._dissolved(view)
            change = change or self._resting.step(view, way) or self._faded(view)
            if change is not None:
                self._take(change, view)
            return change
        # Any other picture is compared with the last one of the chain.
        if not comparable(view.small):
            return None
        placed, link = self._link(view, last)
        change = self._change(placed, view, last, link) if known else None
        if change is not None:
            self._magnification.restart()
            self._take(change, view)
        else:
            self._take_link(placed, view, last, link, own, direct)
            change = self._faded(view) if self._last is view else None
            if change is not None:
                self._take(change, view)
        return change

    def forget_pictures(self, since_ns: int) -> None:
        """See Detector. Later pictures continue from the last one all the same, wherever that was."""
        self.linked = self._direct = False
        self._dissolving.restart()
        self._resting.restart()
        if self._last is not None:
            self._last = replace(self._last, t_ns=min(self._last.t_ns, since_ns - 1))

    def on_verified(self, shows: Callable[[Fault], bool], until_ns: int) -> None:
        """See Detector. The sum of events was wrong, or has been undone elsewhere."""
        if shows(Fault.POLARITY):
            self._polarity = (1, 1)
        if shows(Fault.SCALE):
            self._log_zoom = np.zeros(2)

    def checks(self) -> tuple[Check, ...]:
        """Returns the flipped axes and the larger magnification of both axes since the reference; needs no motion."""
        flipped = float(self._polarity.count(-1))
        zoom = float(max(100 * (np.exp(self._log_zoom) - 1), key=abs))
        return (
            self._check("picture-flip", Fault.POLARITY, flipped, "axes", MOST_FLIPPED),
            self._check("picture-zoom", Fault.SCALE, zoom, "%", self._scale_limit),
        )

    def _begin(self, view: View) -> None:
        """Begins another chain, of which nothing is known; a picture without anything in it begins none."""
        self._followed = self._searches = self._covered = 0
        self._covered_ns = None
        self._astray_px = np.zeros(2)
        self._dissolving.restart()
        self._likenesses.clear()
        self._magnification.restart()
        self._double_exposure.restart()
        self._resting.restart()
        self._last = view if comparable(view.small) else None
        self._course = _Course()
        self.linked = self._direct = self._last is not None

    def _go_on(self, view: View, last: View, own: _Course | None) -> None:
        if own is None:
            self._magnification.restart()
        else:
            self._course = own
            self._likenesses.append(self._newest)
            way = own.after(view.t_ns - last.t_ns, last.small.shape[1])
            pressed = pressed_between(self._reference, last, view)
            self._magnification.step(view.t_ns, view.small, way, pressed)
            self._dissolving.note_step(way[0])
        self._last, self._covered_ns = view, None
        if self._unaveraged():
            self._double_exposure.step(view.t_ns, view.small)
        else:
            self._double_exposure.restart()
        self.linked = self._direct = True
        self._followed += 1
        self._searches = self._covered = 0

    def _own_course(self, seen: Observation, view: View, last: View) -> _Course | None:
        """Returns the course by which the picture was followed from the last of the chain; None where it was not."""
        if not seen.followed or seen.warp is None:
            return None
        since_ns = view.t_ns - last.t_ns
        return _Course(seen.warp[0] / seen.image.shape[1] / since_ns, seen.warp[1] / since_ns)

    def _goes_on(self, followed: Array32, view: View) -> bool:
        """Returns whether a picture is as much like the one before as the pictures before it were like theirs.
        followed: the picture before, with its tissue where the registration has it now.
        """
        likeness = likeness_in_place(followed, view.small)
        # The least, because behind a grabber faster than its scanner every second picture differs by noise alone.
        self._newest, self._fell = likeness, min(self._likenesses, default=0.0) - likeness
        return self._fell <= _FELL

    def _stretched(self, followed: Array32, view: View, last: View) -> PictureChange | None:
        """Returns an unnamed change where the picture is stretched, but so little, or in so narrow a window, that the
        chain goes on; it has no name, because a sliding organ also stretches the tissue beside it. followed: as in
        `_goes_on`.
        """
        if self._fell < _FELL_LITTLE:
            return None
        stretch = closest_stretch(followed, view.small, self._aspect, self._least, [(1.0, 1.0)])
        return None if self._change_by(stretch, view, last) is None else PictureChange()

    def _faded(self, view: View) -> PictureChange | None:
        """Returns an unnamed change where a fade ends here; where the hand is still, `DissolvedPicture` names it."""
        if not self._double_exposure.ended:
            return None
        return None if self._dissolving.still(view) else PictureChange()

    def _dissolved(self, view: View) -> PictureChange | None:
        change = self._dissolving.step(view)
        if change is not None:
            self._magnification.restart()
        return change

    def _way(self, view: View, last: View) -> Warp:
        """Returns how far the tissue should have gone since the last picture of the chain, px of the small picture and
        rad: by the tracker, or, where a pose is missing, as it went last.
        """
        since_ns, width_px = view.t_ns - last.t_ns, last.small.shape[1]
        if view.pose is None or last.pose is None:
            return self._course.after(since_ns, width_px)
        moved_mm, turned = predicted_motion(self._reference, last.pose, view.pose)
        lateral, axial = self._reference.polarity
        return moved_mm[:2] * self._px_per_mm * self._reference.polarity, float(turned[2]) * lateral * axial

    def _link(self, view: View, last: View) -> tuple[Array32, Link | None]:
        """Returns the last picture where its tissue is now, and how this one continues it."""
        moved_px, turn_rad = self._way(view, last)
        # A small turn is left to the search for parts, because rotating a picture blurs its speckle.
        turns = abs(turn_rad) * last.small.shape[1] / 2 > _LEFT_PX
        before = carried(last.small, (np.zeros(2), turn_rad), self._aspect) if turns else last.small
        link = link_between(before, view.small, moved_px, self._offset_limit * self._px_per_mm)
        moved = np.round(moved_px) if link is None else link.moved_px
        return carried(before, (moved, 0.0), self._aspect), link

    def _change(self, placed: Array32, view: View, last: View, link: Link | None) -> PictureChange | None:
        """Returns how the picture has changed; None where it has not. placed: the last picture of the chain where its
        tissue is now. What is like it as a whole is neither mirrored nor of a very different depth. A stretch that is
        likely, and not certain, gives an unnamed change.
        """
        stretch = closest_stretch(placed, view.small, self._aspect, self._least)
        whole = link is not None and link.whole
        if whole or (stretch is not None and stretch.certain):
            return self._change_by(stretch, view, last)
        if self._searches >= _SEARCHES:
            return None
        if not searchable(placed, view.small):
            return None
        self._searches += 1
        return flip_or_zoom_of(placed, view.small)

    def _change_by(self, stretch: Stretched | None, view: View, last: View) -> PictureChange | None:
        """Returns the change for a stretch; None where it is too uncertain, or the press of the face explains it."""
        if stretch is None:
            return None
        pressed = float(np.abs(pressed_between(self._reference, last, view)).sum())
        return stretch.change_beyond(self._least, pressed, min(self._likenesses, default=0.0))

    def _take_link(
        self, placed: Array32, view: View, last: View, link: Link | None, own: _Course | None, direct: bool
    ) -> None:
        """Continues the chain where the picture does. One that is covered in part continues it as well, but later
        pictures are not compared with it until it is clear that the cover stays. direct: whether nothing lies between.
        """
        if link is None:
            # With a few wires in water only the registration can decide.
            if own is not None:
                self._go_on(view, last, own)
            return
        self._covered = self._covered + 1 if link.covered else 0
        astray_px = np.zeros(2) if own is not None or link.in_place else link.beside_px
        turned_rad = 0.0 if own is not None else self._turned_rad(placed, view)
        straight = turned_rad is not None and turned_rad <= self._rotation_limit_rad
        there = (straight or turned_rad is None) and self._may_be_tissue(astray_px, view, last)
        # With less speckle, parts of a sheared picture are alike by chance, so it must be shown to be straight.
        hurried = link.hurried and straight and (own is not None or link.in_place)
        if there and (link.whole or self._covered >= _COVERED):
            self._astray_px = self._astray_px + astray_px
            self._go_on(view, last, own)
        elif hurried or (direct and self._swept_past(view, last)):
            self._go_on(view, last, own)
        elif there and link.covered:
            self.linked, self._covered_ns = True, view.t_ns
        if own is None and self._last is view:
            self._dissolving.note_way(link.moved_px)

    def _turned_rad(self, placed: Array32, view: View) -> float | None:
        """Returns the angle by which the picture was turned or sheared, as steered beams shear it; None where too
        little of it is found again.

        Likeness alone let half of the pictures sheared by 7° go on, most of those sheared by 11°, and a quarter of
        those turned by 4°. Turns of the same tissue came to 1.8° at most (study, gesture-hold, seed 1, .13 s apart, 18
        pairs).
        """
        turned_rad = lines_turned(placed, view.small, self._aspect)
        return None if turned_rad is None else float(np.max(np.abs(turned_rad)))

    def _may_be_tissue(self, astray_px: Array, view: View, last: View) -> bool:
        """Returns whether tissue may have gone so far by itself since the last picture, while all breaks of this chain
        together hide no offset beyond its limit; True without poses, which alone tell where it should be.
        """
        if view.pose is None or last.pose is None:
            return True
        most_mm = _TISSUE_MM + _TISSUE_MM_PER_S * (view.t_ns - last.t_ns) / 1e9
        astray_mm, all_mm = (np.abs(px) / self._px_per_mm for px in (astray_px, self._astray_px + astray_px))
        return bool(np.max(astray_mm) <= most_mm and (np.max(all_mm) <= self._offset_limit or not astray_px.any()))

    def _swept_past(self, view: View, last: View) -> bool:
        """Returns whether the hand went out of the plane so fast that no tissue can be in both pictures."""
        if view.pose is None or last.pose is None:
            return False
        way_mm = out_of_plane_mm(self._reference, last.pose, view.pose)
        return way_mm >= max(_SWEPT_MM, _SWEPT_MM_PER_S * (view.t_ns - last.t_ns) / 1e9)

    def _take(self, change: PictureChange, view: View) -> None:
        self._just_changed = self._followed >= _CALM_FRAMES
        self._course = self._course.changed(change)
        self._polarity = (self._polarity[0] * change.polarity[0], self._polarity[1] * change.polarity[1])
        self._log_zoom += np.log(change.zoom)
        self._last = view
        self.linked = self._direct = True
        self._dissolving.restart()
        self._double_exposure.restart()
        self._resting.restart()
        self._followed = self._searches = self._covered = 0

    def _check(self, name: str, fault: Fault, value: float, unit: str, limit: float) -> Check:
        beyond = VerdictKind.NOT_VERIFIED if self._just_changed else VerdictKind.FAULT
        return Check(name, fault, value, 0.0, unit, limit, beyond if abs(value) > limit else VerdictKind.OK)
