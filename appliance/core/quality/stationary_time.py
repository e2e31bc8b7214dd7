"""Measures how long the probe was stationary, by tracker and picture together: meanwhile nothing need be shown again.

A probe that is held still shows nothing of its calibration. But while the tracker reports the marker body where it was,
and the picture shows the tissue where it was, the body sits on the probe as before, and the size and the mirroring of
the picture are as before. Both are compared with one picture, the anchor, throughout the rest, so that a slip is seen
however slow it is. Where the tissue moves under the probe, as a patient breathes, only those pictures count that show
it where it was in the anchor.

A rest shows that nothing has changed from its first picture to its last. It therefore counts for what had been shown
when it began, and no later rest does, because what happened between the two was not seen. A rest shows nothing of a
late tracker, and a late tracker does not spoil it: latency counts as watched for as long as the rest lasts.
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
"""Share of the limits of offset and rotation: how far from the anchor a resting probe may be, and how far tracker and
picture may disagree. More counts a slow sweep as rest, and leaves less room for what a slip adds to a calibration that
was shown with room of its own; less loses a hand whose tremor is .3 mm."""
_IN_PLACE = 0.1
"""Share of the same limits within which the picture is where it was. If the tracker shows the probe elsewhere
meanwhile, twice in a row, they have parted. More takes a late tracker in a quick motion for that, less misses a slip
under a hand's tremor."""
_ALIKE = 0.9
"""Correlation with the anchor that bounds what the picture does not show as a displacement: .46 mm out of the plane, by
the model of `appliance.core.detectors.marker_slip`, .33 mm on the simulator, or 1.9° of tilt over a picture of 50 mm.
Less bounds it less tightly, more loses a hand's tremor. Tissue without speckle bounds less; not measured."""
_SAME_MM = 1e-9
"""Tolerance for two poses to be one reading: interpolated between two equal readings, they differ by rounding."""
_AGAIN_NS, _LOST_NS = 2_000_000_000, 5 * SLOW_BREATH_NS // 2
"""Times, ns, after which another anchor is taken where no picture resembles the present one although the tracker has
the probe there. Before a rest has formed, the time is short, because the anchor may belong to the last motion; but
where the picture shows the tissue elsewhere, it is one slow breath, because the tissue returns with the next. After
that, it is two and a half of these, because not every breath is as deep. Longer begins no rest where the tissue has
moved for good. 2 s for all began a rest within a second of the hand's in 3 of 16 breathing sessions, 6 s in 15, chosen
on eight of them (`probewatch study`, gesture-hold, seeds 1 to 16)."""
_BLIND_NS = 1_000_000_000
"""Time, ns, without a picture like the anchor before the tracker leaves, beyond which the two count as parted: the
picture could not distinguish a hand that moved on from a marker body that slipped. Shorter does so where a hand turns
back in a gesture, longer lets a slip soon after the hand's rest pass for the hand's motion
(tests/appliance/core/quality/test_stationary_time.py)."""
_STIRS, _STIRRED_MM, _STIRS_MEAN = 1 / 3, 0.3, 20
"""The picture must move by at least the first, a share of the root mean square by which the tracker moves in the plane
from comparison to comparison, once that is more than the second, mm; the third is the number of comparisons in the
mean, 3 s. A hand's tremor moves both: a picture that it does not move was frozen, even if noise lies over it. A higher
share or a lower way ends the rest of a probe in a holder before a noisy tracker, a lower share or a higher way lets a
frozen picture rest with a calm hand (tests/appliance/core/quality/test_stationary_time.py)."""
_NEAR_NS, _LEAST_NS = 6_000_000_000, 1_000_000_000
"""Time, ns, after what was shown within which the rest must begin, and the least length of a rest, ns. What is shown is
as old as the middle of a gesture, and that motion continues up to the rest. Less gives a rest after a gesture nothing;
more counts what a sweep that shows nothing may hide. Where the hand turns back it is at one place for half a second."""
_MOST_SPANS = 100
"""The number of spans that are kept. None but the last is shorter than a second, so they reach further than any age."""


class Pictures(Protocol):
    """Represents the pictures as `RealTimeTracker` keeps them."""

    def take_anchor(self) -> None: ...

    def against_anchor(self) -> Registration | None: ...


@dataclass(slots=True)
class _Span:
    """Holds the first and last picture that show the same. parted_ns: when tracker and picture last parted before."""

    start_ns: int
    end_ns: int
    parted_ns: int

    @property
    def lasted(self) -> bool:
        """Returns whether the span is long enough to be a rest."""
        return self.end_ns - self.start_ns > _LEAST_NS


