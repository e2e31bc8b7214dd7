"""How long the probe was stationary, by tracker and picture together: meanwhile nothing need be shown again.

A probe that is held still shows nothing of its calibration. But while the tracker has the marker body where it was, and
the picture has the tissue where it was, the body sits on the probe as it did, and the picture is as large and as much
mirrored as it was. Both are held against one picture, the anchor, for all of the rest, so that a slip is seen however
slow it is. Where the tissue moves under the probe, as a patient breathes, those pictures count that show it where it
was in the anchor.

A rest shows that nothing has changed from its first picture to its last. So it counts for what was shown as it began,
and no later one does: what was between the two was not seen. A late tracker shows nothing of it at rest, and spoils
nothing: latency counts as watched for as long as the rest lasts.
"""

from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from probewatch.appliance.core.motion import predicted_motion
from probewatch.appliance.core.registration.keyframe import Registration
from probewatch.appliance.core.times import COMPARE_NS, SLOW_BREATH_NS, TREMOR_NS
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import Matrix4

_MOST = 0.25
"""Share of the limits of offset and rotation: how far from the anchor the probe rests, and how far tracker and picture
may disagree. More calls a slow sweep rest, and leaves less room for what a slip adds to a calibration that was shown
with room of its own; less loses a hand whose tremor is .3 mm."""
_IN_PLACE = 0.1
"""Share of the same limits, within which the picture is where it was: if the tracker has left twice in a row, they have
parted. More takes a late tracker in a quick motion for that, less misses a slip under a hand's tremor."""
_ALIKE = 0.9
"""Likeness to the anchor, that bounds what the picture does not show as a way: .46 mm out of the plane, as
`appliance.core.detectors.marker_slip` reckons it, .33 mm on the simulator, or 1.9° of tilt over a picture of 50 mm.
Less bounds it worse, more loses a hand's tremor. Tissue without speckle bounds less; not measured."""
_SAME_MM = 1e-9
"""Within which two poses are one reading: interpolated between two equal readings they differ by rounding."""
_AGAIN_NS, _LOST_NS = 2_000_000_000, 5 * SLOW_BREATH_NS // 2
"""After which another anchor is taken where no picture is like it, though the tracker has the probe there. Before it
was a rest: soon, as that picture may have been of the last motion; but where the picture shows the tissue elsewhere, a
slow breath, as it comes back with the next. After that, two and a half of these, as not each is as deep. Longer begins
no rest where the tissue lies otherwise for good. 2 s for all began a rest within a second of the hand's in 3 of 16
breathing sessions, 6 s in 15, chosen on eight of them (`probewatch study`, gesture-hold, seeds 1 to 16)."""
_BLIND_NS = 1_000_000_000
"""For how long, before the tracker leaves, no picture was like the anchor: then the picture could not distinguish a
hand that went on from a marker body that slipped, and they count as parted. Shorter does so where a hand turns back in
a gesture, longer lets a slip soon after the hand's rest pass for the hand's
(tests/appliance/core/quality/test_stationary_time.py)."""
_STIRS, _STIRRED_MM, _STIRS_MEAN = 1 / 3, 0.3, 20
"""Share of what the tracker moves by in the plane from comparison to comparison, root of the mean square, that the
picture must move by, once the tracker moves by more than this; and comparisons in the mean, 3 s. A hand's tremor stirs
both: a picture that it does not stir was frozen, though noise lies over it. A higher share or a lower way ends the rest
of a probe in a holder before a noisy tracker, a lower share or a higher way lets a frozen picture rest with a calm hand
(tests/appliance/core/quality/test_stationary_time.py)."""
_NEAR_NS, _LEAST_NS = 6_000_000_000, 1_000_000_000
"""Within which of what was shown the rest must begin, and how long it must be to be one: what is shown is as old as the
middle of a gesture, and that motion goes on to the rest. Less gives a rest after a gesture nothing; more counts what a
sweep that shows nothing may hide. Where the hand turns back it is at one place for half a second."""
_MOST_SPANS = 100
"""Kept, the newest. None but the last is shorter than a second, so these reach back by more than any age."""


class Pictures(Protocol):
    """The pictures as `RealTimeTracker` keeps them."""

    def take_anchor(self) -> None: ...

    def against_anchor(self) -> Registration | None: ...


@dataclass(slots=True)
class _Span:
    """First and last picture that show the same. parted_ns: when tracker and picture had last parted before."""

    start_ns: int
    end_ns: int
    parted_ns: int

    @property
    def lasted(self) -> bool:
        """Whether it is long enough to be a rest."""
        return self.end_ns - self.start_ns > _LEAST_NS


