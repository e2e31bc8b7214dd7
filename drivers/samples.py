"""Defines the samples that a source yields: a frame or a pose, with the time at which the measurement was true."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

GreyImage = NDArray[np.uint8]
"""(height, width) uint8; row 0 nearest the probe face, column 0 on the marked side (MFA orientation)."""

Matrix4 = NDArray[np.float64]
"""(4, 4) homogeneous rigid transform, translation in mm."""


@dataclass(frozen=True, slots=True)
class Stamp:
    """Holds the host's CLOCK_MONOTONIC at which the measurement was true, not when it arrived.

    t_ns: nanoseconds. err_ns: bound of its error, nanoseconds, >= 0.
    """

    t_ns: int
    err_ns: int

    def later_than(self, arrival_ns: int) -> bool:
        """Returns whether the stamp lies after its own arrival by more than its error."""
        return self.t_ns - self.err_ns > arrival_ns


class PoseStatus(Enum):
    """Classifies what a tracker reports about one pose; only OK carries numbers into the line.

    FAULT: the tracker itself reports a fault. NOT_UNDERSTOOD: what came is neither a rigid pose nor a status word that
    we know, and it is open where the fault lies.
    """

    OK = "ok"
    PARTIAL = "partly out of volume"
    OUT_OF_VOLUME = "out of volume"
    MISSING = "missing"
    STALE = "stale"
    DISABLED = "disabled"
    FAULT = "fault"
    NOT_UNDERSTOOD = "not understood"


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """Holds one B-mode picture. sequence: counts what the device sent, so a gap is a loss.

    image: never written to again; it may be a view with strides, of a part of a larger picture or turned.
    """

    stamp: Stamp
    sequence: int
    image: GreyImage


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Holds one tracker reading of the probe's marker body.

    matrix: (4, 4) sensor R → tracker T, or → reference tool where one is configured; None unless status is OK.
    sequence: the device's own frame counter. rms_mm: marker fit (Polaris) or indicator value (Aurora); NaN if unknown.
    reason: why status is not OK, in words, for the log.
    witness: (4, 4) a second marker body on the same probe, in the same frame and measured with the first; None where
    there is none, or it was not seen.
    """

    stamp: Stamp
    sequence: int
    matrix: Matrix4 | None
    rms_mm: float
    status: PoseStatus
    reason: str = ""
    witness: Matrix4 | None = None

    def __post_init__(self) -> None:
        if (self.matrix is not None) != (self.status is PoseStatus.OK):
            raise ValueError(f"a pose has a matrix if and only if it is OK, not {self.status.name}")
        if self.witness is not None and self.matrix is None:
            raise ValueError("the second body is told beside the first alone")


@dataclass(frozen=True, slots=True)
class MarkerBody:
    """Holds how well the probe, and the reference if there is one, can be measured at present; None where that is not
    known.

    fit_mm: RMS of the markers about the pose. shape_mm: RMS of the markers about the definition of the body, whatever
    its pose. indicator: quality of an electromagnetic measurement, in the tracker's own unit; it rises with distortion.
    """

    fit_mm: float | None = None
    shape_mm: float | None = None
    indicator: float | None = None


Sample = Frame | Pose
