"""What registration needs of a keyframe, worked out once: places, tones and steepest-descent images of its points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from appliance.core.geometry import Array
from appliance.core.pyramid import Array32, Bits, Picture, mask_at

_EDGE_PX = 2
_LEAST_POINTS = 64
_LEAST_STEP = 3
_FLAT_SHARE = 0.02
_SPARE = 1.2
_SAMPLED = 2_000


@dataclass(frozen=True, slots=True, eq=False)
class Template:
    """n points of one pyramid level, top to bottom.

    factor: px of the full picture per px of the level. places: (3, n) x, y px of the full picture from its centre, 1.
    design: (5, n) ∂grey/∂(u_x, u_y, α), grey, 1. solver: (5, 5) inverse of the sum of their products.
    shares: (4, n) of each point in the sums of the squares of ∂grey/∂(u_x, u_y, α), and in the number of points.
    """

    factor: float
    places: Array32
    design: Array32
    solver: Array
    shares: Array32

    @property
    def grey(self) -> Array32:
        """(n,)."""
        return np.asarray(self.design[3], dtype=np.float32)

    @classmethod
    def of(cls, factor: float, places: Array32, design: Array32) -> "Template":
        """With the solver, which a part of the points gives well enough: it steers, it does not judge."""
        few = design[:, :: max(design.shape[1] // _SAMPLED, 1)]
        products = (few @ few.T).astype(np.float64) * (design.shape[1] / few.shape[1])
        products.flat[::6] = products.diagonal() * (1 + 1e-9) + 1e-9
        shares = np.square(design[[0, 1, 2, 4]])
        shares /= np.maximum(shares.sum(axis=1, keepdims=True), 1e-9)
        return cls(factor, places, design, np.asarray(np.linalg.inv(products), dtype=np.float64), shares)

    def thinned(self, most: int) -> "Template":
        """The same with about `most` of the points."""
        each = max(self.grey.size // most, 1)
        places, design = (np.ascontiguousarray(part[:, ::each]) for part in (self.places, self.design))
        return Template.of(self.factor, places, design)


def template(
    image: Picture, factor: float, centre: Array, aspect: float, most: int, mask: Bits | None
) -> Template | None:
    """About `most` points of a level, spread evenly over what has structure; None where there is too little of it.

    Evenly, not the steepest: in speckle the steepest are the edges of nulls. mask: (h, w) of the full picture.
    """
    if min(image.shape) < 2 * _EDGE_PX + 1:
        return None
    mask = None if mask is None else mask_at(mask, image.shape)
    lattice = _Lattice.of(image, max(int(np.sqrt(image.size / (_SPARE * most))), 1), mask)
    if lattice.pitch > 1 and lattice.structured.size < most / 2:
        lattice = _Lattice.of(image, 1, mask)
    chosen = lattice.structured
    if chosen.size < _LEAST_POINTS:
        return None
    if chosen.size > most:
        chosen = chosen[(np.arange(most) * (chosen.size / most)).astype(np.intp)]
    rows, columns = lattice.places(chosen)
    middle = centre - (factor - 1) / 2
    places, design = np.ones((3, chosen.size), np.float32), np.ones((5, chosen.size), np.float32)
    x, y = places[:2] = columns * factor - middle[0], rows * factor - middle[1]
    gx, gy = design[:2] = lattice.steps.reshape(2, -1).take(chosen, axis=1) * np.float32(0.5 / factor)
    design[2] = gy * (x / aspect) - gx * (y * aspect)
    design[3] = image.ravel().take(rows * image.shape[1] + columns)
    return Template.of(factor, places, design)


@dataclass(frozen=True, slots=True, eq=False)
class _Lattice:
    """Every pitch-th pixel of a picture, (rows, columns) of them.

    steps: (2, rows, columns) grey of the neighbour to the right minus left, below minus above. structured: flat indices
    of those that hold all but a fiftieth of the gradient energy; the flat rest says nothing.
    """

    pitch: int
    steps: Array32
    structured: NDArray[np.intp]

    @classmethod
    def of(cls, image: Picture, pitch: int, mask: Bits | None) -> "_Lattice":
        across = _every(image, pitch, 0, 1), _every(image, pitch, 0, -1)
        down = _every(image, pitch, 1, 0), _every(image, pitch, -1, 0)
        steps = np.stack([np.subtract(*pair, dtype=np.float32) for pair in (across, down)])
        steep = np.abs(steps[0]) + np.abs(steps[1])
        counts = np.bincount(steep.ravel()[::4].astype(np.intp))
        held = np.cumsum(counts * np.square(np.arange(float(counts.size))))
        structured = steep > max(int(np.searchsorted(held, _FLAT_SHARE * held[-1])), _LEAST_STEP)
        if mask is not None:
            structured &= _every(mask, pitch, 0, 0)
        return cls(pitch, steps, np.flatnonzero(structured))

    def places(self, chosen: NDArray[np.intp]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Rows and columns of the picture, (n,) each."""
        rows, columns = np.divmod(chosen.astype(np.int32), np.int32(self.steps.shape[2]))
        return rows * np.int32(self.pitch) + np.int32(_EDGE_PX), columns * np.int32(self.pitch) + np.int32(_EDGE_PX)


def _every(picture: Picture | Bits, pitch: int, down: int, right: int) -> Picture | Bits:
    """Every pitch-th pixel but the edge's, moved by one where asked."""
    height, width = picture.shape
    rows = slice(_EDGE_PX + down, height - _EDGE_PX + down, pitch)
    return picture[rows, _EDGE_PX + right : width - _EDGE_PX + right : pitch]
