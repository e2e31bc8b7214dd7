"""Computes how far two calibrations are from each other, in the quantities that the checks limit."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration


@dataclass(frozen=True, slots=True)
class Difference:
    """Holds how two calibrations differ. rotation_deg: the angle between them. scale_percent: (lateral, axial).
    offset_mm: (lateral, axial, elevational), along the picture axes. image_size_px: both sizes where they differ, else
    None.
    """

    rotation_deg: float
    scale_percent: tuple[float, float]
    offset_mm: tuple[float, float, float]
    same_polarity: bool
    image_size_px: tuple[tuple[int, int], tuple[int, int]] | None

    @property
    def distance_mm(self) -> float:
        """Returns the length of offset_mm."""
        return math.hypot(*self.offset_mm)

    def beyond(self, limits: Limits) -> bool:
        """Returns whether a check of one against the other would fail; if so, nothing verified of one says anything of
        the other.
        """
        return (
            not self.same_polarity
            or self.image_size_px is not None
            or self.rotation_deg > limits.rotation_deg
            or max(map(abs, self.scale_percent)) > limits.scale_percent
            or self.distance_mm > limits.offset_mm
        )

    @property
    def text(self) -> str:
        """Returns the difference in one line; a person who accepts the difference repeats it."""
        lateral, axial, elevational = self.offset_mm
        parts = [
            f"turned by {self.rotation_deg:.2f}°",
            f"moved by {self.distance_mm:.2f} mm"
            f" (lateral {lateral:+.2f}, axial {axial:+.2f}, elevational {elevational:+.2f})",
            f"scaled by {self.scale_percent[0]:+.2f} % laterally and {self.scale_percent[1]:+.2f} % axially",
        ]
        if not self.same_polarity:
            parts.append("mirrored the other way")
        if self.image_size_px is not None:
            before, after = (f"{width} x {height}" for width, height in self.image_size_px)
            parts.append(f"for pictures of {after} instead of {before} px")
        return ", ".join(parts)

    def fields(self) -> dict[str, Any]:
        """Returns the difference, ready for JSON."""
        return {
            "rotation_deg": self.rotation_deg,
            "scale_percent": list(self.scale_percent),
            "offset_mm": self.distance_mm,
            "offset_along_mm": list(self.offset_mm),
            "same_polarity": self.same_polarity,
            "same_image_size": self.image_size_px is None,
        }


def difference(before: Calibration, after: Calibration) -> Difference:
    """Returns what changes when `after` replaces `before`."""
    turn = before.rotation @ after.rotation.T
    cosine = (float(np.trace(turn)) - 1) / 2
    lateral, axial = (float(100 * change) for change in after.scale_mm_per_px / before.scale_mm_per_px - 1)
    x, y, z = (float(step) for step in after.offset_mm - before.offset_mm)
    sizes = before.image_size_px, after.image_size_px
    return Difference(
        rotation_deg=math.degrees(math.acos(min(max(cosine, -1.0), 1.0))),
        scale_percent=(lateral, axial),
        offset_mm=(x, y, z),
        same_polarity=before.polarity == after.polarity,
        image_size_px=None if sizes[0] == sizes[1] else sizes,
    )
