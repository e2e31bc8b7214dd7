"""A tracker that reports exactly the same pose again and again while the picture moves repeats an old reading."""

import numpy as np

from probewatch.appliance.core.detectors.detector import Detector
from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.types import Check, Fault, VerdictKind
from probewatch.drivers.samples import Matrix4, Pose

REPORTS_FAULTS = (Fault.TRACKER_STALE,)

_MOVED_MM = 1.0
"""Way of the picture while the pose stays: more than registration errors add up to at rest, less than the slowest sweep
goes in its half second. Not measured.
"""


class FrozenTracker(Detector):
    """Needs motion in the picture: a probe at rest on a noiseless tracker may well report equal poses."""

    def __init__(self, limit_ns: int) -> None:
        self._limit_ns = limit_ns
        self.forget_poses(0)

    def forget_poses(self, since_ns: int) -> None:
        """See Detector; the reading before is forgotten as well, and the next one is the first."""
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
        """Age of the reading, ms, once the picture has moved more than a millimetre in that time; 0 before."""
        age_ns = self._now_ns - self._since_ns if self._moved_mm > _MOVED_MM else 0
        verdict = VerdictKind.FAULT if age_ns > self._limit_ns else VerdictKind.OK
        return (Check("frozen-tracker", Fault.TRACKER_STALE, age_ns / 1e6, 0.0, "ms", self._limit_ns / 1e6, verdict),)
