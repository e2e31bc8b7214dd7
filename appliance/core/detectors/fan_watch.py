"""Detects from the borders of a convex picture that a grabber or the depth shifts or stretches it, without motion.

The fan is compared with the fan at the time when motion last showed the scales. With the radius of the probe's face it
also yields the scales themselves, and whether motion agrees with them.
"""

from collections.abc import Callable, Generator, Sequence
from math import isfinite

import numpy as np

from probewatch.appliance.core.detectors.detector import Detector
from probewatch.appliance.core.detectors.fan import Fan, fan_near, scale_sigmas, searching
from probewatch.appliance.core.detectors.fan_borders import (
    ASPECT,
    BOTTOM,
    FACE,
    FACE_RADIUS,
    LEFT,
    RIGHT,
    joined,
    window,
)
from probewatch.appliance.core.detectors.fan_change import FanChange, change_between
from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration, Check, Fault, VerdictKind
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import GreyImage

REPORTS_FAULTS = (Fault.SCALE,)

_STRETCH_PERCENT, _SHIFT_PX = 0.4, 3.0
"""Stretch and shift from which the picture is another, whatever the limits tolerate: no grabber is set wrong by less.
1 % and 5 px are found for certain. Lower values ask more of pictures whose borders are seen in parts."""
_LOOKS_NS = 350_000_000
"""ns between two looks, which cost .15 ms each. A shorter time costs more; a longer one names a change later."""
_CONFIRMS_NS, _CONFIRMATIONS = 100_000_000, 3
"""ns between looks at a change, which cost 2 ms each, and how many must agree. With fewer, what moves past is named."""
_SEARCHES_NS, _LONGEST_NS = 500_000_000, 10_000_000_000
"""ns between two searches for a fan that is not known, which cost 10 ms each: at first, and in the end where none is
found, as in a rectangular picture. Shorter times cost more; longer ones find a fan later that text or a menu covered.
"""
_AGAIN_NS, _LONGEST_REST_NS = 500_000_000, 4_000_000_000
"""ns, least and most, until borders that were elsewhere without a stretch are measured again, as while a face comes off
the skin; the time doubles while no other border is elsewhere. Shorter times cost more; longer ones delay the name of a
change that comes meanwhile."""
_GONE_NS = 10_000_000_000
"""ns without the known fan after which another is looked for: a sector may have been made narrower. A shorter time
gives up a fan that is hidden for a while; a longer one leaves changes unseen."""
_REACH_PX, _PLACES = 6, 48
"""px beside its place within which a border is looked for at each look, and places along each: more cost time."""
_NEAR_PX, _HELD = 0.8, 0.6
"""px within which a border must be where it was, and the share of the usual number of its points that must be, for it
to be the same. Less distance takes a codec for a change; more misses 1 % of a small picture."""
_FACE_PERCENT = 1.0
"""%, sigma of a radius in a calibration file: lens and gel are 0.3 to 0.6 mm in front of the elements, whose radius is
40 to 60 mm. Not measured."""


_PERCENT = np.array([100.0, 100.0, 1.0, 1.0])
"""Factors that convert the numbers of a change to % and px."""
_NOT_SEEN = np.full(2, np.nan)
"""Values of the checks while the fan is hidden."""


class _Outline:
    """Holds where the borders of a fan lie in its pictures, to test quickly whether they are still there."""

    def __init__(self, fan: Fan, image: GreyImage) -> None:
        self.fan = fan
        windows = [window(fan.numbers, border, image.shape, _REACH_PX, _PLACES) for border in fan.borders]
        self._window = joined(windows)
        self._starts = np.cumsum([0, *(one.at.size for one in windows[:-1])])
        self._least = _HELD * self._near(image)

    def missing(self, image: GreyImage) -> frozenset[int]:
        """Returns the borders that are not where they were."""
        gone = self._near(image) < self._least
        return frozenset(border for border, one in zip(self.fan.borders, gone, strict=True) if one)

    def _near(self, image: GreyImage) -> Array:
        """Returns the number of places, (n,), at which each border is where it was."""
        near = self._window.near(image, self.fan.black, _NEAR_PX)
        return np.asarray(np.add.reduceat(near.astype(float), self._starts))


