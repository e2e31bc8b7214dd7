"""Finds where bone, gas or a face off the skin casts a shadow along the beam.

The edges of a shadow are strong and straight, and they turn with the probe instead of with the tissue. A fit that
follows them sees less turn than there is, so that a healthy probe had a wrong offset (docs/method.md, section 3): of
.3° over two ribs, registration found .286°, and .14° where tissue may give way.
"""

import cv2
import numpy as np

from probewatch.appliance.core.registration.pyramid import Bits, Level, Pyramid, mask_at
from probewatch.drivers.samples import GreyImage

_LEVEL = 2
"""Index of the level that is examined, a quarter of the picture's size: speckle is still several px wide."""
_ACROSS, _DOWN = 0.03, 0.12
"""Window of the mean change along a row, as shares of width and height: narrower than a rib's shadow, and taller than a
null of the speckle. A smaller one takes nulls for shadows; a larger one misses narrow shadows. Not varied."""
_LEAST_CHANGE = 0.25
"""Share of the mean change along a row below which the picture shows no speckle. A higher one takes dim tissue for a
shadow; a lower one misses the shadow of gas, whose bands ring: .15 missed it in a third of the keyframes, .2 in 3 %,
.25 in 2 %; none was found in twelve sessions without shadows. Chosen by looking at simulated ribs, gas and a face off
the skin."""
_TALLEST_VESSEL = 0.25
"""Share of the picture's height from which an area without speckle is a shadow: a shadow reaches the picture's bottom.
A higher one misses shadows of deep bone; a lower one takes vessels for shadows. Not varied."""
_EDGE = 0.04
"""Share of the width by which a shadow is widened to either side: its soft edge, and the speckle that this spoils. A
larger one leaves less tissue to look at; a smaller one leaves some of the edge. Not varied."""
_SECTOR_TALL = 0.5
"""Share of the picture's height over which a column of the sector is lit: more than four lines of text at its side. A
higher one finds no shadows where tissue is dim at depth; without it, text made the sector wider, and its sides were
left out."""
_MOST_SHARE = 0.5
"""Share of the sector beyond which an area without speckle is not a shadow: a picture of wires in water is mostly
black."""


class Shadows:
    """Finds the shadows of each keyframe.

    The sector is learned from all keyframes so far, which have one size: a side that showed speckle once and shows none
    now lies in a shadow.
    """

    def __init__(self) -> None:
        self._sector: Bits | None = None
        self.clear_share = 1.0
        """Share of the latest picture that is in the sector and in no shadow; 1 while the sector is not known."""

    def outside(self, levels: Pyramid, mask: Bits | None) -> Bits | None:
        """Returns where tissue may be seen and lies in no shadow.

        mask, result: (h, w) bool of the picture, True where tissue may be seen; None for everywhere.
        """
        level = levels.levels[min(_LEVEL, levels.coarsest)]
        seen = None if mask is None else mask_at(mask, level.shape)
        shadow = _tall(self._dark(_lit(level, seen), seen))
        widened = _widened(shadow) if shadow.any() else None
        if self._sector is not None:
            clear = self._sector if widened is None else self._sector & (widened == 0)
            self.clear_share = float(np.mean(clear))
        if widened is None:
            return mask
        height, width = levels.shape
        covered = cv2.resize(widened, (width, height), interpolation=cv2.INTER_NEAREST) > 0
        return np.asarray(~covered if mask is None else mask & ~covered)

    def _dark(self, lit: Bits, seen: Bits | None) -> Bits:
        """Returns the parts of the sector without speckle, (h, w) bool; none where they are most of it."""
        sector, without = _between(lit), ~lit
        if seen is not None:
            # Without a mask, text that touches the sector is lit too, so such a sector is not remembered.
            self._sector = sector = sector if self._sector is None else sector | self._sector
            without &= seen
        dark = sector & without
        if np.count_nonzero(dark) > _MOST_SHARE * np.count_nonzero(sector):
            dark[:] = False
        return np.asarray(dark)


def _lit(level: Level, seen: Bits | None) -> Bits:
    """Returns where the picture changes along its rows as speckle does, (h, w) bool."""
    change = np.zeros(level.shape, np.int16)
    cv2.absdiff(level[:, 2:], level[:, :-2], change[:, 1:-1])
    if seen is not None:
        change *= seen
    window = _odd(_ACROSS * level.shape[1]), _odd(_DOWN * level.shape[0])
    usual = cv2.mean(change, None if seen is None else seen.view(np.uint8))[0]
    return np.asarray(cv2.blur(change, window) >= _LEAST_CHANGE * usual)


def _between(lit: Bits) -> Bits:
    """Returns the convex hull of the largest tall piece of what is lit: a sector is convex, and text is low."""
    column = np.ones((round(_SECTOR_TALL * lit.shape[0]), 1), np.uint8)
    tall = cv2.morphologyEx(lit.view(np.uint8), cv2.MORPH_OPEN, column)
    area = np.zeros(lit.shape, np.uint8)
    if tall.any():
        _, labels, found, _ = cv2.connectedComponentsWithStats(tall, connectivity=4)
        piece = labels == 1 + int(np.argmax(found[1:, cv2.CC_STAT_AREA]))
        rows = np.flatnonzero(piece.any(axis=1))
        ends = np.argmax(piece[rows], axis=1), lit.shape[1] - 1 - np.argmax(piece[rows, ::-1], axis=1)
        points = np.concatenate([np.stack([columns, rows], axis=1) for columns in ends]).astype(np.int32)
        cv2.fillConvexPoly(area, cv2.convexHull(points), 1)
    return area.view(np.bool_)


def _tall(dark: Bits) -> Bits:
    """Returns the pieces that are taller than a vessel, (h, w) bool."""
    if not dark.any():
        return dark
    _, labels, found, _ = cv2.connectedComponentsWithStats(dark.view(np.uint8), connectivity=4)
    tall = found[:, cv2.CC_STAT_HEIGHT] >= _TALLEST_VESSEL * dark.shape[0]
    tall[0] = False  # Label 0 is what is not dark.
    return np.asarray(tall[labels])


def _widened(shadow: Bits) -> GreyImage:
    """Returns the shadow, (h, w) of 0 and 1, widened to either side by half the window and by the edge.

    Within half the window, the mean still reaches beyond the edge.
    """
    kernel = np.ones((1, _odd((_ACROSS + 2 * _EDGE) * shadow.shape[1])), np.uint8)
    return np.asarray(cv2.dilate(shadow.view(np.uint8), kernel), dtype=np.uint8)


def _odd(px: float) -> int:
    return int(px) | 1
