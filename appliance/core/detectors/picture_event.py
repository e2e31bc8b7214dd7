"""Sees the picture's geometry change between two frames: a flip or a new depth needs no motion to be seen.

Between successive live frames the picture hardly changes. Where it suddenly does, and the frame before explains it once
it is mirrored, zoomed or stretched along one axis, the operator (or the frame grabber) has changed the geometry that
the calibration was made for.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from math import sqrt
from statistics import fmean

import cv2
import numpy as np

from appliance.core.detectors.detector import Detector, Observation
from appliance.core.detectors.polarity import MOST_FLIPPED
from appliance.core.detectors.stretch import stretch_between, warped
from appliance.core.registration.keyframe import warp_matrix
from appliance.core.registration.pyramid import Array32
from appliance.core.registration.realtime_tracker import Warp
from appliance.types import Check, Fault, VerdictKind
from drivers.rigid import Array
from drivers.samples import GreyImage

FINDS = (Fault.POLARITY, Fault.SCALE)

_SMALL_PX = 160
"""Columns in which pictures are compared. More asks for a zoom that is nearer and costs time for each that is tried;
fewer leave too little speckle to tell a mirrored picture from another.
"""
_SHADE_PX = 5.0
"""Sigma of what counts as shade, px of the small picture: wider than its speckle. More lets a bright half match any."""
_LEAST_LIKENESS, _BETTER_BY = 0.55, 0.25
"""Correlation of the changed picture, and how much more than that of the unchanged one, also where a fast hand moved
it. Less explains a new scene as a flip or zoom; more misses those with an overlay. In a prototype, not here, a
mirrored picture came to .92 where the unchanged had .02.
"""
_SLACK_PX = 3
"""px of the small picture by which the hand may go elsewhere than it went last: 12 px of 640. More tries more places by
chance. Held against where the hand would be, .99 of mirrored pictures were seen in a gesture of up to 7.8 px a picture,
against where it was .35 (`probewatch study`, gesture, seeds 1 and 2).
"""
_CALM_FRAMES = 5
"""Pictures that must have been followed before. Fewer explain what comes after a scene that was lost anyway; more miss
two events in close succession. Not measured.
"""
_GAP_NS = 250_000_000
"""Pictures further apart say nothing about one another: a hand has gone elsewhere."""
_ZOOMS = tuple(float(z) for z in np.exp(np.arange(-0.405, 0.4051, 0.015)) if abs(z - 1) > 0.02)
"""Magnifications that are tried, 1 ÷ 1.5 … 1.5: the next depth setting. 1.5 % moves the side of 160 columns by one, so
finer steps only cost time; up to 2 % is no new setting.
"""
_FELL = 0.12
"""Fall of the likeness of the picture before, carried on as the registration has it, below that of the last pictures,
from which one that was followed is asked for a stretch. Of healthy motion one in a hundred falls so far, of pictures
stretched by 6 % all (six sessions of two seconds). Less asks more often, 20 ms each time, more misses small ones."""
_LEAST_STRETCH, _STRETCH_BETTER_BY = 0.035, 0.15
"""Magnification along an axis from 1, and how much more like the stretched picture must be than the unchanged one."""
_STARTS = tuple((across, down) for across in (1.0, 0.92, 1.08) for down in (1.0, 0.92, 1.08))
"""Magnifications about which a stretch is looked for: each finds those within 8 %, so all together 16 %."""
_FLIPS = {(-1, 1): 1, (1, -1): 0, (-1, -1): -1}


@dataclass(frozen=True, slots=True)
class PictureChange:
    """What happened to the picture since the one before: polarity ±1 and magnification, each (lateral, axial)."""

    polarity: tuple[int, int] = (1, 1)
    zoom: tuple[float, float] = (1.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Course:
    """Of the tissue in the picture. per_ns: (2,) widths of the picture, turn_per_ns: rad."""

    per_ns: Array = field(default_factory=lambda: np.zeros(2))
    turn_per_ns: float = 0.0

    def carried(self, image: Array32, ns: int, aspect: float) -> Array32:
        """The picture as it is after so long."""
        M = warp_matrix(self.turn_per_ns * ns, aspect)
        middle = (np.array(image.shape[::-1]) - 1) / 2
        shift = middle + self.per_ns * ns * image.shape[1] - M @ middle
        size = (image.shape[1], image.shape[0])
        return np.asarray(cv2.warpAffine(image, np.column_stack([M, shift]), size), dtype=np.float32)

    def changed(self, change: PictureChange) -> "_Course":
        """The same in the picture as it is now."""
        turned = self.turn_per_ns * change.polarity[0] * change.polarity[1]
        return _Course(self.per_ns * change.polarity * np.array(change.zoom), turned)


class PictureEvent(Detector):
    """Adds up the changes since the reference was in force.

    A change is named once the picture after it is no change back: one spoilt picture withdraws the OK, and alarms
    nobody.
    """

    def __init__(self, scale_limit_percent: float, aspect: float) -> None:
        """aspect: λ_axial ÷ λ_lateral."""
        self._scale_limit, self._aspect = scale_limit_percent, aspect
        self._before: Array32 | None = None
        self._course = _Course()
        self._before_ns = 0
        self._followed = 0
        self._likenesses: deque[float] = deque(maxlen=_CALM_FRAMES)
        self._just_changed = False
        self._polarity = (1, 1)
        self._log_zoom = np.zeros(2)

    def see(self, seen: Observation) -> bool:
        """See Detector."""
        if seen.repeated:
            return False
        return self.step(seen.t_ns, seen.image, seen.followed, seen.warp) is not None

    def step(self, t_ns: int, image: GreyImage, followed: bool, warp: Warp | None = None) -> PictureChange | None:
        """The change between the picture before, (h, w) uint8, and this one; None where there was none.

        t_ns: of the picture; after a gap the two say nothing about one another. followed: the Real-time Tracker could
        register the picture, so it is neither mirrored nor zoomed by much. warp: as in `Observation`.
        """
        small = _small(image)
        before, self._before = self._before, small
        gap_ns, self._before_ns = t_ns - self._before_ns, t_ns
        if gap_ns > _GAP_NS:
            self._followed, self._just_changed = 0, False
            self._likenesses.clear()
        calm, self._followed = self._followed >= _CALM_FRAMES, self._followed + 1 if followed else 0
        known, self._just_changed = calm or self._just_changed, False
        if before is None or before.shape != small.shape or gap_ns <= 0:
            return None
        own = None if warp is None else _Course(warp[0] / image.shape[1] / gap_ns, warp[1] / gap_ns)
        if followed and (own is None or self._goes_on(own, before, small, gap_ns, known)):
            return None
        expected = self._course.carried(before, gap_ns, self._aspect)
        change = self._change(expected, before, small, followed) if known else None
        if change is not None:
            self._take(change, calm)
        elif own is not None:
            self._course = own
        return change

    def _goes_on(self, own: _Course, before: Array32, now: Array32, gap_ns: int, known: bool) -> bool:
        """Whether a picture that was followed is as much like the one before as those before it were. own: as it was
        followed.
        """
        likeness = _likeness_in_place(own.carried(before, gap_ns, self._aspect), now)
        fell = known and likeness < fmean(self._likenesses or [0.0]) - _FELL
        self._likenesses.append(likeness)
        if not fell:
            self._course = own
        return not fell

    def _change(self, expected: Array32, before: Array32, now: Array32, followed: bool) -> PictureChange | None:
        """What was followed is neither mirrored nor another depth by far."""
        stretch = _stretch(expected, now, self._aspect)
        return stretch if stretch is not None or followed else _explanation(expected, before, now)

    def _take(self, change: PictureChange, calm: bool) -> None:
        self._just_changed = calm
        self._followed = 0
        self._course = self._course.changed(change)
        self._polarity = (self._polarity[0] * change.polarity[0], self._polarity[1] * change.polarity[1])
        self._log_zoom += np.log(change.zoom)

    def forgive(self, shows: Callable[[Fault], bool], until_ns: int) -> None:
        """See Detector: the sum of events was wrong or has been undone elsewhere."""
        if shows(Fault.POLARITY):
            self._polarity = (1, 1)
        if shows(Fault.SCALE):
            self._log_zoom = np.zeros(2)

    def checks(self) -> tuple[Check, ...]:
        """Flipped axes, and magnification of the axis that has more, since the reference; they need no motion."""
        flipped = float(self._polarity.count(-1))
        zoom = float(max(100 * (np.exp(self._log_zoom) - 1), key=abs))
        return (
            self._check("picture-flip", Fault.POLARITY, flipped, "axes", MOST_FLIPPED),
            self._check("picture-zoom", Fault.SCALE, zoom, "%", self._scale_limit),
        )

    def _check(self, name: str, fault: Fault, value: float, unit: str, limit: float) -> Check:
        beyond = VerdictKind.NOT_VERIFIED if self._just_changed else VerdictKind.FAULT
        return Check(name, fault, value, 0.0, unit, limit, beyond if abs(value) > limit else VerdictKind.OK)


def _small(image: GreyImage) -> Array32:
    """About 160 columns, coarse enough that a zoom need not be exact, and without broad shade and gain."""
    share = min(1.0, _SMALL_PX / image.shape[1])
    size = (max(round(image.shape[1] * share), 1), max(round(image.shape[0] * share), 1))
    small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
    return small - np.asarray(cv2.GaussianBlur(small, (0, 0), _SHADE_PX), dtype=np.float32)


def _explanation(expected: Array32, before: Array32, now: Array32) -> PictureChange | None:
    """The change that makes what was expected like what is there; None where a mere shift of what was before does
    nearly as well."""
    usual = max(_likeness(expected, now), _shift_likeness(before, now))
    candidates = [
        (_likeness(_mirrored(expected, code), now), PictureChange(polarity)) for polarity, code in _FLIPS.items()
    ]
    candidates += [(_likeness(_zoomed(expected, zoom), now), PictureChange(zoom=(zoom, zoom))) for zoom in _ZOOMS]
    likeness, change = max(candidates, key=lambda candidate: candidate[0])
    return change if likeness > max(usual + _BETTER_BY, _LEAST_LIKENESS) else None


def _stretch(expected: Array32, now: Array32, aspect: float) -> PictureChange | None:
    """The stretch that makes what was expected like what is there; None where none does, or a shift nearly as well."""
    plain = _likeness(expected, now)
    best, change = max(plain + _STRETCH_BETTER_BY, _LEAST_LIKENESS), None
    for start in _STARTS:
        found = stretch_between(expected, now, aspect, start)
        if found is None or np.all(np.abs(found.magnification - 1) < _LEAST_STRETCH):
            continue
        likeness = _likeness(warped(expected, found.warp), now)
        if likeness > best:
            best, change = likeness, PictureChange(zoom=(float(found.magnification[0]), float(found.magnification[1])))
    return change


def _shift_likeness(before: Array32, now: Array32) -> float:
    """Best correlation of the middle of the picture before with any place in this one: what a fast hand explains."""
    margin_y, margin_x = before.shape[0] // 4, before.shape[1] // 4
    middle = before[margin_y : before.shape[0] - margin_y, margin_x : before.shape[1] - margin_x]
    if middle.std() == 0:
        return 1.0
    return float(cv2.matchTemplate(now, middle, cv2.TM_CCOEFF_NORMED).max())


def _mirrored(image: Array32, code: int) -> Array32:
    return np.asarray(cv2.flip(image, code), dtype=np.float32)


def _zoomed(image: Array32, zoom: float) -> Array32:
    """Magnified about the middle of the top edge, where the probe face stays when the depth setting changes."""
    middle = (image.shape[1] - 1) / 2
    return warped(image, np.array([[zoom, 0, middle * (1 - zoom)], [0, zoom, 0]]))


def _likeness_in_place(a: Array32, b: Array32) -> float:
    """As `_likeness`, where the place is known."""
    rows, columns = a.shape[0] // 10, a.shape[1] // 10
    middle = np.s_[rows : a.shape[0] - rows, columns : a.shape[1] - columns]
    own, other = (image[middle].ravel() - image[middle].mean() for image in (a, b))
    power = float(own @ own) * float(other @ other)
    return float(own @ other) / sqrt(power) if power > 0 else 1.0


def _likeness(a: Array32, b: Array32) -> float:
    """Correlation of the middle of a, where overlays are rare, with its place in b or a few pixels beside it."""
    rows, columns = a.shape[0] // 10, a.shape[1] // 10
    slack_rows, slack_columns = min(_SLACK_PX, rows), min(_SLACK_PX, columns)
    middle = a[rows : a.shape[0] - rows, columns : a.shape[1] - columns]
    around = b[
        rows - slack_rows : b.shape[0] - rows + slack_rows,
        columns - slack_columns : b.shape[1] - columns + slack_columns,
    ]
    if middle.std() == 0 or around.std() == 0:
        return 1.0
    return float(cv2.matchTemplate(around, middle, cv2.TM_CCOEFF_NORMED).max())
