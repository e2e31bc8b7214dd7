"""What registration needs of a keyframe, worked out once: places, tones and steepest-descent images of its points."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.samples import GreyImage

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Bits = NDArray[np.bool_]
Pyramid = tuple[GreyImage, ...]

_LEVELS = 4
_ENOUGH = 2_000
_EDGE_PX = 2
_LEAST_POINTS = 64
_LEAST_STEP = 4
_FLAT_SHARE = 0.02


def pyramid(image: GreyImage) -> Pyramid:
    """(h, w) uint8 → levels, each half the size of the one before; row i is row 2i of the finer level."""
    levels = [image]
    while len(levels) < _LEVELS and min(levels[-1].shape) >= 32:
        levels.append(np.asarray(cv2.pyrDown(levels[-1]), dtype=np.uint8))
    return tuple(levels)


def centre_px(width: int, height: int) -> Array:
    """(2,) column and row of the image centre."""
    return np.array([(width - 1) / 2, (height - 1) / 2])


@dataclass(frozen=True, slots=True, eq=False)
class Template:
    """n points of one pyramid level, top to bottom.

    factor: px of the full picture per px of the level. places: (3, n) x, y px of the full picture from its centre, 1.
    grey: (n,). design: (5, n) ∂grey/∂(u_x, u_y, α), grey, 1. few: every thin-th column of it, (n ÷ thin, 5).
    """

    factor: float
    places: Array32
    grey: Array32
    design: Array32
    thin: int
    few: Array32


def template(
    image: GreyImage, factor: float, centre: Array, aspect: float, most: int, mask: Bits | None
) -> Template | None:
    """About `most` points of a level, spread evenly over what has structure; None where there is too little of it.

    Evenly, not the steepest: in speckle the steepest are the edges of nulls. mask: (h, w) of the full picture.
    """
    if min(image.shape) < 2 * _EDGE_PX + 1:
        return None
    mask = None if mask is None else _mask_at(mask, image.shape)
    slopes = _slope(image, 1, 0), _slope(image, 0, 1)
    pitch = max(int(np.sqrt(image.size / (2 * most))), 1)
    chosen = _structured(slopes, image.shape, pitch, mask)
    if pitch > 1 and chosen.size < most / 2:
        chosen = _structured(slopes, image.shape, 1, mask)
    if chosen.size < _LEAST_POINTS:
        return None
    if chosen.size > most:
        chosen = chosen[(np.arange(most) * (chosen.size / most)).astype(np.intp)]
    rows, columns = np.divmod(chosen.astype(np.int32), np.int32(image.shape[1]))
    x = (columns * factor - centre[0]).astype(np.float32)
    y = (rows * factor - centre[1]).astype(np.float32)
    grey = image.ravel()[chosen].astype(np.float32)
    gx, gy = (slope[chosen] * np.float32(0.125 / factor) for slope in slopes)
    turn = gy * x * np.float32(1 / aspect) - gx * y * np.float32(aspect)
    design = np.stack([gx, gy, turn, grey, np.ones_like(x)])
    thin = max(x.size // _ENOUGH, 1)
    few = np.ascontiguousarray(design[:, ::thin].T)
    return Template(factor, np.stack([x, y, design[4]]), grey, design, thin, few)


def _structured(
    slopes: tuple[NDArray[np.int16], ...], shape: tuple[int, ...], pitch: int, mask: Bits | None
) -> NDArray[np.intp]:
    """Flat indices of the pixels of a lattice that hold all but a fiftieth of its gradient energy; the flat rest says
    nothing. slopes: eightfold gradient across and down, (h · w,) each."""
    inner = np.s_[_EDGE_PX:-_EDGE_PX:pitch, _EDGE_PX:-_EDGE_PX:pitch]
    across, down = (slope.reshape(shape)[inner] for slope in slopes)
    steep = np.abs(across) + np.abs(down)
    counts = np.bincount(steep.ravel()[::4] >> 2, minlength=512)
    held = np.cumsum(counts * np.square(np.arange(float(counts.size))))
    chosen = steep > max(4 * int(np.searchsorted(held, _FLAT_SHARE * held[-1])), _LEAST_STEP)
    if mask is not None:
        chosen &= mask[inner]
    rows, columns = np.divmod(np.flatnonzero(chosen), chosen.shape[1])
    return np.asarray((rows * pitch + _EDGE_PX) * shape[1] + columns * pitch + _EDGE_PX, dtype=np.intp)


def _slope(image: GreyImage, across: int, down: int) -> NDArray[np.int16]:
    """(h · w,) eight times the gradient in one direction."""
    return np.asarray(cv2.Sobel(image, cv2.CV_16S, across, down), dtype=np.int16).ravel()


def _mask_at(mask: Bits, shape: tuple[int, ...]) -> Bits:
    """Mask at a coarser level; a coarse pixel counts only when all of its finer ones do."""
    if mask.shape == shape:
        return mask
    share = cv2.resize(mask.view(np.uint8) * np.uint8(255), (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
    return np.asarray(share > 252)
