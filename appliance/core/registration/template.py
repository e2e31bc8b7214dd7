"""Chooses the points of a keyframe that registration uses."""

import numpy as np

from probewatch.appliance.core.registration.points import Picture, Template
from probewatch.appliance.core.registration.pyramid import Bits, Level, mask_at

_EDGE_PX = 2
"""px at the sides from which no point is taken: a gradient reaches 1 px to either side, and each pixel of the finest
level is the sum of 3 × 3."""
_LEAST_POINTS = 64
"""Fewest points, as many as a descent needs in view (LEAST_SEEN of descent.c): with fewer every registration would be
lost."""
_LEAST_STEP = 3
"""Least gradient, greys across plus down, over 2 px. Flatter pixels hold the rounding of greys and the noise of black.
"""
_FLAT_SHARE = 0.02
"""Share of the energy of the gradient that may be left out. A larger one takes fewer points, and in speckle leaves the
nulls out; a smaller one spends points on pixels that show nothing. Not measured.
"""
_SPARE = 1.2
"""Ratio of points that are examined to those that are wanted, because flat and hidden ones drop out; where too few are
left, every pixel is examined."""


def template(
    level: Level,
    factor: float,
    centre: tuple[float, float],
    aspect: float,
    fading: float,
    most: int,
    mask: Bits | None,
) -> Template | None:
    """Returns about `most` points of a level, spread evenly over what has structure; None where there is too little.

    The steepest points are not preferred: in speckle those are the edges of nulls. mask: (h, w) of the full picture.
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
