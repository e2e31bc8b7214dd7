"""A transform as PLUS writes it, in a recording or over the network: a rigid matrix, or why there is none."""

from dataclasses import dataclass

import numpy as np

from probewatch.drivers.printable import printable
from probewatch.drivers.samples import Matrix4, PoseStatus
from probewatch.drivers.trackers.pose_bounds import FURTHEST_MM

_ROTATION_TOLERANCE = 2e-3
"""Largest error of RᵀR and of the last row that is rounding: PLUS prints six digits, and three would err by 1.7e-3.
More takes a scaled matrix for a pose; an axis 2 % too long is refused
(tests/drivers/recordings/test_metaimage_transforms.py).
"""

WITHOUT_POSE = {
    "INVALID": PoseStatus.MISSING,
    "MISSING": PoseStatus.DISABLED,
    "OUT_OF_VIEW": PoseStatus.MISSING,
    "OUT_OF_VOLUME": PoseStatus.OUT_OF_VOLUME,
    "DISABLED": PoseStatus.DISABLED,
    "REQ_TIMEOUT": PoseStatus.STALE,
}
"""PLUS's words: MISSING of a tool or port that is not there, OUT_OF_VIEW of one that is not seen."""


GOOD = ("OK", "SWITCH1_IS_ON", "SWITCH2_IS_ON", "SWITCH3_IS_ON")
"""PLUS's words for a good pose; of a tool with buttons it says which one is pressed."""


@dataclass(frozen=True, slots=True, eq=False)
class TransformReading:
    """matrix: (4, 4) rigid, mm, its rotation made exactly orthonormal; None unless OK, and then reason says why."""

    matrix: Matrix4 | None
    status: PoseStatus
    reason: str = ""


def without_matrix(status: str, name: str) -> TransformReading:
    """What PLUS says of the transform `name` in place of OK, in capitals."""
    said = f"{printable(name)} is {printable(status)}"
    if status in WITHOUT_POSE:
        return TransformReading(None, WITHOUT_POSE[status], said)
    return TransformReading(None, PoseStatus.NOT_UNDERSTOOD, f"{said}, a word that is not known here")


def rigid_reading(matrix: Matrix4, name: str) -> TransformReading:
    """Refuse what is not rigid, by a marked reading; take the rounding of the digits sent out of what is."""
    if wrong := _no_pose(matrix):
        return TransformReading(None, PoseStatus.NOT_UNDERSTOOD, f"{printable(name)} {wrong}")
    u, _, vt = np.linalg.svd(matrix[:3, :3])
    rigid = np.eye(4)
    rigid[:3, :3], rigid[:3, 3] = u @ vt, matrix[:3, 3]
    return TransformReading(rigid, PoseStatus.OK)


def _no_pose(matrix: Matrix4) -> str:
    """Why it is none, in words; empty where it is one."""
    if not np.isfinite(matrix).all():
        return "is not finite"
    if why := _not_rigid(matrix):
        return f"is not a rotation and a translation: {why}"
    return "is further away than any tool" if np.abs(matrix[:3, 3]).max() > FURTHEST_MM else ""


def _not_rigid(matrix: Matrix4) -> str:
    """What it is instead, as its author would recognise it; empty where it is rigid."""
    R = matrix[:3, :3]
    if np.abs(matrix[3] - [0, 0, 0, 1]).max() > _ROTATION_TOLERANCE:
        transposed = np.abs(matrix[:, 3] - [0, 0, 0, 1]).max() <= _ROTATION_TOLERANCE
        return "it is transposed, with the translation in the last row" if transposed else "its last row is not 0 0 0 1"
    lengths = np.linalg.norm(R, axis=0)
    if not lengths.all():
        return "an axis is zero"
    axes = R / lengths
    if np.abs(axes.T @ axes - np.eye(3)).max() > _ROTATION_TOLERANCE:
        return "it is sheared, its axes are not at right angles"
    if np.abs(R.T @ R - np.eye(3)).max() > _ROTATION_TOLERANCE:
        said = " ".join(f"{length:.2g}" for length in lengths)
        return f"its axes have lengths {said}, not 1; a picture's scale belongs into ImageToProbe"
    return "it is left-handed, an axis is mirrored" if np.linalg.det(R) < 0 else ""
