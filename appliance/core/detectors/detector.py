"""Defines the interface of a detector, which takes poses and the observation of each picture, and yields checks.

Detectors are pure: they take the time from the stamps. Each overrides the methods that concern it; the others do
nothing.
"""

from collections.abc import Callable

from probewatch.appliance.core.detectors.observation import Observation
from probewatch.appliance.types import Check, Fault
from probewatch.drivers.samples import Pose


class Detector:
    """Watches for one thing that may be wrong."""

    def pose(self, pose: Pose) -> None:
        """Takes the next usable pose. Poses arrive in time order, each before the picture of its time."""

    def see(self, seen: Observation) -> bool:
        """Takes the next picture and returns whether it shows that the geometry has changed.

        Where it does, everything that was measured belongs to the geometry before the change.
        """
        return False

    def pause(self, t_ns: int) -> None:
        """Notes that sight was lost at t_ns: later samples cannot be compared with earlier ones."""

    def forget_pictures(self, since_ns: int) -> None:
        """Forgets pictures, of which those at or after since_ns were stamped wrongly."""

    def forget_poses(self, since_ns: int) -> None:
        """Forgets poses, of which those at or after since_ns were stamped wrongly."""

    def on_verified(self, shows: Callable[[Fault], bool], until_ns: int) -> None:
        """Records that motion has shown the classes of faults for which `shows` is true to be absent.

        until_ns: stamp of the latest picture of that motion, because a solution is ready some pictures later. A change
        for which `see` returned True has dropped the solution that was under way.
        """

    def checks(self) -> tuple[Check, ...]:
        """Returns what the detector knows now; no checks before it knows anything."""
        raise NotImplementedError