class FanWatch(Detector):
    """Compares the fan with the fan at the time when motion last showed the scales.

    It states nothing else about the calibration, and nothing at all where no fan, or not enough of it, is seen.
    motion: returns the checks of the latest solution.
    """

    def __init__(self, reference: Calibration, limits: Limits, motion: Callable[[], Sequence[Check]]) -> None:
        self._reference, self._limits, self._motion = reference, limits, motion
        self._forget()

    def _forget(self) -> None:
        self._shown: Fan | None = None
        self._known: Fan | None = None
        self._outline: _Outline | None = None
        self._change: FanChange | None = None
        self._search: Generator[None, None, Fan | None] | None = None
        self._candidate: tuple[Fan, int] | None = None
        self._moving: dict[str, Check] = {}
        self._latest_checks: tuple[Check, ...] = ()
        self._visible = False
        self._missing: frozenset[int] = frozenset()
        self._wait_ns = _SEARCHES_NS
        self._next_ns = self._again_ns = self._seen_ns = self._known_ns = 0

    def see(self, seen: Observation) -> bool:
        """See Detector."""
        if seen.repeated or (self._search is None and 0 < self._next_ns - seen.t_ns <= _LONGEST_NS):
            return False
        image = seen.image[::-1] if self._reference.polarity[1] < 0 else seen.image
        changed = self._step(seen.t_ns, image)
        self._latest_checks = self._checks_now()
        return changed

    def _step(self, t_ns: int, image: GreyImage) -> bool:
        if self._search is not None:
            return self._go_on(t_ns, image)
        if self._outline is not None:
            return self._look(t_ns, image, self._outline)
        if self._candidate is not None:
            about = self._candidate[0]
            self._learn(t_ns, image, fan_near(image, about.numbers, about.black))
        else:
            self._search = searching(image)
        return False

    def pause(self, t_ns: int) -> None:
        """See Detector. A search or a confirmation under way begins again."""
        self._search = self._candidate = None

    def on_verified(self, shows: Callable[[Fault], bool], until_ns: int) -> None:
        """See Detector. The current fan becomes that of the reference, unless it appeared after the motion."""
        if self._reference.face_radius_mm is not None:
            self._moving = {check.name: check for check in self._motion()}
        fits = self._known is not None and self._visible and self._known_ns <= until_ns
        if fits and self._known is not self._shown and shows(Fault.SCALE):
            self._answer(shows(Fault.OFFSET))
        self._latest_checks = self._checks_now()

    def _answer(self, offset_shown: bool) -> None:
        """Records that motion shows the scales with the current fan."""
        assert self._known is not None
        if self._shown is None or offset_shown:
            self._shown = self._known
            self._change = self._between(self._known, self._known)

    def checks(self) -> tuple[Check, ...]:
        """Returns the stretch, %, and shift, px, since motion showed the scales; both are NaN while the fan is hidden.

        Where the radius of the face is known, the scales themselves, %, and their difference from those of motion
        follow. Returns none where no fan is known.
        """
        return self._latest_checks

    def _checks_now(self) -> tuple[Check, ...]:
        if self._known is None:
            return ()
        return (*self._since_shown(), *(self._absolute(self._known) if self._visible else ()))

    def _look(self, t_ns: int, image: GreyImage, outline: "_Outline") -> bool:
        """Tests whether the borders are where they were, measures what is elsewhere, and returns whether it changed."""
        missing = outline.missing(image)
        self._next_ns = t_ns + _LOOKS_NS
        self._note(
            t_ns, LEFT not in missing and RIGHT not in missing and (FACE not in missing or BOTTOM not in missing)
        )
        if self._known is None:
            return False
        if not missing and self._candidate is None:
            if t_ns >= self._again_ns:
                self._missing = frozenset()
            return False
        if self._candidate is None and missing <= self._missing and t_ns < self._again_ns:
            return False
        about = self._candidate[0] if self._candidate is not None else outline.fan
        found = fan_near(image, about.numbers, about.black)
        if found is None and LEFT in missing and RIGHT in missing:
            self._rest(t_ns, missing)
            self._search = searching(image, about.black)
            return False
        return self._judge(t_ns, image, found, missing)

    def _note(self, t_ns: int, visible: bool) -> None:
        """Notes whether enough of the fan is seen for a check, and forgets a fan that was not seen for a long time."""
        self._visible = visible
        self._seen_ns = t_ns if visible else self._seen_ns
        if not 0 <= t_ns - self._seen_ns <= _GONE_NS:
            self._forget()

    def _rest(self, t_ns: int, missing: frozenset[int]) -> None:
        """Sets the time until which borders that are elsewhere are not measured again."""
        known = missing <= self._missing
        self._wait_ns = min(2 * self._wait_ns, _LONGEST_REST_NS) if known else _AGAIN_NS
        self._missing, self._again_ns = self._missing | missing, t_ns + self._wait_ns

    def _go_on(self, t_ns: int, image: GreyImage) -> bool:
        """Continues the search for a fan, which takes several pictures; returns whether it shows a change."""
        assert self._search is not None
        try:
            next(self._search)
        except StopIteration as end:
            self._search = None
            if self._outline is not None:
                return self._judge(t_ns, image, end.value, self._missing)
            self._learn(t_ns, image, end.value)
        return False

    def _learn(self, t_ns: int, image: GreyImage, found: Fan | None) -> None:
        """Takes a fan as known once enough looks in a row agree on it."""
        count = 0 if found is None else self._agreeing(found)
        if found is None:
            self._candidate, self._next_ns = None, t_ns + self._wait_ns
            self._wait_ns = min(2 * self._wait_ns, _LONGEST_NS)
        elif count < _CONFIRMATIONS:
            self._next_ns = t_ns + _CONFIRMS_NS
        else:
            self._take(t_ns, image, found)

    def _agreeing(self, found: Fan) -> int:
        """Returns the number of looks in a row, this one included, that have seen the same fan elsewhere."""
        before, count = self._candidate or (found, 0)
        count = count + 1 if self._alike(before, found) else 1
        self._candidate = found, count
        return count

    def _judge(self, t_ns: int, image: GreyImage, found: Fan | None, missing: frozenset[int]) -> bool:
        """Returns whether enough looks in a row show borders elsewhere as those of a stretched or shifted picture."""
        change = None if found is None or self._known is None else self._between(self._known, found)
        if found is None or change is None or not self._certain(change):
            self._candidate = None
            self._note(t_ns, change is not None)
            self._rest(t_ns, missing)
            return False
        if self._agreeing(found) < _CONFIRMATIONS:
            self._next_ns = t_ns + _CONFIRMS_NS
            return False
        self._take(t_ns, image, found)
        return True

    def _take(self, t_ns: int, image: GreyImage, found: Fan) -> None:
        """Makes this the known fan from now on."""
        self._known, self._known_ns, self._outline = found, t_ns, _Outline(found, image)
        self._change = None if self._shown is None else self._between(self._shown, found)
        self._candidate, self._missing, self._wait_ns = None, frozenset(), _AGAIN_NS
        self._next_ns, self._again_ns = t_ns + _LOOKS_NS, t_ns
        self._note(t_ns, visible=True)

    def _between(self, before: Fan, now: Fan) -> FanChange | None:
        return change_between(before, now, self._reference.image_size_px)

    def _alike(self, before: Fan, now: Fan) -> bool:
        change = self._between(before, now)
        return change is not None and not self._certain(change)

    def _certain(self, change: FanChange) -> bool:
        """Returns whether the picture has certainly changed."""
        room = self._limits.confidence_sigma * change.sigmas
        beyond = np.abs(np.concatenate([100 * change.stretch, change.shift_px])) - room * _PERCENT
        return bool(np.any(beyond > [_STRETCH_PERCENT, _STRETCH_PERCENT, _SHIFT_PX, _SHIFT_PX]))

    def _since_shown(self) -> tuple[Check, ...]:
        if self._change is None:
            return ()
        stretch, shift_px = 100 * np.expm1(self._change.stretch), self._change.shift_px
        sigmas = self._change.sigmas * _PERCENT
        if not self._visible:
            stretch, shift_px = _NOT_SEEN, _NOT_SEEN
        return (
            self._check("fan-stretch", stretch, sigmas[:2], "%", _STRETCH_PERCENT),
            self._check("fan-shift", shift_px, sigmas[2:], "px", _SHIFT_PX),
        )

    def _absolute(self, known: Fan) -> tuple[Check, ...]:
        """Returns checks of the scales by the radius of the face, against the reference and against motion."""
        face_mm = self._reference.face_radius_mm
        if face_mm is None:
            return ()
        scales = face_mm / known.numbers[FACE_RADIUS] * np.array([known.numbers[ASPECT], 1.0])
        value = 100 * (scales / self._reference.scale_mm_per_px - 1)
        sigma = np.hypot(100 * scale_sigmas(known), _FACE_PERCENT)
        limit = self._limits.scale_percent
        checks = [self._check("fan-scale", value, sigma, "%", limit)]
        moving = [self._moving.get(name) for name in ("scale-lateral", "scale-axial")]
        if all(one is not None and isfinite(one.value) for one in moving):
            measured = [one for one in moving if one is not None]
            beside = value - [one.value for one in measured]
            doubt = np.hypot(sigma, [one.sigma for one in measured])
            checks.append(self._check("fan-motion", beside, doubt, "%", limit, Fault.AGREEMENT))
        return tuple(checks)

    def _check(
        self, name: str, values: Array, sigmas: Array, unit: str, limit: float, fault: Fault = Fault.SCALE
    ) -> Check:
        """Returns the check of the axis that is further off; a check of AGREEMENT never fails."""
        axis = int(np.argmax(np.abs(values)))
        value, sigma = float(values[axis]), float(sigmas[axis])
        room = self._limits.confidence_sigma * sigma
        verdict = VerdictKind.OK
        if not abs(value) + room <= limit:
            fails = abs(value) - room > limit and fault is not Fault.AGREEMENT
            verdict = VerdictKind.FAULT if fails else VerdictKind.NOT_VERIFIED
        return Check(name, fault, value, sigma, unit, limit, verdict)
