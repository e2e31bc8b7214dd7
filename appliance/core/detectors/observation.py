"""Defines the observation of one picture, as detectors receive it."""

from dataclasses import dataclass

from probewatch.appliance.core.motion import plane_step
from probewatch.appliance.core.registration.realtime_tracker import Tracked, Warp
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import Frame, GreyImage, Matrix4

_STEADY_CORRELATION = 0.6
"""Likeness at or above which a picture may contradict the tracker. A lower value takes a bad registration for a leap of
the marker; a higher one pauses the search for leaps in quick sweeps. Not measured.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """Holds the results of registration for one picture, which has the size of the reference's pictures.

    image: (h, w) uint8. repeated: whether the picture equals the one before and so shows nothing new. followed: whether
    the Real-time Tracker registered it. step_mm: (2,) lateral and axial motion since the picture before; None where the
    picture was registered too poorly to contradict the tracker. moved: (3,) motion of the picture plane since the
    picture before, lateral and axial in mm and turn in rad, in the axes of that picture; None where it is not known.
    warp: the same motion for the tissue in the picture, (u (2,) px, α rad), as in `Registration`. likeness: that to its
    keyframe, 0 … 1. keyframe: sequence number of that keyframe. pose: (4, 4) sensor → tracker at the time of the
    picture, mm; None for a picture without one.
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


def observed(frame: Frame, pose: Matrix4 | None, tracked: Tracked, reference: Calibration) -> Observation:
    """Returns the observation of a picture that the Real-time Tracker has taken. pose: as in `Observation`."""
    found = tracked.registration
    if found is None:
        return Observation(frame.stamp.t_ns, frame.image, repeated=False, pose=pose)
    return Observation(
        frame.stamp.t_ns,
        frame.image,
        repeated=False,
        followed=True,
        step_mm=_step_mm(tracked, reference),
        moved=None if tracked.step is None else plane_step(*tracked.step, reference),
        warp=tracked.step,
        likeness=found.correlation,
        keyframe=tracked.keyframe,
        pose=pose,
    )


def _step_mm(tracked: Tracked, reference: Calibration) -> Array | None:
    """Returns the step, (2,), as in `Observation`."""
    found = tracked.registration
    if tracked.step is None or found is None or found.correlation < _STEADY_CORRELATION:
        return None
    return tracked.step[0] * reference.scale_mm_per_px
