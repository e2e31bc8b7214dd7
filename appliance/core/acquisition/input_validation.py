"""Decides what may enter the line. Whatever else a driver delivers is refused here with the reason, and not computed
with.
"""

from dataclasses import replace

import numpy as np

from probewatch.drivers.samples import GreyImage, Pose, PoseStatus

ORTHOGONAL_WITHIN = 1e-3
"""Largest error of any element of R Rᵀ. More could hide .06° of shear or .05 % of scale; the tightest limits are .5°
and .5 %. Less would refuse a matrix whose elements were rounded to three decimals. Not measured.
"""
FURTHEST_MM = 1e6
"""Largest distance of a body, mm, the same as in the drivers (drivers.trackers.pose_bounds). More lets in numbers that
the solver cannot square: 1e155 mm once ended the line with an exception. Less gains nothing: no tracker sees that far.
"""
_IDENTITY, _LAST_ROW = np.eye(3), np.array([0, 0, 0, 1])  # made once, as every pose is compared with them


def checked_pose(pose: Pose) -> Pose:
    """Returns the pose itself, or one NOT_UNDERSTOOD, with the reason, where its matrix is not a finite rigid
    transform; without the second body where that body's matrix is none.
    """
    if pose.matrix is None:
        return pose
    reason = _refused(pose.matrix)
    if reason:
        return Pose(pose.stamp, pose.sequence, None, pose.rms_mm, PoseStatus.NOT_UNDERSTOOD, reason)
    return replace(pose, witness=None) if pose.witness is not None and _refused(pose.witness) else pose


def refused_picture(image: GreyImage) -> str:
    """Returns why the picture cannot be used; empty where it can: (h, w) uint8, h and w positive."""
    if image.ndim != 2:
        return f"the picture has shape {image.shape}, not (height, width): convert colour to grey in the driver"
    if image.dtype != np.uint8:
        return f"the picture has {image.dtype} grey values, not 8 bits: convert them in the driver"
    return "" if image.size else "the picture is empty"


def _refused(matrix: np.ndarray) -> str:
    if matrix.shape != (4, 4):
        return f"pose matrix of shape {matrix.shape}, not (4, 4)"
    if not np.all(np.isfinite(matrix)):
        return "pose matrix with values that are not finite"
    R = matrix[:3, :3]
    rigid = np.abs(R @ R.T - _IDENTITY).max() <= ORTHOGONAL_WITHIN and np.linalg.det(R) > 0
    if not rigid or np.abs(matrix[3] - _LAST_ROW).max() > ORTHOGONAL_WITHIN:
        return "pose matrix that is not a rigid transform"
    return "pose matrix further away than any tool" if np.abs(matrix[:3, 3]).max() > FURTHEST_MM else ""
