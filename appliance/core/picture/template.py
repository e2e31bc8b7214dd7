"""Which points of a keyframe are looked at."""

import numpy as np

from appliance.core.picture.points import Picture, Template
from appliance.core.picture.pyramid import Bits, Level, mask_at

_EDGE_PX = 2
_LEAST_POINTS = 64
_LEAST_STEP = 3
_FLAT_SHARE = 0.02
_SPARE = 1.2


def template(
    level: Level, factor: float, centre: tuple[float, float], aspect: float, most: int, mask: Bits | None
) -> Template | None:
    """About `most` points of a level, spread evenly over what has structure; None where there is too little of it.

    Evenly, not the steepest: in speckle the steepest are the edges of nulls. mask: (h, w) of the full picture.
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
    return Template(picture.described(chosen, most), factor, centre, aspect)
