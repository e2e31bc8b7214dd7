"""Poses as the regression logs state them: JSON with absolute numbers, one entry for each measurement of the device."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from probewatch.drivers.samples import Pose, PoseStatus


def decoded(poses: Iterable[Pose]) -> list[dict[str, Any]]:
    """What does not depend on how fast the host was: no times, and nothing about poses that were late."""
    return [_entry(pose) for pose in poses if pose.status is not PoseStatus.STALE]


def _entry(pose: Pose) -> dict[str, Any]:
    entry: dict[str, Any] = {"frame": pose.sequence, "status": pose.status.value, "reason": pose.reason}
    if not np.isnan(pose.rms_mm):
        entry["rms_mm"] = round(pose.rms_mm, 4)
    if pose.matrix is not None:
        entry["matrix"] = np.round(pose.matrix[:3], 5).tolist()
    return entry