class StationaryTime:
    """Takes every picture with its pose, and gives the time for which the probe was stationary since any moment."""

    def __init__(self, limits: Limits, reference: Calibration) -> None:
        self._reference = reference
        turn = np.deg2rad(limits.rotation_deg)
        self._limits = np.array([*[limits.offset_mm] * 3, *[turn] * 3])
        self._most_ns = round(limits.at_rest_s * 1e9)
        self.restart()

    def restart(self) -> None:
        """Whatever was before says nothing of what comes."""
        self._spans: deque[_Span] = deque(maxlen=_MOST_SPANS)
        self._anchor: Matrix4 | None = None
        self._pose: Matrix4 | None = None
        self._parting = self._elsewhere = False
        self._before: tuple[Array, Array] | None = None
        self._stirred, self._stirs = np.zeros(2), 0
        self._now_ns = self._still_ns = self._compared_ns = self._parted_ns = 0

    def forget(self, since_ns: int) -> None:
        """What was at or after since_ns was stamped wrongly."""
        kept, parted_ns = [span for span in self._spans if span.end_ns < since_ns], self._parted_ns
        self.restart()
        self._spans.extend(kept)
        self._parted_ns = min(parted_ns, since_ns)

    def step(self, t_ns: int, pose: Matrix4, pictures: Pictures) -> None:
        """Take the next picture, the latest of `pictures`. pose: (4, 4) sensor → tracker at its time, mm."""
        self._now_ns = t_ns
        repeated = self._pose is not None and np.allclose(pose, self._pose, rtol=0.0, atol=_SAME_MM)
        self._pose = pose
        if repeated or not self._most_ns:
            return
        if self._anchor is None:
            self._begin(t_ns, pose, pictures)
            return
        probe = np.concatenate(predicted_motion(self._reference, self._anchor, pose)) / self._limits
        if _within(probe, _MOST):
            self._still_ns = t_ns
        if t_ns - self._compared_ns >= COMPARE_NS:
            self._compared_ns = t_ns
            self._compare(t_ns, probe, pictures)
        end_ns = self._spans[-1].end_ns
        if not self._lasts:
            if self._still_ns - end_ns > _BLIND_NS:
                self._parted_ns = t_ns
            self._begin(t_ns, pose, pictures)
        elif self._still_ns == t_ns and t_ns - end_ns > self._timeout_ns:
            self._begin(t_ns, pose, pictures)

    def since(self, t_ns: int, *, lasting: bool = False) -> int:
        """How long, ns, nothing has changed since t_ns, by the rest that was on then or the first that began soon
        after; `Limits.at_rest_s` at most. 0 where tracker and picture had parted in between. lasting: 0 also once that
        rest is over.
        """
        first = next((span for span in self._spans if span.lasted and span.end_ns > t_ns), None)
        if first is None or t_ns < max(first.parted_ns, first.start_ns - _NEAR_NS):
            return 0
        if lasting and not (first is self._spans[-1] and self._lasts):
            return 0
        return min(first.end_ns - max(first.start_ns, t_ns), self._most_ns)

    @property
    def spans(self) -> tuple[tuple[int, int], ...]:
        """First and last picture of each rest that is remembered, ns; the last may not be long enough yet to be one."""
        return tuple((span.start_ns, span.end_ns) for span in self._spans)

    @property
    def _timeout_ns(self) -> int:
        """How long the anchor waits for a picture like it."""
        if self._spans[-1].lasted:
            return _LOST_NS
        return SLOW_BREATH_NS if self._elsewhere else _AGAIN_NS

    @property
    def _lasts(self) -> bool:
        """Whether the probe is where the anchor is, by the tracker."""
        return self._anchor is not None and self._now_ns - self._still_ns <= TREMOR_NS

    def _begin(self, t_ns: int, pose: Matrix4, pictures: Pictures) -> None:
        """Another rest, if it is to be one; the one before has ended with its last picture."""
        pictures.take_anchor()
        self._anchor, self._before, self._stirs, self._elsewhere = pose, None, 0, False
        self._still_ns = self._compared_ns = t_ns
        if self._spans and not self._spans[-1].lasted:
            self._spans.pop()
        self._spans.append(_Span(t_ns, t_ns, self._parted_ns))

    def _compare(self, t_ns: int, probe: Array, pictures: Pictures) -> None:
        """What cannot be compared, NaN among it, shows no rest."""
        found = pictures.against_anchor()
        parting, self._parting = self._parting, False
        if found is None:
            return
        apart = self._apart(found, probe)
        self._elsewhere |= not _within(apart[[0, 1, 5]], _MOST)
        if not found.correlation >= _ALIKE:
            return
        if not _within(probe, _MOST):
            self._parting = _within((probe - apart)[[0, 1, 5]], _IN_PLACE)
            if self._parting and parting:
                self._parted_ns = t_ns
        elif _within(apart, _MOST) and self._stirs_both(probe, probe - apart):
            self._spans[-1].end_ns = t_ns

    def _stirs_both(self, probe: Array, picture: Array) -> bool:
        """Whether the picture moves as the tracker says that the hand stirs it. (6,) of the limits from the anchor."""
        now = probe[:2] * self._limits[:2], picture[:2] * self._limits[:2]
        before, self._before = self._before, now
        if before is not None:
            stirred = np.array([np.sum((a - b) ** 2) for a, b in zip(now, before, strict=True)])
            self._stirs = min(self._stirs + 1, _STIRS_MEAN)
            self._stirred = self._stirred + (stirred - self._stirred) / self._stirs
        tracker, seen = self._stirred
        calm = self._stirs < _STIRS_MEAN or tracker <= _STIRRED_MM**2
        return bool(calm or seen >= _STIRS**2 * tracker)

    def _apart(self, found: Registration, probe: Array) -> Array:
        """(6,) of the limits: in the plane tracker less picture; out of it, where the picture shows no way, tracker."""
        lateral, axial = self._reference.polarity
        moved_mm = found.u_px * self._reference.scale_mm_per_px * self._reference.polarity
        apart = probe.copy()
        apart[[0, 1, 5]] -= np.array([*moved_mm, found.alpha_rad * lateral * axial]) / self._limits[[0, 1, 5]]
        return apart


def _within(values: Array, most: float) -> bool:
    """Whether no value is larger than `most`, whatever its sign; NaN is."""
    return bool((np.abs(values) <= most).all())
