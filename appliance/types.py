"""Defines the values that flow along the line. They are frozen; shapes and units are stated here once.

Conventions (Boctor et al. 2005, Eq. 1, with its misprints corrected): picture frame P has x lateral (columns), y axial
(rows, down), z = x × y elevational, origin at the image centre, mm. Sensor frame R is the marker body. X maps R to P:
p_P = R_x p_R + t_x. B = B_2⁻¹ B_1 is the motion that the tracker saw; A = X B X⁻¹ moves a static tissue point in the
picture, p_2 = A p_1; in the plane A is (u, α) and t_a = Λ u.
"""

from dataclasses import dataclass, replace
from enum import Enum, StrEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.rigid import rotation_from_vector
from probewatch.drivers.samples import Frame, Matrix4, Stamp

Vector = NDArray[np.float64]

PARAMETERS = (
    "rotation-lateral",
    "rotation-axial",
    "rotation-elevational",
    "scale-lateral",
    "scale-axial",
    "offset-lateral",
    "offset-axial",
    "offset-elevational",
)
"""Order of the parameters of X in every covariance and observability vector.

Rotations are rad about the picture axes (R_x = exp([δ]×) R_ref), scales relative (λ = λ_ref (1 + δ)), offsets mm.
"""


@dataclass(frozen=True, slots=True, eq=False)
class StampedPair:
    """Holds a frame and the pose interpolated to the frame's own time from the two poses that bracket it.

    matrix: (4, 4) sensor → tracker, mm. gap_ns: time between the bracketing poses.
    """

    stamp: Stamp
    frame: Frame
    matrix: Matrix4
    gap_ns: int


class MotionKind(Enum):
    """States how the probe moved between keyframe and frame, which decides which parameters the motion can reveal."""

    STILL = "still"
    TRANSLATION = "in-plane translation"
    PLANAR = "planar"
    OUT_OF_PLANE = "out-of-plane"
    TOO_FAST = "too fast"
    DECORRELATED = "decorrelated"


DRAGS, PRESSES = 1, 2
"""Bits for what tissue may do besides moving as if it were rigid: its skin drags along with the face; it follows a face
that presses.
"""


