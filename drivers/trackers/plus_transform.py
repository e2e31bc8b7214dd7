"""Reads a transform as PLUS writes it, in a recording or over the network: the result is a rigid matrix, or the reason
why there is none.
"""

from dataclasses import dataclass

import numpy as np

from probewatch.drivers.printable import printable
from probewatch.drivers.samples import Matrix4, PoseStatus
from probewatch.drivers.trackers.pose_bounds import FURTHEST_MM

_ROTATION_TOLERANCE = 2e-3
"""Largest error of RᵀR and of the last row that counts as rounding: PLUS prints six digits, and three would err by
1.7e-3. More takes a scaled matrix for a pose; an axis 2 % too long is refused
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
"""Status words of PLUS without a pose. MISSING: a tool or port that is absent. OUT_OF_VIEW: a tool that is not seen."""


GOOD = ("OK", "SWITCH1_IS_ON", "SWITCH2_IS_ON", "SWITCH3_IS_ON")
"""Status words of PLUS for a good pose. For a tool with buttons the word states which one is pressed."""


@dataclass(frozen=True, slots=True, eq=False)
class TransformReading:
    """Holds one transform that was read. matrix: (4, 4) rigid, mm, its rotation made exactly orthonormal; None unless
    status is OK, and then reason says why.
    """

    matrix: Matrix4 | None
    status: PoseStatus
    reason: str = ""


def without_matrix(status: str, name: str) -> TransformReading:
    """Returns the reading for the word, in capitals, that PLUS sends for the transform `name` in place of OK."""
    said = f"{printable(name)} is {printable(status)}"
    if status in WITHOUT_POSE:
        return TransformReading(None, WITHOUT_POSE[status], said)
    return TransformReading(None, PoseStatus.NOT_UNDERSTOOD, f"{said}, a word that is not known here")


def rigid_reading(matrix: Matrix4, name: str) -> TransformReading:
    """Returns the reading of a matrix, with the rounding of the transmitted digits removed. A matrix that is not rigid
    is refused: its reading has no pose, and states the reason.
    """
    if not matrix[:3].any():
        return _not_measured(name)
    if wrong := _no_pose(matrix):
        return TransformReading(None, PoseStatus.NOT_UNDERSTOOD, f"{printable(name)} {wrong}")
    u, _, vt = np.linalg.svd(matrix[:3, :3])
    rigid = np.eye(4)
    rigid[:3, :3], rigid[:3, 3] = u @ vt, matrix[:3, 3]
    return TransformReading(rigid, PoseStatus.OK)


def without_identity(reading: TransformReading, name: str) -> TransformReading:
    """Returns the reading, without a pose where its matrix is the identity. Programs write the identity, or zeros, for
    a tool that is not seen; no tool is at the tracker's own origin.
    """
    return _not_measured(name) if is_identity(reading) else reading


def is_identity(reading: TransformReading) -> bool:
    return reading.matrix is not None and np.array_equal(reading.matrix, np.eye(4))


def _not_measured(name: str) -> TransformReading:
    reason = f"{printable(name)} is not a measurement (identity or zeros)"
    return TransformReading(None, PoseStatus.MISSING, reason)


def _no_pose(matrix: Matrix4) -> str:
    """Returns why the matrix is no pose, in words; empty where it is one."""
    if not np.isfinite(matrix).all():
        return "is not finite"
    if why := _not_rigid(matrix):
        return f"is not a rotation and a translation: {why}"
    return "is further away than any tool" if np.abs(matrix[:3, 3]).max() > FURTHEST_MM else ""


def _not_rigid(matrix: Matrix4) -> str:
    """Returns what the matrix is instead of rigid, in terms that its author would recognise; empty if it is rigid."""
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
