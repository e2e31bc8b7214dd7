"""Computes where the pixels of a picture lie: beside one another from a straight face, or in a fan from a curved
one.
"""

from dataclasses import dataclass

import numpy as np

from probewatch.drivers.rigid import Array
from probewatch.drivers.twins.scene.anatomy import Beams


@dataclass(frozen=True, slots=True)
class Geometry:
    """Represents a picture's geometry. apex_mm: y from the middle of the picture where the beams of a fan meet, above
    it; None where they run straight down. The face is the upper edge, or the arc about the apex that touches it.
    """

    size_px: tuple[int, int]
    scale_mm_per_px: tuple[float, float]
    apex_mm: float | None = None

    @property
    def skin_mm(self) -> float:
        """Returns y of the middle of the face."""
        return -self.size_px[1] * self.scale_mm_per_px[1] / 2

    @property
    def x_mm(self) -> Array:
        """Returns the columns, (w,) mm from the middle."""
        return np.asarray((np.arange(self.size_px[0]) - (self.size_px[0] - 1) / 2) * self.scale_mm_per_px[0])

    @property
    def y_mm(self) -> Array:
        """Returns the rows, (h, 1) mm from the middle."""
        down = np.arange(self.size_px[1])[:, None] - (self.size_px[1] - 1) / 2
        return np.asarray(down * self.scale_mm_per_px[1])

    def beam(self, x_mm: Array, y_mm: Array) -> tuple[Array, Array, Array]:
        """Returns how far across the face the beam through a place leaves, how deep the place is, and how many mm
        across the picture correspond to one mm across the face there.
        """
        if self.apex_mm is None:
            return x_mm, y_mm - self.skin_mm, np.ones_like(x_mm)
        face_mm, radius_mm = self.skin_mm - self.apex_mm, np.hypot(x_mm, y_mm - self.apex_mm)
        return np.arctan2(x_mm, y_mm - self.apex_mm) * face_mm, radius_mm - face_mm, radius_mm / face_mm

    def beams(self) -> Beams:
        """Returns the beam of every pixel."""
        x_mm, y_mm = np.broadcast_arrays(self.x_mm, self.y_mm)
        across_mm, depth_mm, _ = self.beam(x_mm, y_mm)
        return Beams(across_mm.astype(np.float32), depth_mm.astype(np.float32))
