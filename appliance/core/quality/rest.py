"""For how long the probe has rested, by tracker and picture together: meanwhile nothing need be shown again.

A probe that is held still shows nothing of its calibration. But while the tracker has the marker body where it was, and
the picture has the tissue where it was, the body sits on the probe as it did, and the picture is as large and as much
mirrored as it was. Both are held against one picture, the anchor, so that a slip is seen however slow it is; where the
anchor must be renewed, what the two disagreed by is kept. Where the tissue moves under the probe, as a patient
breathes, the probe rests between any two pictures that show it where it was.

A late tracker shows nothing of it at rest, and spoils nothing: latency counts as watched for as long as the rest lasts.
"""

from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from appliance.core.motion import predicted_motion
from appliance.core.registration.keyframe import Registration
from appliance.limits import Limits
from appliance.types import Calibration
from drivers.rigid import Array
from drivers.samples import Matrix4

_MOST = 0.25
"""Of the limits of offset and rotation: how far from the anchor the probe rests, and how far tracker and picture may
disagree. More calls a slow sweep rest; less loses a hand whose tremor is .3 mm."""
_DRIFTED = 0.5
"""Of the same limits, for all that they disagreed by since: more leaves less room for what a slip adds to a calibration
that was shown with room of its own, less ends a long rest with many anchors."""
_ALIKE = 0.9
"""Likeness to the anchor, that bounds what the picture does not show as a way: .46 mm out of the plane (mathematics,
section 6), or 1.9° of tilt over a picture of 50 mm. Less bounds it worse, more loses a hand's tremor. Tissue without
speckle bounds less; not measured."""
_EVERY_NS = 150_000_000
"""Between two comparisons with the anchor: each costs a registration. Longer misses the moments at which a tremor
passes the place of the anchor."""
_LASTS_NS = 1_000_000_000
"""For which the probe rests still after the tracker had it there, and an anchor is kept: a tremor goes to and fro
within it. An anchor costs a keyframe: once a second while the probe moves."""
_LOST_NS = 6_000_000_000
"""After which an anchor that no picture is like any more is renewed, though the tracker has the probe there: a breath
and a half."""
_MOST_RESTS = 1000
"""Kept, the newest: a quarter of an hour of a new anchor each second."""


class Pictures(Protocol):
    """The pictures as `RealTimeTracker` keeps them."""

    def take_anchor(self) -> None: ...

    def against_anchor(self) -> Registration | None: ...


@dataclass(frozen=True, slots=True, eq=False)
class _Rest:
    """From the first to the last picture that shows the probe where one anchor has it. apart: (6,) of the limits, by
    how much tracker and picture disagreed at the last of them."""

    start_ns: int
    end_ns: int
    apart: Array


class Rest:
    """Takes every picture that was followed with its pose; tells how long the probe rested since any time."""

    def __init__(self, limits: Limits, reference: Calibration) -> None:
        self._reference = reference
        turn = np.deg2rad(limits.rotation_deg)
        self._limits = np.array([*[limits.offset_mm] * 3, *[turn] * 3])
        self._most_ns = round(limits.at_rest_s * 1e9)
        self.restart()

    def restart(self) -> None:
        """Whatever was before says nothing of what comes."""
        self._rests: deque[_Rest] = deque(maxlen=_MOST_RESTS)
        self._anchor: Matrix4 | None = None
        self._pose: Matrix4 | None = None
        self._now_ns = self._still_ns = self._compared_ns = self._alike_ns = 0

    def forget(self, since_ns: int) -> None:
        """What was at or after since_ns was stamped wrongly."""
        kept = [rest for rest in self._rests if rest.end_ns < since_ns]
        self.restart()
        self._rests.extend(kept)

    def step(self, t_ns: int, pose: Matrix4, pictures: Pictures) -> None:
        """Take the next picture, the latest of `pictures`. pose: (4, 4) sensor → tracker at its time, mm."""
        self._now_ns = t_ns
        repeated = self._pose is not None and np.array_equal(pose, self._pose)
        self._pose = pose
        if repeated or not self._most_ns:
            return
        if self._anchor is None:
            self._begin(t_ns, pose, pictures)
            return
        probe = np.concatenate(predicted_motion(self._reference, self._anchor, pose)) / self._limits
        if np.abs(probe).max() <= _MOST:
            self._still_ns = t_ns
            if t_ns - self._compared_ns >= _EVERY_NS:
                self._compare(t_ns, probe, pictures.against_anchor())
        if not self.lasting or t_ns - self._alike_ns > _LOST_NS:
            self._begin(t_ns, pose, pictures)

    def since(self, t_ns: int) -> int:
        """For how long the probe has rested since t_ns, ns, until the last picture that showed it, and as far as
        tracker and picture have not drifted apart since; `Limits.at_rest_s` at most.
        """
        rested_ns, drift = 0, np.zeros(6)
        for rest in self._rests:
            if rest.end_ns <= t_ns:
                continue
            drift = drift + rest.apart
            if np.abs(drift).max() > _DRIFTED:
                break
            rested_ns += rest.end_ns - max(rest.start_ns, t_ns)
        return min(rested_ns, self._most_ns)

    @property
    def rests(self) -> tuple[tuple[int, int], ...]:
        """First and last picture of each rest that is remembered, ns."""
        return tuple((rest.start_ns, rest.end_ns) for rest in self._rests)

    @property
    def lasting(self) -> bool:
        """Whether the probe rests now, by the tracker."""
        return self._anchor is not None and self._now_ns - self._still_ns <= _LASTS_NS

    def _begin(self, t_ns: int, pose: Matrix4, pictures: Pictures) -> None:
        pictures.take_anchor()
        self._anchor = pose
        self._still_ns = self._compared_ns = self._alike_ns = t_ns
        if not self._rests or self._rests[-1].start_ns < self._rests[-1].end_ns:
            self._rests.append(_Rest(t_ns, t_ns, np.zeros(6)))
        else:
            self._rests[-1] = _Rest(t_ns, t_ns, np.zeros(6))

    def _compare(self, t_ns: int, probe: Array, found: Registration | None) -> None:
        self._compared_ns = t_ns
        if found is None or found.correlation < _ALIKE:
            return
        apart = self._apart(found, probe)
        if np.abs(apart).max() <= _MOST:
            self._alike_ns = t_ns
            self._rests[-1] = _Rest(self._rests[-1].start_ns, t_ns, apart)

    def _apart(self, found: Registration, probe: Array) -> Array:
        """(6,) of the limits: in the plane tracker less picture; out of it, where the picture shows no way, tracker."""
        lateral, axial = self._reference.polarity
        moved_mm = found.u_px * self._reference.scale_mm_per_px * self._reference.polarity
        apart = probe.copy()
        apart[[0, 1, 5]] -= np.array([*moved_mm, found.alpha_rad * lateral * axial]) / self._limits[[0, 1, 5]]
        return apart
