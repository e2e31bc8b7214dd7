"""What registration needs of a keyframe, worked out once: places, tones and steepest-descent images of its points."""

from dataclasses import dataclass

import numpy as np

from appliance.core.geometry import Array
from appliance.core.points import Picture, Points
from appliance.core.pyramid import Bits, Level, mask_at

_EDGE_PX = 2
_LEAST_POINTS = 64
_LEAST_STEP = 3
_FLAT_SHARE = 0.02
_SPARE = 1.2
_SAMPLED = 2_000


@dataclass(frozen=True, slots=True, eq=False)
class Template:
    """Points of one pyramid level, top to bottom.

    factor: px of the full picture per px of the level. solver: (5, 5) inverse of Σ J Jᵀ, where J = (∂grey/∂u_x, ∂u_y,
    ∂α, grey, 1). energy: Σ of (∂u_x², ∂u_y², ∂α², 1).
    """

    factor: float
    points: Points
    solver: Array
    energy: tuple[float, ...]

    @classmethod
    def of(cls, factor: float, points: Points) -> "Template":
        """With the solver, which a part of the points gives well enough: it steers, it does not judge."""
        products = points.curvature(_SAMPLED)
        products.flat[::6] = products.diagonal() * (1 + 1e-9) + 1e-9
        return cls(factor, points, np.asarray(np.linalg.inv(products)), points.energy())

    def thinned(self, most: int) -> "Template":
        """The same with about `most` of the points."""
        return Template.of(self.factor, self.points.thinned(max(self.points.count // most, 1)))


def template(
    image: Level, factor: float, centre: tuple[float, float], aspect: float, most: int, mask: Bits | None
) -> Template | None:
    """About `most` points of a level, spread evenly over what has structure; None where there is too little of it.

    Evenly, not the steepest: in speckle the steepest are the edges of nulls. mask: (h, w) of the full picture.
    """
    if min(image.shape) < 2 * _EDGE_PX + 1:
        return None
    mask = None if mask is None else mask_at(mask, image.shape)
    picture = Picture(image)
    pitch = max(int(np.sqrt(image.size / (_SPARE * most))), 1)
    chosen = picture.structured(mask, pitch, _EDGE_PX, _FLAT_SHARE, _LEAST_STEP)
    if pitch > 1 and chosen.size < most / 2:
        chosen = picture.structured(mask, 1, _EDGE_PX, _FLAT_SHARE, _LEAST_STEP)
    if chosen.size < _LEAST_POINTS:
        return None
    left, top = ((factor - 1) / 2 - middle for middle in centre)
    return Template.of(factor, picture.describe(chosen, most, factor, left, top, aspect))