class StationaryTime:
    """Takes every picture with its pose, and measures for how long the probe has been stationary since any moment."""

    def __init__(self, limits: Limits, reference: Calibration) -> None:
        self._reference = reference
        turn = np.deg2rad(limits.rotation_deg)
        self._limits = np.array([*[limits.offset_mm] * 3, *[turn] * 3])
        self._most_ns = round(limits.at_rest_s * 1e9)
        self.restart()

    def restart(self) -> None:
        """Forgets everything, because what came before says nothing about what follows."""
        self._spans: deque[_Span] = deque(maxlen=_MOST_SPANS)
        self._anchor: Matrix4 | None = None
        self._pose: Matrix4 | None = None
        self._parting = self._elsewhere = False
        self._before: tuple[Array, Array] | None = None
        self._stirred, self._stirs = np.zeros(2), 0
        self._now_ns = self._still_ns = self._compared_ns = self._parted_ns = 0

    def forget(self, since_ns: int) -> None:
        """Forgets what was at or after since_ns, whose stamps were wrong."""
        kept, parted_ns = [span for span in self._spans if span.end_ns < since_ns], self._parted_ns
        self.restart()
        self._spans.extend(kept)
        self._parted_ns = min(parted_ns, since_ns)

    def step(self, t_ns: int, pose: Matrix4, pictures: Pictures) -> None:
        """Takes the next picture, the latest of `pictures`. pose: (4, 4) sensor → tracker at its time, mm."""
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
            # The tracker has left. Without a like picture just before, the marker body may have slipped instead.
            if self._still_ns - end_ns > _BLIND_NS:
                self._parted_ns = t_ns
            self._begin(t_ns, pose, pictures)
        elif self._still_ns == t_ns and t_ns - end_ns > self._timeout_ns:
            self._begin(t_ns, pose, pictures)

    def since(self, t_ns: int, *, lasting: bool = False) -> int:
        """Returns how long, ns, nothing has changed since t_ns, by the rest that was under way then or the first that
        began soon after; `Limits.at_rest_s` at most. Returns 0 where tracker and picture had parted in between.
        lasting: returns 0 also once that rest is over.
        """
        first = next((span for span in self._spans if span.lasted and span.end_ns > t_ns), None)
        if first is None or t_ns < max(first.parted_ns, first.start_ns - _NEAR_NS):
            return 0
        if lasting and not (first is self._spans[-1] and self._lasts):
            return 0
        return min(first.end_ns - max(first.start_ns, t_ns), self._most_ns)

    @property
    def spans(self) -> tuple[tuple[int, int], ...]:
        """Returns the first and last picture of each remembered rest, ns; the last may still be too short to be one."""
        return tuple((span.start_ns, span.end_ns) for span in self._spans)

    @property
    def _timeout_ns(self) -> int:
        """Returns how long the anchor waits for a picture like it."""
        if self._spans[-1].lasted:
            return _LOST_NS
        return SLOW_BREATH_NS if self._elsewhere else _AGAIN_NS

    @property
    def _lasts(self) -> bool:
        """Returns whether the probe is where the anchor is, by the tracker."""
        return self._anchor is not None and self._now_ns - self._still_ns <= TREMOR_NS

    def _begin(self, t_ns: int, pose: Matrix4, pictures: Pictures) -> None:
        """Begins another span, which may become a rest; the one before has ended with its last picture."""
        pictures.take_anchor()
        self._anchor, self._before, self._stirs, self._elsewhere = pose, None, 0, False
        self._still_ns = self._compared_ns = t_ns
        if self._spans and not self._spans[-1].lasted:
            self._spans.pop()
        self._spans.append(_Span(t_ns, t_ns, self._parted_ns))

    def _compare(self, t_ns: int, probe: Array, pictures: Pictures) -> None:
        """Compares the latest picture with the anchor. What cannot be compared, NaN included, shows no rest."""
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
        """Returns whether the picture moves as the tracker reports that the hand moves it. probe, picture: (6,)
        distances from the anchor, as shares of the limits.
        """
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
        """Returns tracker minus picture in the plane, and out of it, where the picture shows no displacement, the
        tracker; (6,) shares of the limits.
        """
        lateral, axial = self._reference.polarity
        moved_mm = found.u_px * self._reference.scale_mm_per_px * self._reference.polarity
        apart = probe.copy()
        apart[[0, 1, 5]] -= np.array([*moved_mm, found.alpha_rad * lateral * axial]) / self._limits[[0, 1, 5]]
        return apart


def _within(values: Array, most: float) -> bool:
    """Returns whether no value is larger than `most`, whatever its sign; False for NaN."""
    return bool((np.abs(values) <= most).all())
