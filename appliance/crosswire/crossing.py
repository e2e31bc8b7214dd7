"""Where two crossed wires meet in a B-mode picture of a water tank. Pure.

Away from their crossing the plane cuts the wires in two spots; nearer, the spots melt into one V or X; at the crossing
they lie on one another, point-symmetric about it. So one compact spot is a sighting, and the narrowest of a series of
sightings is the passage through the crossing.
"""

from dataclasses import dataclass
from enum import Enum

import cv2
import numpy as np
from numpy.typing import NDArray

from appliance.types import Vector
from drivers.samples import GreyImage

_SMOOTH_PX = 1.5
"""Sigma, before a spot is looked for: a single hot pixel keeps 7 % of its height. More melts near wires into one."""
_LEAST_CONTRAST_GREY = 60
"""Of the brightest spot over the background. Less takes echoes of the tank for wires: one of 12 dB over the noise is 51
greys of 60 dB (tests/appliance/crosswire/test_crossing.py); more asks for gain.
"""
_DEPTH_OF_SPOT = 0.25
"""Share of that contrast, from the top, that is the spot. More joins what is beside it; less leaves few pixels for the
centre. Not measured.
"""
_DIP_GREY = 4
"""A spot with a deeper dip is two. More measures wires that are apart, less parts one spot by its noise. Also the step
in which dips are looked for.
"""
_LEAST_AREA_PX = 12
"""Smaller spots are specks, not wires, which are smooth over `_SMOOTH_PX`. Not measured."""
_LARGEST_SHARE = 0.02
"""Of the picture: larger is no wire but a wall (tests/appliance/crosswire/test_crossing.py)."""
_NOISE_CELL_PX = 9
"""Pixels over which noise is one grain of speckle; more widens sigma. With it the stated sigma is .7 to 1.6 times the
scatter (tests/appliance/crosswire/test_crossing.py).
"""
_SD_PER_MEDIAN = 1.4826
"""Standard deviation ÷ median of the size of a normal variable with mean 0."""
_ROUGH_SHARE = 1.2
"""Noise ÷ what of it is rough over 1 px, for noise of the size of speckle: part of it is smooth. See `_NOISE_CELL_PX`.
"""
_QUANTISATION_GREY = 0.29
"""1 ÷ √12: standard deviation of rounding to whole greys."""

_DRAWN_GREY = 30
_DRAWN_RANGE_GREY = 16
"""Brighter than the first and changed by less than the second in every picture so far is drawn. Less of the first, or
more of the second, takes the still background for drawn; the reverse leaves letters behind. Not measured.
"""


class NoCrossing(Enum):
    """Why a picture holds no crossing that may be measured."""

    ABSENT = "no bright spot"
    PARTED = "two spots: the crossing is not in the plane"
    UNCLEAR = "more than two bright echoes, or one too large for a wire"
    CUT = "spot at the edge of the picture or on something that never moves"


@dataclass(frozen=True, slots=True, eq=False)
class Crossing:
    """One spot. centre_px: (2,) (column, row), 0 at the middle of the corner pixel.

    sigma_px: (2,) standard deviation of the centre from the noise of the picture alone. spread_px: standard deviation
    of the spot along its longest axis; smallest where the wires lie on one another.
    """

    centre_px: Vector
    sigma_px: Vector
    spread_px: float


class Drawings:
    """What the scanner draws over the picture: bright, and unchanged in every picture so far.

    The wires themselves count as drawn until they have moved, so nothing is measured on half a spot.
    """

    def __init__(self) -> None:
        self._darkest: GreyImage | None = None
        self._brightest: GreyImage | None = None

    def step(self, image: GreyImage) -> NDArray[np.uint8]:
        """Take the next picture; (h, w) uint8, non-zero on and next to what never changed."""
        if self._darkest is None or self._brightest is None or self._darkest.shape != image.shape:
            self._darkest, self._brightest = image.copy(), image.copy()
        cv2.min(self._darkest, image, self._darkest)
        cv2.max(self._brightest, image, self._brightest)
        still = cv2.subtract(self._brightest, self._darkest) < _DRAWN_RANGE_GREY
        drawn = (still & (self._darkest > _DRAWN_GREY)).astype(np.uint8)
        return np.asarray(cv2.dilate(drawn, np.ones((5, 5), np.uint8)), np.uint8)


