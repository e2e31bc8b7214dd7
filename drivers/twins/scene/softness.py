"""Computes how soft tissue moves under the face of a probe. It is pure.

All quantities are in the axes of the tissue, mm: x lateral, y down from the skin, z out of the plane. The share f of
the press p that tissue follows falls with the depth d below the face; what is pressed together gives way sideways, and
the skin follows a slide until it slips:

    u_y = f(d) (p + s h)                          h = x − middle of the face, s the slope of the face along x
    u_x = −ν f'(d) ∫ (p + s h) dh + w_x exp(−d ÷ a₂)
    u_z = −ν f'(d) (p + s h) (z − z₀) + w_z exp(−d ÷ a₂)

d is measured from the face as it lies now, so in the picture the tissue moves by (f(d) − 1) p. The strains sum to f' (p
+ s h) (1 − 2 ν) to first order: nothing at ν = ½. The model leaves out the tilt across the thin side of the face,
friction against a press, muscles, and any memory but that of the skin.
"""

from dataclasses import dataclass
from math import hypot, inf

import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.rigid import Array

DRAG_DEPTH_MM = 12.0
"""a₂, millimetres over which the drag of the skin falls to a third. Half as much leaves it to the upper quarter of a
picture, twice as much drags what lies 3 cm deep. 10 to 15 mm are reported for skin over fat; not measured here."""
GIVES_WAY = 0.5
"""ν of tissue, which is mostly water: the strain to either side for one along the press. Less lets it be compressed."""


@dataclass(frozen=True, slots=True)
class Follow:
    """Describes how tissue follows a press: f(d) = whole (1 − d ÷ back) ÷ (1 + d ÷ half width), 0 from the back on.

    back_mm: depth of a rigid back, such as a table or a bone. half_width_mm: that of the face on a half space. whole:
    share at the skin: 1 for a patient, 0 for what is rigid, between for a phantom on foam that moves as a whole.
    """

    whole: float = 0.0
    back_mm: float = inf
    half_width_mm: float = inf

    def share(self, depth_mm: Array) -> Array:
        """Returns f at depths; places above the face count as on the face."""
        d = np.maximum(depth_mm, 0.0)
        return np.asarray(self.whole * np.maximum(1 - d / self.back_mm, 0.0) / (1 + d / self.half_width_mm))

    def slope(self, depth_mm: Array) -> Array:
        """Returns f', per mm."""
        d = np.maximum(depth_mm, 0.0)
        near, left = 1 / (1 + d / self.half_width_mm), np.maximum(1 - d / self.back_mm, 0.0)
        steep = (d < self.back_mm) / self.back_mm * near + left / self.half_width_mm * near**2
        return np.asarray(-self.whole * steep)


@dataclass(frozen=True, slots=True)
class Face:
    """Describes how the face of the probe lies. middle_mm: (3,). press_mm: how far below the skin at rest its middle
    is. slope: how much deeper it lies per mm along x. drag_mm: (2,) drag of the skin, lateral and elevational.
    """

    middle_mm: Array
    press_mm: float
    slope: float
    drag_mm: Array


def displacement(points_mm: Array, face: Face, follow: Follow, aside_mm: tuple[float, float] = (0.0, 0.0)) -> Array:
    """Returns how far tissue has moved from rest, (3, …) mm. points_mm: (3, …) where it is now.

    aside_mm: from where it gives way, lateral and elevational of the middle of the face: no patient is alike on both
    sides of a picture, and what lies there leaves the plane when it is pressed.
    """
    here, beside = points_mm[0] - face.middle_mm[0], points_mm[2] - face.middle_mm[2]
    depth = points_mm[1] - face.middle_mm[1] - face.slope * here
    press, steep = face.press_mm + face.slope * here, follow.slope(depth)
    gathered = face.press_mm * (here - aside_mm[0]) + face.slope / 2 * (here**2 - aside_mm[0] ** 2)
    dragged = np.exp(-np.maximum(depth, 0.0) / DRAG_DEPTH_MM)
    return np.stack(
        [
            face.drag_mm[0] * dragged - GIVES_WAY * steep * gathered,
            follow.share(depth) * press,
            face.drag_mm[1] * dragged - GIVES_WAY * steep * press * (beside - aside_mm[1]),
        ]
    )


def dragged(held_mm: Array, step_mm: Array, play_mm: float) -> Array:
    """Returns how far the face holds the skin from its rest, (2,) lateral and elevational, after a small step over it:
    the skin sticks up to play_mm in any direction, and slips from there on.

    After a turn the skin is carried from one end of its play to the other before the face slips again.
    """
    pulled = held_mm + step_mm
    return np.asarray(pulled * min(1.0, play_mm / max(hypot(*pulled), 1e-12)))


def dragged_along(way_mm: Array, play_mm: float, touches: NDArray[np.bool_]) -> Array:
    """Returns `dragged`, (n, 2), along the whole path of the face, (n, 2). Where the face is off the skin, the skin
    goes back.
    """
    held = np.zeros_like(way_mm)
    for k in range(1, len(way_mm)):
        if touches[k]:
            held[k] = dragged(held[k - 1], way_mm[k] - way_mm[k - 1], play_mm)
    return held
