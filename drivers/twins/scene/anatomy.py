"""Models what obstructs the beam: ribs and gas with their shadows, a face half off the skin, a needle. It is pure."""

from dataclasses import dataclass

import numpy as np

from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import Matrix4
from probewatch.drivers.twins.scene.tissue import Floats

RIB_DEPTH_MM, RIB_HALF_WIDTH_MM, RIB_HALF_THICK_MM = 8.0, 2.5, 1.5
"""Millimetres: depth of a rib at rest below the skin, and its size across and along the beam: under the skin of a thin
person. Not measured."""
_RIB_ECHO, _SHADOW, _EDGE_MM, _SURFACE_MM = 12.0, 0.015, 0.5, 0.2
"""Amplitude of bone relative to plain tissue, and the share that is left in its shadow, which noise hides; millimetres:
how softly the shadow begins on either side (the σ of the beam) and how thick the bone's line is (σ)."""
_RIB_SLANT = 0.15
"""Millimetres by which a rib goes sideways per mm out of the plane: a few millimetres in a sweep."""
RIBS_MM = {1: (4.0,), 2: (-7.5, 7.5)}
"""Lateral places of the ribs, mm, by their number. Two leave 10 mm of tissue to be seen between them."""

_GAS_RINGS, _GAS_RING_MM = 0.35, 1.3
"""Bands that ring below gas, which make its shadow grey: amplitude relative to plain tissue, and distance of the
bands."""

FACE_SHARE = 0.68
"""Half the width that counts as the face, as a share of half the picture: that of the sector half way down."""
_LOST, _RINGING, _RINGING_MM, _FADES_MM = 0.01, 1.5, 1.6, 4.0
"""Share of the echoes that is left where the face is off the skin; the bands that ring between lens and air: amplitude
relative to plain tissue, distance, and the depth over which they fade."""

_PEEL_S = 6.0
"""Seconds in which one side of the face comes off the skin and back, as when a hand searches. Not measured."""

_NEEDLE_FROM_MM, _NEEDLE_DEG = (-14.0, -9.0), 35.0
"""Millimetres from the middle of the picture at which a needle in a guide enters, and how steep it is: as for a biopsy
in the plane."""
_NEEDLE_MM, _STROKE_MM, _STROKE_S = 16.0, 8.0, 6.0
"""Millimetres: how far the needle's tip is in, and how far and how quickly (seconds) it goes in and out."""
_NEEDLE_ECHO, _NEEDLE_WIDE_MM = 15.0, 0.2
"""Amplitude relative to plain tissue, and σ of the line."""


@dataclass(frozen=True, slots=True)
class Beams:
    """Holds where each pixel lies, (h, w): beam, mm across the face, and depth, mm below it."""

    across_mm: Floats
    depth_mm: Floats


def rib_place(rib_mm: float, skin_mm: float, pose: Matrix4) -> Array:
    """Returns the point of the tissue, (3,), where the middle of a rib at rest goes through the picture; a rib runs out
    of the plane.
    """
    along = np.array([_RIB_SLANT, 0.0, 1.0])
    start = np.array([rib_mm, skin_mm + RIB_DEPTH_MM + RIB_HALF_THICK_MM, 0.0])
    normal = pose[:3, 2]
    return np.asarray(start + along * (normal @ (pose[:3, 3] - start)) / (normal @ along))


def shadowed(beams: Beams, across_mm: float, depth_mm: float, spread: float) -> tuple[Floats, Floats]:
    """Returns (gain, added) of a bone whose middle lies on this beam: its surface, and a shadow along the beam below
    it. spread: mm across the picture per mm across the face where the bone lies.
    """
    aside = (beams.across_mm - np.float32(across_mm)) * np.float32(spread)
    under = np.clip((RIB_HALF_WIDTH_MM - np.abs(aside)) / _EDGE_MM + 0.5, 0, 1)
    bulge = np.sqrt(np.clip(1 - (aside / RIB_HALF_WIDTH_MM) ** 2, 0, 1))
    below = beams.depth_mm - (depth_mm - RIB_HALF_THICK_MM * bulge)
    gain = 1 - (1 - _SHADOW) * under * np.clip(below / _SURFACE_MM, 0, 1)
    added = _RIB_ECHO * bulge * np.exp(-((below / _SURFACE_MM) ** 2) / 2)
    return gain.astype(np.float32), added.astype(np.float32)


def ringing(gain: Floats, beams: Beams, depth_mm: float) -> Floats:
    """Returns the amplitude, (h, w), of the bands in the shadow of gas at this depth; they lie at the same depths below
    its surface in every picture.
    """
    below = beams.depth_mm - np.float32(depth_mm)
    return np.asarray(_GAS_RINGS * (1 - gain) * (0.6 + 0.4 * np.cos(2 * np.pi * below / _GAS_RING_MM)), np.float32)


def peeled(share: float, t_s: float) -> float:
    """Returns the share of the face that touches now, of one that comes off to `share` and back."""
    return float(1 - (1 - share) * (1 - np.cos(2 * np.pi * t_s / _PEEL_S)) / 2)


def off_the_skin(beams: Beams, share: float) -> tuple[Floats, Floats]:
    """Returns (gain, added) of a face that touches with this share of its width, counted from one side."""
    half_mm = FACE_SHARE * float(np.abs(beams.across_mm[-1]).max())
    off = np.clip((beams.across_mm - half_mm * (2 * share - 1)) / _EDGE_MM + 0.5, 0, 1)
    bands = np.cos(np.pi * beams.depth_mm / _RINGING_MM) ** 8 * np.exp(-beams.depth_mm / _FADES_MM)
    return (1 - (1 - _LOST) * off).astype(np.float32), (_RINGING * off * bands).astype(np.float32)


def needle(x_mm: Array, y_mm: Array, t_s: float) -> Floats:
    """Returns the amplitude, (h, w), of a needle that goes in and out in its guide. x_mm (w,), y_mm (h, 1): from the
    middle.
    """
    steep = np.radians(_NEEDLE_DEG)
    right, down = x_mm - _NEEDLE_FROM_MM[0], y_mm - _NEEDLE_FROM_MM[1]
    along, off = right * np.cos(steep) + down * np.sin(steep), down * np.cos(steep) - right * np.sin(steep)
    tip_mm = _NEEDLE_MM + _STROKE_MM / 2 * np.sin(2 * np.pi * t_s / _STROKE_S)
    inside = np.clip((tip_mm - along) / _EDGE_MM + 0.5, 0, 1)
    return np.asarray(_NEEDLE_ECHO * inside * np.exp(-((off / _NEEDLE_WIDE_MM) ** 2) / 2), np.float32)
