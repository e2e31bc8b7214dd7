"""The one shape of a detector: it takes poses and what was made of each picture, and yields checks.

Pure: time is in the stamps. A detector overrides what concerns it; the others do nothing.
"""

from collections.abc import Callable

from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.types import Check, Fault
from probewatch.drivers.samples import Pose


class Detector:
    """One thing that may be wrong."""

    def pose(self, pose: Pose) -> None:
        """Take the next usable pose, in time order; it comes before the picture of its time."""

    def see(self, seen: Observation) -> bool:
        """Take the next picture. True where it shows that the geometry has changed: what was measured is of before."""
        return False

    def pause(self, t_ns: int) -> None:
        """Sight was lost at t_ns: what comes cannot be compared with what came."""

    def forget_pictures(self, since_ns: int) -> None:
        """Pictures at or after since_ns were stamped wrongly."""

    def forget_poses(self, since_ns: int) -> None:
        """Poses at or after since_ns were stamped wrongly."""

    def on_verified(self, shows: Callable[[Fault], bool], until_ns: int) -> None:
        """Motion has shown the classes of faults for which `shows` is true to be absent.

        until_ns: stamp of its latest picture, as a solution is ready some pictures later. A change for which `see` was
        true has dropped the solution that was under way.
        """

    def checks(self) -> tuple[Check, ...]:
        """What it knows now; none before it knows anything."""
        raise NotImplementedError
