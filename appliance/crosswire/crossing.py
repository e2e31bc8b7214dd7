"""Finds where two crossed wires meet in a B-mode picture of a water tank. Pure.

Away from their crossing the plane cuts the wires in two spots; nearer to it, the spots merge into one V or X; at the
crossing they lie on one another, point-symmetric about it. So one compact spot is a sighting, and the narrowest of a
series of sightings is the passage through the crossing.

Spots are judged by how far they stand out from their surroundings, not from the whole picture, so that speckle, haze
and the dark below a shadow do not count. Walls and reverberation lines are too wide for a wire; an echo straight below
a stronger one is its reverberation; what is weaker and smaller than the strongest spot is a bubble, because an oblique
wire is drawn out by the thickness of the slice.
"""

from dataclasses import dataclass
from enum import Enum

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.types import Vector
from probewatch.drivers.samples import GreyImage

ROUGH_SCALE_MM_PER_PX = (0.075, 0.075)
"""Scale, mm per pixel, of a picture of which nothing is known: 5 cm of depth in 640 rows. It only sets how large a wire
may be, and a factor of two either way does not affect what the finder promises (tests)."""
_SMOOTH_PX = 1.5
"""Sigma, px, of the smoothing before a spot is sought: a single hot pixel keeps 7 % of its height. More merges wires
that are near one another into one."""
_LEAST_CONTRAST_GREY = 60
"""Least contrast, grey levels, of the brightest spot over its surroundings. Less takes echoes of the tank for wires:
one of 12 dB over the noise is 51 greys of 60 dB (tests/appliance/crosswire/test_crossing.py); more asks for gain."""
_LEAST_CONTRAST_SD = 3.5
"""The same in standard deviations of the surroundings: the brightest of ten thousand grains of speckle stands 2.1 of
them above their median. Less takes grains for wires, more loses wires in haze."""
_DEPTH_OF_SPOT = 0.25
"""Share of that contrast, from the top, that counts as the spot. More joins what is beside it; less leaves few pixels
for the centre. Not measured."""
_RIVAL_SHARE = 0.6
"""Share of the strongest contrast, from which another spot may be the other wire: this includes one in a shadow of
10 dB where 60 dB are shown. Less takes clutter for the other wire, more takes one wire for the crossing."""
_SAME_SIZE, _SAME_SIZE_NEAR, _NEAR_MM = 0.6, 0.3, 8.0
"""Ratio of the area of the other wire's spot to that of the strongest, at least, where it is weaker, too: when it is
far from it, and when it is within _NEAR_MM, as near as wires come before they meet. A bubble beside wires at 45° has a
third. More takes a wire that stands straight for a bubble, less a bubble for a wire (make crosswire)."""
_FAR_SHARE, _FAR_MM = 0.7, 14.0
"""Share of the strongest contrast, from which a spot that is not near may be the other wire, and the distance, mm,
beyond which none is, if it is weaker. See `_RIVAL_SHARE`."""
_STEEP, _STEEP_MM = 0.8, 1.5
"""Slope of the line to a weaker spot, and what is added to it, mm, beyond which the spot is no wire: both wires are
stretched across the tank, so they part sideways, however the probe is leant (by 30° at most)."""
_DIP_GREY = 4
"""Grey levels: a spot with a deeper dip is two. More measures wires that are apart, less splits one spot by its noise.
It is also the step in which dips are searched for."""
_LOBES_MM = 1.6
"""Two tops of one spot that are nearer than this, mm, may be one crossing, whose echoes meet in opposite phase. More
measures wires that are apart; less loses such crossings."""
_LEAST_AREA_PX = 12
"""Area in pixels below which spots are specks, not wires, which are smooth over `_SMOOTH_PX`. Not measured."""
_SURROUNDINGS_MM = 8.0
"""Side, mm, of the square whose median is a spot's surroundings: four times as wide as a spot, and narrower than a
shadow."""
_LARGEST_MM = (9.0, 4.0)
"""Width and height of a spot, mm, at most: two wires at 65° to the slice's normal make 8 mm. Larger is a wall."""
_LATERAL_REACH_MM = 1.0
"""Distance, mm, to the side of a stronger echo within which its reverberation may lie."""
_WEAKER_GREY = 8
"""Grey levels by which reverberation or a bubble is weaker than the crossing, at least: 2 dB. A bubble as bright as a
wire cannot be distinguished from one. More takes clutter for the other wire."""
_MOST_SPOTS = 12
"""The number of spots examined in one picture, strongest first: with more than two of equal rank nothing is decided."""
_NOISE_CELL_PX = 9
"""Pixels over which noise is one grain of speckle; more widens sigma. With this value the stated sigma is .7 to 1.6
times the scatter of noise (tests/appliance/crosswire/test_crossing.py)."""
_SD_PER_MEDIAN = 1.4826
"""Ratio of the standard deviation of a normal variable with mean 0 to the median of its size."""
_ROUGH_SHARE = 1.2
"""Ratio of noise to what of it is rough over 1 px, for noise of the size of speckle: part is smooth. See
`_NOISE_CELL_PX`."""
_QUANTISATION_GREY = 0.29
"""Standard deviation, grey levels, of rounding to whole greys: 1 ÷ √12."""
_KNOWN_SHARE = 0.2
"""Share of a spot's own width by which its centre is uncertain in any case: by two wires that are not equally bright,
the phase in which their echoes meet, a plane that misses the crossing by a tenth of a millimetre (make crosswire)."""
_SPECKLE_DB = 5.57
"""Standard deviation of fully developed speckle, dB: its scatter in greys then gives the number of greys in 1 dB."""


