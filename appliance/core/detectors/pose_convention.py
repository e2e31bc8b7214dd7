"""Detects poses in another convention than agreed: inverted, turned about other axes, a quaternion in another order.

No change of the calibration explains the motion that such poses report, so no parameter is ever shown; an explanation
is searched for elsewhere (`appliance.core.path.explanation`) and named here.
"""

from collections.abc import Callable

from probewatch.appliance.core.detectors.detector import Detector
from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.core.path.conventions import READINGS, Convention
from probewatch.appliance.core.path.explanation import MARGIN, Explanation
from probewatch.appliance.types import Check, Fault, VerdictKind

REPORTS_FAULTS = (Fault.POSE_CONVENTION,)

WRONG = frozenset({*READINGS, Convention.SWAPPED})
"""Conventions that are named."""


class PoseConvention(Detector):
    """Names a convention that two searches in a row have found. It never says OK.

    explained: returns the latest explanation of a motion that the reference does not explain.
    """

    def __init__(self, explained: Callable[[], Explanation | None]) -> None:
        self._explained = explained
        self._latest: Explanation | None = None
        self._named: Explanation | None = None

    def see(self, seen: Observation) -> bool:
        """See Detector."""
        found, before = self._explained(), self._latest
        if found is before:
            return False
        self._latest = found
        if found is None:
            return False
        again = before is not None and before.convention is found.convention
        if found.convention not in WRONG:
            self._named = None
        elif again or self._named is not None:
            self._named = found
        return False

    def on_verified(self, shows: Callable[[Fault], bool], until_ns: int) -> None:
        """See Detector. Poses in another convention do not show all rotations to be right."""
        if shows(Fault.ROTATION):
            self._named = self._latest = None

    def checks(self) -> tuple[Check, ...]:
        """Returns the check of how much better the named convention explains the motion than any other, or none."""
        if self._named is None:
            return ()
        name, margin = self._named.convention.value, self._named.margin
        return (Check(name, Fault.POSE_CONVENTION, margin, 0.0, "nat", MARGIN, VerdictKind.FAULT),)
