"""Where bone, gas or a face off the skin leaves a shadow along the beam.

The edges of a shadow are strong and straight, and they turn with the probe instead of with the tissue. A fit that
follows them sees less turn than there is, so a healthy probe had a wrong offset (docs/method.md, section 3).
"""

import cv2
import numpy as np

from appliance.core.registration.pyramid import Bits, Level, Pyramid, mask_at
from drivers.samples import GreyImage

_LEVEL = 2
"""Which is looked at, a quarter of the picture's size: speckle is still several px wide."""
_ACROSS, _DOWN = 0.03, 0.12
"""Window of the mean change along a row, as shares of width and height: narrower than a rib's shadow, and longer than a
null of the speckle is high. Less takes nulls for shadows, more misses narrow ones. Not varied."""
_LEAST_CHANGE = 0.15
"""Of the mean change along a row, below which there is no speckle. More takes dim tissue for a shadow; less misses the
shadow of gas, whose bands ring. Chosen by looking at simulated ribs, gas and a face off the skin."""
_TALLEST_VESSEL = 0.25
"""Share of the picture's height from which what has no speckle is a shadow: they go on to the bottom. Not varied."""
_EDGE = 0.04
"""Share of the width by which a shadow is widened to either side: its soft edge, and the speckle that this spoils. More
leaves less tissue to look at, less leaves some of the edge. Not varied."""
_SECTOR_TALL = 0.5
"""Share of the picture's height over which a column of the sector is lit: more than four lines of text at its side.
More finds no shadows where tissue is dim at depth; with none, text made the sector wider, and its sides were left out.
"""
_MOST_SHARE = 0.5
"""Of what may be seen, above which nothing is a shadow: wires in water are spots of echo in nothing else."""


class Shadows:
    """Of one keyframe after the other, of one size. What was lit before belongs to the sector, and is in a shadow where
    it is lit no more.
    """

    def __init__(self) -> None:
        self._sector: Bits | None = None

    def outside(self, levels: Pyramid, mask: Bits | None) -> Bits | None:
        """Returns where tissue may be seen and lies in no shadow. mask, result: (h, w) bool of the picture, True where
        tissue may be seen; None for everywhere.
        """
        level = levels.levels[min(_LEVEL, levels.coarsest)]
        shadow = _tall(self._dark(level, None if mask is None else mask_at(mask, level.shape)))
        if not shadow.any():
            return mask
        height, width = levels.shape
        covered = cv2.resize(_widened(shadow), (width, height), interpolation=cv2.INTER_NEAREST) > 0
        return np.asarray(~covered if mask is None else mask & ~covered)

    def _dark(self, level: Level, seen: Bits | None) -> Bits:
        """(h, w): where hardly anything changes along a row, of the sector; nowhere if that is most of it."""
        change = np.zeros(level.shape, np.int16)
        cv2.absdiff(level[:, 2:], level[:, :-2], change[:, 1:-1])
        if seen is not None:
            change *= seen
        window = _odd(_ACROSS * level.shape[1]), _odd(_DOWN * level.shape[0])
        usual = cv2.mean(change, None if seen is None else seen.view(np.uint8))[0]
        lit = cv2.blur(change, window) >= _LEAST_CHANGE * usual
        sector = _between(lit)
        if seen is not None:  # Before, text that touches the sector is lit as well.
            self._sector = sector = sector if self._sector is None else sector | self._sector
        dark = sector & ~lit if seen is None else sector & ~lit & seen
        if np.count_nonzero(dark) > _MOST_SHARE * np.count_nonzero(sector):
            dark[:] = False
        return np.asarray(dark)


def _between(lit: Bits) -> Bits:
    """The least convex area that holds the largest piece of what is lit, where that is tall: text is low, and a sector
    is convex.
    """
    tall = np.ones((round(_SECTOR_TALL * lit.shape[0]), 1), np.uint8)
    lit = cv2.morphologyEx(lit.view(np.uint8), cv2.MORPH_OPEN, tall).view(np.bool_)
    _, labels, found, _ = cv2.connectedComponentsWithStats(lit.view(np.uint8), connectivity=4)
    found[0, cv2.CC_STAT_AREA] = 0  # What is not lit.
    piece = labels == int(np.argmax(found[:, cv2.CC_STAT_AREA]))
    rows = np.flatnonzero(piece.any(axis=1))
    ends = np.argmax(piece[rows], axis=1), lit.shape[1] - 1 - np.argmax(piece[rows, ::-1], axis=1)
    area = np.zeros(lit.shape, np.uint8)
    if len(found) > 1:
        points = np.concatenate([np.stack([columns, rows], axis=1) for columns in ends]).astype(np.int32)
        cv2.fillConvexPoly(area, cv2.convexHull(points), 1)
    return area.view(np.bool_)


def _tall(dark: Bits) -> Bits:
    """The pieces of it that are tall."""
    if not dark.any():
        return dark
    _, labels, found, _ = cv2.connectedComponentsWithStats(dark.view(np.uint8), connectivity=4)
    tall = found[:, cv2.CC_STAT_HEIGHT] >= _TALLEST_VESSEL * dark.shape[0]
    tall[0] = False  # What is not dark.
    return np.asarray(tall[labels])


def _widened(shadow: Bits) -> GreyImage:
    """1 where it is, by half the window, as the mean there still reaches beyond the edge, and by the edge."""
    kernel = np.ones((1, _odd((_ACROSS + 2 * _EDGE) * shadow.shape[1])), np.uint8)
    return np.asarray(cv2.dilate(shadow.view(np.uint8), kernel), dtype=np.uint8)


def _odd(px: float) -> int:
    return int(px) | 1
