"""Contains what the detectors of a slipping marker body share.

Poses wait for pictures of the same time, and a motion of the picture plane is converted to one of the body.
"""

from collections import deque
from math import hypot

import numpy as np

from probewatch.appliance.core.detectors.detector import Detector
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array, angle_from_rotation, inverse, rigid, rotation_from_vector
from probewatch.drivers.samples import Matrix4, Pose

SHIFT_NS = 100_000_000
"""ns by which the pictures may show a motion before or after the tracker does: the limit of the latency and the period
of one picture."""
LAGS_NS = (-SHIFT_NS, -SHIFT_NS // 2, 0, SHIFT_NS // 2, SHIFT_NS)
"""Lags, ns, at which the path of the pictures is read."""
DENIED = 1 / 3
"""Share of the tracker's motion out of the plane: where the pictures show less of it, the probe did not make it. A
higher share calls a twist of the probe a slip where the beam is thick; a lower one takes fluctuations of the likeness
for a motion. Not measured on tissue."""
ALIKE = 0.3
"""Likeness to its keyframe at or above which a picture that was followed counts as a witness. In the liveliest gesture
it falls to .38 (`probewatch study`, seed 1); a leap of 2 mm out of the plane leaves less than .2, and such a picture is
not followed."""
_MOST_WAITING = 2_000
"""Most poses that wait for a picture, 5 s of the fastest tracker; older ones are forgotten."""


class BodySlip(Detector):
    """Keeps the poses that wait for a picture. A subclass overrides `see`, `_restart` and `checks`."""

    def __init__(self, limits: Limits, reference: Calibration) -> None:
        self._limits = limits
        self._X = rigid(reference.rotation, reference.offset_mm)
        self._back = inverse(self._X)
        self._waiting: deque[tuple[int, Matrix4]] = deque(maxlen=_MOST_WAITING)

    def pose(self, pose: Pose) -> None:
        """See Detector. The pose waits for a picture of its time."""
        assert pose.matrix is not None
        self._waiting.append((pose.stamp.t_ns, pose.matrix))

    def pause(self, t_ns: int) -> None:
        """See Detector."""
        self._restart()
        while self._waiting and self._waiting[0][0] <= t_ns:
            self._waiting.popleft()

    def forget_pictures(self, since_ns: int) -> None:
        """See Detector."""
        self.pause(since_ns)

    def forget_poses(self, since_ns: int) -> None:
        """See Detector. Earlier poses are forgotten as well."""
        self._restart()
        self._waiting.clear()

    def _restart(self) -> None:
        """Forgets the path of the body so far."""
        raise NotImplementedError

    def _spoils(self, way: Array) -> bool:
        """Returns whether a motion of the picture plane, (6,), would by itself move the body beyond a limit."""
        moved_mm, turned_rad = extent(self._of_body(way))
        return moved_mm > self._limits.offset_mm or turned_rad > np.deg2rad(self._limits.rotation_deg)

    def _of_body(self, way: Array) -> Matrix4:
        """Returns a motion of the picture plane, (6,) in mm and rad, as a motion in sensor axes, (4, 4)."""
        return np.asarray(self._back @ rigid(rotation_from_vector(way[3:]), way[:3]) @ self._X)


def extent(step: Matrix4) -> tuple[float, float]:
    """Returns the length, mm, and the angle, rad, of a rigid step."""
    return hypot(*step[:3, 3].tolist()), angle_from_rotation(step[:3, :3])
