"""Computes the lower convex hull of readings of a device's clock."""

from collections import deque
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Reading:
    """Holds one reading of a device's clock. device_ns: device time since the start. late_ns: host time since the
    start, less device_ns.
    """

    device_ns: float
    late_ns: float


def lower_hull(readings: deque[Reading]) -> list[Reading]:
    """Returns the readings at the corners of the hull, in their order."""
    hull: list[Reading] = []
    for reading in readings:
        while len(hull) >= 2 and not _turns_up(hull[-2], hull[-1], reading):
            hull.pop()
        hull.append(reading)
    return hull


def _turns_up(a: Reading, b: Reading, c: Reading) -> bool:
    before = (b.late_ns - a.late_ns) * (c.device_ns - b.device_ns)
    return before < (c.late_ns - b.late_ns) * (b.device_ns - a.device_ns)
