"""The one shape of a detector: it takes poses and what was made of each picture, and yields checks.

Pure: time is in the stamps. A detector overrides what concerns it; the others do nothing.
"""

from collections.abc import Callable
from dataclasses import dataclass

from appliance.core.registration.realtime_tracker import Warp
from appliance.types import Check, Fault
from drivers.rigid import Array
from drivers.samples import GreyImage, Matrix4, Pose


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """What the line has made of one picture that has the size of the reference's.

    image: (h, w) uint8. repeated: the same picture as the one before, which shows nothing new. followed: the Real-time
    Tracker registered it. step_mm: (2,) lateral and axial motion since the picture before; None where it was followed
    too badly to testify against the tracker. moved: (3,) way of the picture plane since the picture before, lateral and
    axial mm and turn rad in the axes of that one; None where it is not known. warp: the same of the tissue in the
    picture, (u (2,) px, α rad), as `Registration` has it. likeness: to its keyframe, 0 … 1; keyframe: which one.
    pose: (4, 4) sensor → tracker at its time, mm; None for a picture without one.
    """

    t_ns: int
    image: GreyImage
    repeated: bool
    followed: bool = False
    step_mm: Array | None = None
    moved: Array | None = None
    warp: Warp | None = None
    likeness: float = 0.0
    keyframe: int = 0
    pose: Matrix4 | None = None


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
