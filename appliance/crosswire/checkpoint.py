"""Checks, as the last step of the procedure, whether a new calibration puts a point where it is. No calibration was
made from that point. Pure.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from probewatch.appliance.crosswire.offset import ScanRefused
from probewatch.appliance.crosswire.scan import View
from probewatch.appliance.types import Calibration, Vector

LEAST_VIEWS = 3
"""The least number of views, from as many sides; fewer agree too easily."""
PASS_MM = 1.0
"""RMS distance, mm, that passes: between the .5 mm that a guided scan gives on rendered scans and the 1.5 mm published
for crossed wires by hand (Prager and others 1998), so that a good scan passes and a usual one does not."""


@dataclass(frozen=True, slots=True, eq=False)
class PointCheck:
    """Holds the result of the check. points_mm: (N, 3) where each view puts the point, tracker axes. error_mm: RMS
    distance from where the point is.

    known: whether its place was measured by other means; otherwise their mean is used, and error_mm states how well
    they agree, corrected for having taken the mean from the same points. An error that all views share shows only where
    the place is known.
    """

    points_mm: Vector
    error_mm: float
    largest_mm: float
    known: bool

    @property
    def passed(self) -> bool:
        return self.error_mm <= PASS_MM


def reconstructed_mm(calibration: Calibration, views: Sequence[View]) -> Vector:
    """Returns where each view's picture point lies, (N, 3), tracker axes."""
    centre_px = (np.array(calibration.image_size_px) - 1) / 2
    signed = np.array(calibration.polarity) * calibration.scale_mm_per_px
    in_plane = np.array([(view.centre_px - centre_px) * signed for view in views])
    in_sensor = (np.column_stack([in_plane, np.zeros(len(views))]) - calibration.offset_mm) @ calibration.rotation
    poses = np.array([view.matrix for view in views])
    return np.asarray(np.einsum("nij,nj->ni", poses[:, :3, :3], in_sensor) + poses[:, :3, 3])


def check_point(calibration: Calibration, views: Sequence[View], known_mm: Vector | None = None) -> PointCheck:
    """Measures how far apart a calibration puts the views of one point. views: those of a crossing from which the
    calibration was not made. known_mm: (3,) where the point is, tracker axes, if known.

    Raises ScanRefused where it was seen from fewer than three sides.
    """
    if len(views) < LEAST_VIEWS:
        raise ScanRefused(
            f"the point was seen {len(views)} times, {LEAST_VIEWS} are needed",
            "check at an independent point",
            "Move the tank, and pass through the crossing again, with another tilt each time",
        )
    points = reconstructed_mm(calibration, views)
    where = points.mean(axis=0) if known_mm is None else known_mm
    lengths = np.linalg.norm(points - where, axis=1)
    free = len(points) - (1 if known_mm is None else 0)
    error_mm = float(np.sqrt(np.sum(lengths**2) / free))
    return PointCheck(points, error_mm, float(lengths.max()), known_mm is not None)