class NoCrossing(Enum):
    """Names why a picture holds no crossing that may be measured."""

    ABSENT = "no bright spot"
    PARTED = "two spots: the crossing is not in the plane"
    UNCLEAR = "more than two bright echoes, or one too large for a wire"
    CUT = "spot at the edge of the picture or on something that never moves"


@dataclass(frozen=True, slots=True, eq=False)
class Missed:
    """Represents a picture without a crossing. spots_px: (k, 2) where the wires seem to be; two if they are apart."""

    reason: NoCrossing
    spots_px: Vector


@dataclass(frozen=True, slots=True, eq=False)
class Crossing:
    """Represents one spot. centre_px: (2,) (column, row), 0 at the middle of the corner pixel.

    covariance_px: (2, 2) of the centre, from the noise and the surroundings of this picture alone. spread_px: standard
    deviation of the spot along its longest axis; it is smallest where the wires lie on one another. confidence: 0 … 1,
    not a probability: how far the spot is from being refused, by its contrast and by its strongest rival.
    """

    centre_px: Vector
    covariance_px: Vector
    spread_px: float
    confidence: float


@dataclass(frozen=True, slots=True, eq=False)
class _Spot:
    """Represents a candidate. peak, contrast: greys, of the smoothed picture. inside: (h, w) within the crop, whose
    corner is corner_px. wall: whether it continues to both sides, further than any wire.
    """

    peak: float
    contrast: float
    place_px: Vector
    inside: NDArray[np.bool_]
    corner_px: tuple[int, int]
    refusal: NoCrossing | None
    wall: bool

    @property
    def floor(self) -> float:
        return self.peak - _DEPTH_OF_SPOT * self.contrast

    @property
    def crop(self) -> tuple[slice, slice]:
        (left, top), (height, width) = self.corner_px, self.inside.shape
        return slice(top, top + height), slice(left, left + width)