@dataclass(frozen=True, slots=True, eq=False)
class TissuePath:
    """Holds the path since the chain's first picture, by what tissue may do.

    path_px: (4, 2), path_rad: (4,), as of `Motion`, indexed by the bits `DRAGS` and `PRESSES`. drag_px: (4,) lateral
    displacement of the skin against deep tissue. tilt_rad: turn by ∂u_y/∂x, which tissue that follows the face shows in
    part. clear_share: share of the picture in which tissue is seen.
    """

    path_px: Vector
    path_rad: Vector
    drag_px: Vector
    tilt_rad: float
    clear_share: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Holds one registered picture: A since the keyframe, and the path that it continues.

    stamp, sequence: those of this picture. keyframe: sequence number of the earlier one; their difference is the step
    d. u_px: (2,) (column, row) displacement of the tissue at the image centre, px. alpha_rad: in-plane rotation.
    covariance: (3, 3) of (u_x px, u_y px, α rad). correlation: that of the registered pictures, -1 … 1. chain: number
    of the unbroken chain of keyframes; path_px, path_rad: (u, α) since the chain's first picture. usable: False where
    the solver must not see it; reason says why. tissue: the path by what tissue may do, None where it is known to be
    rigid.
    """

    stamp: Stamp
    sequence: int
    keyframe: int
    kind: MotionKind
    u_px: Vector
    alpha_rad: float
    covariance: Vector
    correlation: float
    chain: int
    path_px: Vector
    path_rad: float
    usable: bool
    reason: str = ""
    tissue: TissuePath | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """Holds X and the picture scales.

    rotation: (3, 3) proper, R_x sensor → picture. polarity: ±1 for (lateral, axial). scale_mm_per_px: (2,) lateral,
    axial, > 0. offset_mm: (3,) t_x. image_size_px: (width, height) to which the origin refers. covariance: (8, 8) in
    the order and units of PARAMETERS, None where unknown. observed: (8,) bool. simulated: made from simulated pictures
    or poses, so that it is the calibration of no real probe. face_radius_mm: radius of the arc at which a convex
    picture begins; None where it is not known, or the face is flat.
    """

    rotation: Vector
    polarity: tuple[int, int]
    scale_mm_per_px: Vector
    offset_mm: Vector
    image_size_px: tuple[int, int]
    covariance: Vector | None = None
    observed: tuple[bool, ...] = (True,) * len(PARAMETERS)
    simulated: bool = False
    face_radius_mm: float | None = None

    @property
    def face_mm(self) -> Vector:
        """Returns the middle of the probe's face, (3,) mm, in the axes of the picture, from the picture's middle."""
        return np.array([0.0, -self.polarity[1] * self.image_size_px[1] / 2 * self.scale_mm_per_px[1], 0.0])

    def changed(self, change: Vector) -> Self:
        """Returns the calibration with its parameters changed. change: the first eight in the order and units of
        PARAMETERS.
        """
        return replace(
            self,
            rotation=rotation_from_vector(change[:3]) @ self.rotation,
            scale_mm_per_px=self.scale_mm_per_px * (1 + change[3:5]),
            offset_mm=self.offset_mm + change[5:8],
        )


class Kind(Enum):
    """States what sort of thing is wrong; what it leads to is the policy (`appliance.supervision.policy`).

    CALIBRATION: what the line measures against the reference. DEVICE: scanner, tracker or output. INTERNAL: a part of
    probewatch itself. INTEGRITY: what was written down is damaged. SIGHT: there is nothing to compare, as whenever the
    probe is laid aside. ADVISORY: good to know.
    """

    CALIBRATION = "calibration"
    DEVICE = "device"
    INTERNAL = "internal"
    INTEGRITY = "integrity"
    SIGHT = "sight"
    ADVISORY = "advisory"


class Fault(StrEnum):
    """Names what may be wrong, in the words of the JSON reports and of the alarm log; docs/alarms.md has what each asks
    of the people in the room. AGREEMENT is not a fault but a fact reported with them: its check never fails.

    kind: what sort of thing it is.
    """

    kind: Kind

    def __new__(cls, value: str, kind: Kind | None = None) -> Self:
        """Makes a member that has its kind; Fault("scale") finds one that is there."""
        assert kind is not None
        member = str.__new__(cls, value)
        member._value_, member.kind = value, kind
        return member

    POLARITY = "polarity", Kind.CALIBRATION
    SCALE = "scale", Kind.CALIBRATION
    ROTATION = "rotation", Kind.CALIBRATION
    OFFSET = "offset", Kind.CALIBRATION
    LATENCY = "latency", Kind.CALIBRATION
    POSE_CONVENTION = "pose-convention", Kind.CALIBRATION
    EXCHANGED_PROBE = "exchanged-probe", Kind.CALIBRATION
    MARKER_BODY_MOVED = "marker-body-moved", Kind.CALIBRATION
    UNDECIDED = "undecided", Kind.CALIBRATION
    AGREEMENT = "agreement", Kind.ADVISORY
    FROZEN_VIDEO = "frozen-video", Kind.DEVICE
    VIDEO_LOST = "video-lost", Kind.DEVICE
    TRACKER_ALERT = "tracker-alert", Kind.DEVICE
    MARKER_BODY = "marker-body", Kind.DEVICE
    FIELD_DISTORTION = "field-distortion", Kind.DEVICE
    TRACKER_LOST = "tracker-lost", Kind.DEVICE
    TRACKER_STALE = "tracker-stale", Kind.DEVICE
    OUTPUT_FAILED = "output-failed", Kind.DEVICE
    ESTIMATOR_SILENT = "estimator-silent", Kind.INTERNAL
    MEMORY_DAMAGED = "memory-damaged", Kind.INTEGRITY
    LOG_DAMAGED = "log-damaged", Kind.INTEGRITY
    LINE_OF_SIGHT = "line-of-sight", Kind.SIGHT
    POSE_UNUSABLE = "pose-unusable", Kind.SIGHT
    NO_PICTURE = "no-picture", Kind.SIGHT
    USER_FREEZE = "user-freeze", Kind.SIGHT
    LOG_NOT_WRITTEN = "log-not-written", Kind.ADVISORY
    OVERLOADED = "overloaded", Kind.ADVISORY
    CALIBRATION_FILE = "calibration-file", Kind.ADVISORY
    CALIBRATION_DUE = "calibration-due", Kind.ADVISORY


class VerdictKind(Enum):
    """States what was shown. OK: verified within the limits. FAULT: outside the limits. NOT_VERIFIED: neither."""

    OK = "OK"
    FAULT = "FAULT"
    NOT_VERIFIED = "NOT_VERIFIED"


@dataclass(frozen=True, slots=True)
class Check:
    """Compares one quantity with its limit. ratio = |value| ÷ limit: 1.0 is the limit for every check alike.

    fault: class that this check names when it fails. sigma: standard deviation of value, same unit; 0 for exact facts.
    value is NaN where nothing was observed. shown_ns: time of the motion by which the quantity was last shown to be OK,
    or on which it rests, dated as in appliance.core.path.solver.Solution; None where there is none. rested_ns: for how
    long since then the probe has rested, which no age limit counts.
    """

    name: str
    fault: Fault
    value: float
    sigma: float
    unit: str
    limit: float
    verdict: VerdictKind
    shown_ns: int | None = None
    rested_ns: int = 0

    @property
    def ratio(self) -> float:
        """Returns |value| ÷ limit; NaN where nothing was observed."""
        return abs(self.value) / self.limit

    def least_ratio(self, sigmas: float) -> float:
        """Returns the ratio with this many sigmas as room: above 1 it is surely beyond; NaN where nothing was
        observed.
        """
        return (abs(self.value) - sigmas * self.sigma) / self.limit


@dataclass(frozen=True, slots=True)
class Rival:
    """Represents one of the classes that explain what contradicts the calibration about as well as another.

    check: that of its parameter that is farthest beyond, were it this class alone. behind_nats: log likelihood by which
    it explains less than the likeliest of them, whose own is 0.
    """

    check: Check
    behind_nats: float


POINT_ACROSS = 5
"""Number of places in each row and column of the region of a point. The worst is at a corner (test_point_error.py), so
more only make the median smoother, by 1 % or so, and cost time.
"""
POINT_LEVELS = (0.95, 0.997)
"""Shares of what is left open for which the two bounds of a point hold: two and three sigmas, as people are used to."""
POINT_WITHHELD = "error of a point"
"""Begins the reason of a verdict from which the limit of the error of a point alone withholds the OK."""


@dataclass(frozen=True, slots=True)
class PointError:
    """Holds how far what the picture shows at a place may be from where the reference puts it in the room, mm.

    Each bound is given twice, for each of `POINT_LEVELS` of what the motion leaves open. worst_mm, median_mm: those
    over the region of the picture. depth_mm, at_depth_mm: a depth that a person named, from the top of the picture, and
    the worst there; None where none was named. shown_ns: time of the oldest motion on which the bounds rest. region_mm:
    the wider bound at `POINT_ACROSS` rows of as many places of the region, its edges among them, from its upper left
    corner; empty in older black boxes.
    """

    worst_mm: tuple[float, float]
    median_mm: tuple[float, float]
    depth_mm: float | None
    at_depth_mm: tuple[float, float] | None
    shown_ns: int
    region_mm: tuple[float, ...] = ()


@dataclass(frozen=True, slots=True)
class Verdict:
    """Holds what the line concludes at one time.

    fault: class of the worst failing check, None unless kind is FAULT. t_ns: sample time for which it holds. reason:
    one sentence for the operator. verified_ns: the oldest of the times at which motion last showed a required
    parameter; None where one was never shown or has been contradicted since. Only new motion advances it, whatever the
    time of the verdict. expires_ns: when the first of them exceeds an age limit of its own, which a rest extends; None
    where none has one. rivals: what may be wrong where motion so far does not show which, the likeliest first; never
    one alone. point: the error of a point, None where it is not known.
    """

    t_ns: int
    kind: VerdictKind
    checks: tuple[Check, ...]
    fault: Fault | None = None
    reason: str = ""
    verified_ns: int | None = None
    expires_ns: int | None = None
    rivals: tuple[Rival, ...] = ()
    point: PointError | None = None


class State(Enum):
    """Names the states of the supervisor, as the operator reads them."""

    SELF_TEST = "self-test"
    WAITING = "waiting for devices"
    NOT_VERIFIED = "not verified"
    MONITORING = "monitoring"
    WARNING = "warning"
    HALT = "halt"
    RECALIBRATION_REQUESTED = "recalibration requested"
    RECALIBRATING = "recalibrating"
    DEVICE_LOST = "device lost"
    INTERNAL_FAULT = "internal fault"


@dataclass(frozen=True, slots=True)
class AlarmState:
    """Holds what the room is shown: one row of the alarm table, in force since since_ns.

    energised: contact closed, which means safe. fault: class that caused the state, None where none. verified_ns: when
    the calibration was last verified, None when it is not. latched, latched_fault: the state that holds until a person
    acknowledges and the calibration is verified again, also through recalibration, loss of a device and restart; and
    its cause. acknowledged: whether a person has. notices: classes of advisories, shown besides. barrier_ns: only
    motion after it verifies anything.
    """

    state: State
    since_ns: int
    fault: Fault | None
    reason: str
    energised: bool
    verified_ns: int | None
    latched: State | None = None
    latched_fault: Fault | None = None
    acknowledged: bool = False
    notices: tuple[Fault, ...] = ()
    barrier_ns: int = -1
