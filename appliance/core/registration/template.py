"""Which points of a keyframe are looked at."""

import numpy as np

from probewatch.appliance.core.registration.points import Picture, Template
from probewatch.appliance.core.registration.pyramid import Bits, Level, mask_at

_EDGE_PX = 2
"""A gradient looks 1 px to either side, and each pixel of the finest level is the sum of 3 × 3."""
_LEAST_POINTS = 64
"""As many as a descent needs in view, LEAST_SEEN of descent.c: with fewer every registration would be lost."""
_LEAST_STEP = 3
"""Greys, across plus down, over 2 px. Flatter pixels hold the rounding of greys and the noise of black."""
_FLAT_SHARE = 0.02
"""Share of the energy of the gradient that may be left out. More takes fewer points, and in speckle leaves the nulls
alone; less spends points on pixels that say nothing. Not measured.
"""
_SPARE = 1.2
"""How many more points than wanted are looked at, as flat and hidden ones fall out; too few, and every pixel is."""


def template(
    level: Level,
    factor: float,
    centre: tuple[float, float],
    aspect: float,
    fading: float,
    most: int,
    mask: Bits | None,
) -> Template | None:
    """About `most` points of a level, spread evenly over what has structure; None where there is too little of it.

    Evenly, not the steepest: in speckle the steepest are the edges of nulls. mask: (h, w) of the full picture.
    fading: px of depth over which the drag of the skin falls to 1/e.
    """
    if min(level.shape) < 2 * _EDGE_PX + 1:
        return None
    mask = None if mask is None else mask_at(mask, level.shape)
    picture = Picture(level)
    pitch = max(int(np.sqrt(level.size / (_SPARE * most))), 1)
    chosen = picture.structured(mask, pitch, _EDGE_PX, _FLAT_SHARE, _LEAST_STEP)
    if pitch > 1 and chosen.size < most / 2:
        chosen = picture.structured(mask, 1, _EDGE_PX, _FLAT_SHARE, _LEAST_STEP)
    if chosen.size < _LEAST_POINTS:
        return None
    return Template(picture.described(chosen, most), factor, centre, aspect, fading)