def find_crossing(
    image: GreyImage,
    drawn: NDArray[np.uint8] | None = None,
    scale_mm_per_px: tuple[float, float] = ROUGH_SCALE_MM_PER_PX,
) -> Crossing | Missed:
    """Returns the crossing in one picture (h, w) uint8, or why there is none.

    drawn: that of `Drawings`, for this picture. scale_mm_per_px: (lateral, axial), right within a factor of two.
    """
    smooth, scatter, spots = _looked(image, drawn, scale_mm_per_px, _RIVAL_SHARE)
    wires = [spot for spot in spots if spot.refusal is None]
    if not wires:
        return Missed(spots[0].refusal or NoCrossing.ABSENT if spots else NoCrossing.ABSENT, np.empty((0, 2)))
    spots = [spot for spot in spots if not spot.wall]
    best = wires[0]
    if any(spot.refusal is NoCrossing.UNCLEAR and spot.contrast > best.contrast for spot in spots):
        return Missed(NoCrossing.UNCLEAR, best.place_px[None])
    # A wire that is cut off by the border cannot be measured, but it still counts as the other wire.
    rivals = _rivals([best, *(spot for spot in spots if _may_be_wire(spot, best))], scale_mm_per_px)
    lobes = [spot for spot in rivals if _holds(spot, *best.place_px.astype(int)) and _near(spot, best, scale_mm_per_px)]
    if lobes and len(lobes) == len(rivals):
        best, rivals = lobes[-1], []
    if rivals:
        reason = NoCrossing.PARTED if len(rivals) == 1 else NoCrossing.UNCLEAR
        return Missed(reason, np.array([spot.place_px for spot in (best, *rivals)]))
    tops = np.array(_parted(np.where(best.inside, smooth[best.crop], 0), best.floor, best.peak), float)
    if len(tops) and np.linalg.norm((tops[1] - tops[0]) * scale_mm_per_px) > _LOBES_MM:
        return Missed(NoCrossing.PARTED, tops + best.corner_px)
    next_best = max((spot.contrast for spot in spots if spot is not best), default=0.0)
    return _measured(image, best, scatter, next_best)


def find_echoes(
    image: GreyImage,
    drawn: NDArray[np.uint8] | None = None,
    scale_mm_per_px: tuple[float, float] = ROUGH_SCALE_MM_PER_PX,
    share: float = 0.25,
) -> list[Crossing]:
    """Returns every echo that may come from a wire, such as those of an N-wire phantom, the strongest first.

    share: least contrast, relative to the strongest. The other arguments are those of find_crossing.
    """
    _smooth, scatter, spots = _looked(image, drawn, scale_mm_per_px, share)
    measured = [_measured(image, spot, scatter, 0.0) for spot in spots if spot.refusal is None]
    return [one for one in measured if isinstance(one, Crossing)]


def _looked(
    image: GreyImage, drawn: NDArray[np.uint8] | None, scale_mm_per_px: tuple[float, float], share: float
) -> tuple[GreyImage, float, list[_Spot]]:
    """Returns the smoothed picture, the scatter of the surroundings in greys, and the spots, the strongest first."""
    smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), _SMOOTH_PX), np.uint8)
    around = _surroundings(smooth, scale_mm_per_px)
    if drawn is None:
        drawn = np.zeros_like(smooth)
    smooth[drawn > 0] = 0
    contrast = np.asarray(cv2.subtract(smooth, around), np.uint8)
    scatter = _scatter(smooth, around, drawn)
    least = max(_LEAST_CONTRAST_GREY, _LEAST_CONTRAST_SD * scatter)
    return smooth, scatter, _spots(image, smooth, contrast, drawn, least, share, scale_mm_per_px)


def _beside_black(image: GreyImage, level: float) -> NDArray[np.bool_]:
    """Returns what is brighter than level and next to a pixel of 0, (h, w). No spot is so sharp, but the border of the
    sector is.
    """
    dark = np.asarray(cv2.erode(image, np.ones((3, 3), np.uint8)), np.uint8) == 0
    return np.asarray(dark & (image > level))


def _surroundings(smooth: GreyImage, scale_mm_per_px: tuple[float, float]) -> GreyImage:
    """Returns the median over a square about each pixel, (h, w), computed at a quarter of the resolution."""
    small = smooth[::4, ::4]
    side = round(_SURROUNDINGS_MM / (4 * float(np.mean(scale_mm_per_px)))) // 2 * 2 + 1
    median = cv2.medianBlur(np.ascontiguousarray(small), max(3, side))
    return np.asarray(cv2.resize(median, smooth.shape[::-1], interpolation=cv2.INTER_LINEAR), np.uint8)


def _scatter(smooth: GreyImage, around: GreyImage, drawn: NDArray[np.uint8]) -> float:
    """Returns the standard deviation of the surroundings, grey levels, where there are any; else 0."""
    apart = cv2.absdiff(smooth, around)[::4, ::4]
    seen = (around[::4, ::4] > 0) & (drawn[::4, ::4] == 0)
    return float(_SD_PER_MEDIAN * np.median(apart[seen])) if seen.any() else 0.0