def find_crossing(image: GreyImage, drawn: NDArray[np.uint8] | None = None) -> Crossing | NoCrossing:
    """The crossing in one picture (h, w) uint8, or why there is none. drawn: of Drawings, for this picture."""
    smooth = cv2.GaussianBlur(image, (0, 0), _SMOOTH_PX)
    if drawn is not None:
        smooth[drawn > 0] = 0
    background, peak = float(np.median(smooth[::4, ::4])), float(smooth.max())
    if peak - background < _LEAST_CONTRAST_GREY:
        return NoCrossing.ABSENT
    floor = peak - _DEPTH_OF_SPOT * (peak - background)
    bright = (smooth > floor).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(bright)
    spots = [label for label in range(1, len(stats)) if stats[label, cv2.CC_STAT_AREA] >= _LEAST_AREA_PX]
    refusal = _judge([int(stats[spot, cv2.CC_STAT_AREA]) for spot in spots], image.size)
    if refusal is not None:
        return refusal
    left, top, width, height = stats[spots[0], :4]
    crop = np.s_[top : top + height, left : left + width]
    inside = labels[crop] == spots[0]
    if _cut(inside, crop, image.shape, drawn):
        return NoCrossing.CUT
    if _parted(np.where(inside, smooth[crop], 0), floor, peak):
        return NoCrossing.PARTED
    return _measured(image[crop].astype(float), inside, floor, np.array([left, top], float))


def _judge(areas_px: list[int], pixels: int) -> NoCrossing | None:
    if not areas_px:
        return NoCrossing.ABSENT
    if len(areas_px) > 2 or max(areas_px) > _LARGEST_SHARE * pixels:
        return NoCrossing.UNCLEAR
    return NoCrossing.PARTED if len(areas_px) == 2 else None


def _cut(
    inside: NDArray[np.bool_], crop: tuple[slice, slice], shape: tuple[int, ...], drawn: NDArray[np.uint8] | None
) -> bool:
    if any(part.start == 0 or part.stop == side for part, side in zip(crop, shape, strict=True)):
        return True
    if drawn is None:
        return False
    grown = tuple(slice(part.start - 1, part.stop + 1) for part in crop)
    near = cv2.dilate(np.pad(inside, 1).astype(np.uint8), np.ones((3, 3), np.uint8))
    return bool(np.any((near > 0) & (drawn[grown] > 0)))


def _parted(spot: NDArray[np.uint8], floor: float, peak: float) -> bool:
    """True if at some level the spot falls into two that both rise higher."""
    for level in np.arange(floor, peak - _DIP_GREY, _DIP_GREY):
        count, labels = cv2.connectedComponents((spot > level).astype(np.uint8))
        tops = [spot[labels == label].max() for label in range(1, count)]
        if sum(top >= level + _DIP_GREY for top in tops) > 1:
            return True
    return False


def _measured(grey: Vector, inside: NDArray[np.bool_], floor: float, corner_px: Vector) -> Crossing | NoCrossing:
    """Moments of what rises above the floor. Compression and saturation keep a symmetric spot symmetric."""
    weight = np.where(inside, np.clip(grey - floor, 0, None), 0.0)
    total = weight.sum()
    if total <= 0:
        return NoCrossing.ABSENT
    rows, columns = np.indices(grey.shape)
    place = np.stack([columns, rows], axis=-1).astype(float)
    centre = np.einsum("ij,ijk->k", weight, place) / total
    away = place - centre
    spread = np.einsum("ij,ijk,ijl->kl", weight, away, away) / total
    noise_grey = _noise_grey(grey, inside)
    sigma = noise_grey * np.sqrt(_NOISE_CELL_PX * np.einsum("ij,ijk->k", inside, away**2)) / total
    return Crossing(corner_px + centre, sigma, float(np.sqrt(np.linalg.eigvalsh(spread)[-1])))


def _noise_grey(grey: Vector, inside: NDArray[np.bool_]) -> float:
    """Standard deviation of what a smooth spot does not explain, grey levels."""
    rough = grey - cv2.GaussianBlur(grey, (0, 0), 1.0)
    return float(np.hypot(_ROUGH_SHARE * _SD_PER_MEDIAN * np.median(np.abs(rough[inside])), _QUANTISATION_GREY))
