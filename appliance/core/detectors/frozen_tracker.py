"""Detects a tracker that repeats an old reading: it reports exactly the same pose while the picture moves."""

import numpy as np

from probewatch.appliance.core.detectors.detector import Detector
from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.types import Check, Fault, VerdictKind
from probewatch.drivers.samples import Matrix4, Pose

REPORTS_FAULTS = (Fault.TRACKER_STALE,)

_MOVED_MM = 1.0
"""mm that the picture must move while the pose stays the same: more than the sum of registration errors at rest, less
than the slowest sweep covers in its half second. Not measured.
"""


class FrozenTracker(Detector):
    """Measures for how long poses have been equal while the picture moved.

    It needs motion in the picture, because a tracker without noise may well report equal poses of a probe at rest.
    limit_ns: age of the reading, ns, beyond which it is a fault.
    """

    def __init__(self, limit_ns: int) -> None:
        self._limit_ns = limit_ns
        self.forget_poses(0)

    def forget_poses(self, since_ns: int) -> None:
        """See Detector. The previous reading is forgotten as well, and the next one counts as the first."""
        self._matrix: Matrix4 | None = None
        self._since_ns = 0
        self._now_ns = 0
        self._moved_mm = 0.0

    def pose(self, pose: Pose) -> None:
        """See Detector."""
        assert pose.matrix is not None
        if self._matrix is None or not np.array_equal(self._matrix, pose.matrix):
            self._since_ns, self._moved_mm = pose.stamp.t_ns, 0.0
        self._matrix, self._now_ns = pose.matrix, pose.stamp.t_ns

    def see(self, seen: Observation) -> bool:
        """See Detector."""
        if seen.step_mm is not None:
            self._moved_mm += float(np.hypot(*seen.step_mm))
        return False

    def checks(self) -> tuple[Check, ...]:
        """Returns the age of the reading, ms, once the picture has moved by more than 1 mm in that time; 0 before."""
        age_ns = self._now_ns - self._since_ns if self._moved_mm > _MOVED_MM else 0
        verdict = VerdictKind.FAULT if age_ns > self._limit_ns else VerdictKind.OK
        return (Check("frozen-tracker", Fault.TRACKER_STALE, age_ns / 1e6, 0.0, "ms", self._limit_ns / 1e6, verdict),)