def _spots(
    image: GreyImage,
    smooth: GreyImage,
    contrast: GreyImage,
    drawn: NDArray[np.uint8],
    least: float,
    share: float,
    scale_mm_per_px: tuple[float, float],
) -> list[_Spot]:
    """Returns the strongest spots, by contrast, each with the reason why it cannot be a wire, if there is one."""
    strongest = float(contrast.max())
    if strongest < least:
        return []
    least = max(least, share * strongest)
    tops = (contrast == cv2.dilate(contrast, np.ones((5, 9), np.uint8))) & (contrast >= least)
    rows, columns = np.nonzero(tops)
    heights = contrast[rows, columns].astype(int)
    found: list[_Spot] = []
    for index in np.argsort(-heights, kind="stable"):
        column, row = int(columns[index]), int(rows[index])
        if not any(_holds(spot, column, row) for spot in found):
            found.append(_spot(image, smooth, contrast, drawn, (column, row), scale_mm_per_px))
        if len(found) == _MOST_SPOTS:
            break
    return found


def _holds(spot: _Spot, column: int, row: int) -> bool:
    left, top = spot.corner_px
    height, width = spot.inside.shape
    inside = 0 <= row - top < height and 0 <= column - left < width
    return inside and bool(spot.inside[row - top, column - left])


def _spot(
    image: GreyImage,
    smooth: GreyImage,
    contrast: GreyImage,
    drawn: NDArray[np.uint8],
    top_px: tuple[int, int],
    scale_mm_per_px: tuple[float, float],
) -> _Spot:
    """Returns the connected region about a top, down to a share of its contrast."""
    column, row = top_px
    peak, height = float(smooth[row, column]), float(contrast[row, column])
    reach = [int(np.ceil(size / scale)) + 2 for size, scale in zip(_LARGEST_MM, scale_mm_per_px, strict=True)]
    top, bottom = max(0, row - reach[1]), min(smooth.shape[0], row + reach[1] + 1)
    left, right = max(0, column - reach[0]), min(smooth.shape[1], column + reach[0] + 1)
    bright = (smooth[top:bottom, left:right] > peak - _DEPTH_OF_SPOT * height).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(bright)
    label = int(labels[row - top, column - left])
    x, y, width, tall, area = (int(value) for value in stats[label])
    inside = labels[y : y + tall, x : x + width] == label
    corner = (left + x, top + y)
    refusal = None
    if area < _LEAST_AREA_PX:
        refusal = NoCrossing.ABSENT
    elif width * scale_mm_per_px[0] > _LARGEST_MM[0] or tall * scale_mm_per_px[1] > _LARGEST_MM[1]:
        refusal = NoCrossing.UNCLEAR
    elif _cut(inside, corner, smooth.shape, drawn) or np.any(
        inside
        & _beside_black(image[top:bottom, left:right], peak - _DEPTH_OF_SPOT * height)[y : y + tall, x : x + width]
    ):
        refusal = NoCrossing.CUT
    wall = x == 0 and x + width == right - left
    return _Spot(peak, height, np.array([column, row], float), inside, corner, refusal, wall)


def _near(spot: _Spot, best: _Spot, scale_mm_per_px: tuple[float, float]) -> bool:
    return bool(np.linalg.norm((spot.place_px - best.place_px) * scale_mm_per_px) <= _LOBES_MM)


def _may_be_wire(spot: _Spot, best: _Spot) -> bool:
    return spot is not best and spot.refusal in (None, NoCrossing.CUT)


def _rivals(wires: list[_Spot], scale_mm_per_px: tuple[float, float]) -> list[_Spot]:
    """Returns the spots that may be the other wire: strong, as large as the strongest, and not its reverberation."""
    best = wires[0]
    size = best.inside.sum()
    rivals = []
    for spot in wires[1:]:
        aside_mm, below_mm = (spot.place_px - best.place_px) * scale_mm_per_px
        echo = abs(aside_mm) < _LATERAL_REACH_MM and below_mm > 0
        steep = abs(below_mm) > _STEEP * abs(aside_mm) + _STEEP_MM
        distance_mm = float(np.hypot(aside_mm, below_mm))
        alike = _SAME_SIZE_NEAR if distance_mm < _NEAR_MM else _SAME_SIZE
        far = distance_mm > _FAR_MM or (distance_mm > _NEAR_MM and spot.contrast < _FAR_SHARE * best.contrast)
        bubble = steep or far or spot.inside.sum() < alike * size
        if best.peak - spot.peak <= _WEAKER_GREY or not (echo or bubble):
            rivals.append(spot)
    return rivals


def _cut(
    inside: NDArray[np.bool_], corner_px: tuple[int, int], shape: tuple[int, ...], drawn: NDArray[np.uint8]
) -> bool:
    left, top = corner_px
    bottom, right = top + inside.shape[0], left + inside.shape[1]
    if left == 0 or top == 0 or bottom == shape[0] or right == shape[1]:
        return True
    near = cv2.dilate(np.pad(inside, 1).astype(np.uint8), np.ones((3, 3), np.uint8))
    return bool(np.any((near > 0) & (drawn[top - 1 : bottom + 1, left - 1 : right + 1] > 0)))


def _parted(spot: NDArray[np.uint8], floor: float, peak: float) -> list[tuple[int, int]]:
    """Returns the two highest tops, (column, row), if at some level the spot splits into two that both rise higher."""
    for level in np.arange(floor, peak - _DIP_GREY, _DIP_GREY):
        count, labels = cv2.connectedComponents((spot > level).astype(np.uint8))
        if count <= 2:
            continue
        parts = [np.where(labels == label, spot, 0) for label in range(1, count)]
        parts = sorted((part for part in parts if part.max() >= level + _DIP_GREY), key=lambda part: -int(part.max()))
        if len(parts) > 1:
            rows, columns = zip(*(np.unravel_index(int(part.argmax()), part.shape) for part in parts[:2]), strict=True)
            return [(int(column), int(row)) for column, row in zip(columns, rows, strict=True)]
    return []


def _measured(image: GreyImage, spot: _Spot, scatter: float, next_best: float) -> Crossing | Missed:
    """Measures a spot by the moments of what rises above its floor; compression and saturation keep its symmetry."""
    grey = image[spot.crop].astype(float)
    weight = np.where(spot.inside, np.clip(grey - spot.floor, 0, None), 0.0)
    total = weight.sum()
    if total <= 0:
        return Missed(NoCrossing.ABSENT, spot.place_px[None])
    rows, columns = np.indices(grey.shape)
    place = np.stack([columns, rows], axis=-1).astype(float)
    centre = np.einsum("ij,ijk->k", weight, place) / total
    away = place - centre
    spread = np.einsum("ij,ijk,ijl->kl", weight, away, away) / total
    arms = np.einsum("ij,ijk,ijl->kl", spot.inside, away, away) / total**2
    # The covariance of the centre adds up noise, clutter below the spot, and what is uncertain in any case.
    noise = _noise_grey(grey, spot.inside) ** 2 * _NOISE_CELL_PX * arms
    clutter = _clutter_grey(spot.contrast, scatter) ** 2 * spread * np.sum(spot.inside) ** 2 / total**2
    blurred = _KNOWN_SHARE**2 * spread
    share = 1 - next_best / spot.contrast
    confidence = min(1.0, spot.contrast / (2 * _LEAST_CONTRAST_GREY)) * min(1.0, 0.5 + share / (2 * (1 - _RIVAL_SHARE)))
    return Crossing(
        np.array(spot.corner_px) + centre,
        noise + clutter + blurred,
        float(np.sqrt(np.linalg.eigvalsh(spread)[-1])),
        confidence,
    )


def _noise_grey(grey: Vector, inside: NDArray[np.bool_]) -> float:
    """Returns the standard deviation of what a smooth spot does not explain, grey levels."""
    rough = grey - cv2.GaussianBlur(grey, (0, 0), 1.0)
    return float(np.hypot(_ROUGH_SHARE * _SD_PER_MEDIAN * np.median(np.abs(rough[inside])), _QUANTISATION_GREY))


def _clutter_grey(contrast: float, scatter: float) -> float:
    """Returns by how many greys speckle below a spot shifts it: an echo so much stronger turns the sum by the ratio."""
    grey_per_db = scatter / _SPECKLE_DB
    if grey_per_db <= 0:
        return 0.0
    ratio = 10 ** (-contrast / (20 * grey_per_db))
    return float(grey_per_db * 8.686 * ratio / np.sqrt(2))
