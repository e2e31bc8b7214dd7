"""Classifies the patches of a picture: speckle, spots of echo in water, or neither.

Speckle is what the point spread function of a probe makes of countless scatterers. A scanner draws 128 to 256 lines
across its field, so its speckle is smooth over a hundredth of the picture, where noise, however it was scaled or coded,
is not; and it is wider than high, because the pulse is shorter than the beam is wide. Its correlation falls as that of
a smooth function does, first slowly and then fast; that of letters, windows and bars falls steadily from the first
pixel, or not at all. Its slopes are everywhere, those of edges only here and there. Wires and walls in water, in which
probes are calibrated, are a few spots on black: as smooth as speckle, and wider than strokes of letters.

The picture is reduced to 170 … 340 rows and examined patch by patch. Only patches that show anything count, so a third
of the probe in contact is enough.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from probewatch.appliance.core.registration.pyramid import Array32, half
from probewatch.drivers.samples import GreyImage

# All lengths are pixels of the reduced picture, all figures per patch. They were measured on the pictures of
# tests/appliance/core/detectors/test_no_picture.py, which are simulated but for those in water: no recording of tissue
# was at hand.

_MOST_ROWS = 340
"""Most rows; larger pictures are halved until they have no more: white noise stays white, and noise softened over 1.5
px nearly becomes so."""
_PATCH_PX = 20
"""px, side of a patch. Smaller ones hold too few grains of speckle to measure its correlation; larger ones mix contact
and shadow. It was chosen with the thresholds below, not varied by itself."""
_AROUND_PX = (15, 15)
"""px over which a mean is subtracted: shades and depth gain go, speckle of up to 5 px stays."""
_TINY = np.float32(1e-3)
"""Prevents a division by zero for empty patches."""

_LEAST_GREY, _MOST_GREY = 4.0, 50.0
"""Least and largest standard deviation, grey levels of 255. From the least on a patch shows something: with a lower
one, the receiver's noise beside a probe in half contact counts; with a higher one, dark pictures are lost. Speckle in
decibels spreads by 5.6 dB, which is 24 at 60 dB and 36 at 40 dB, and up to 49 with an edge of tissue; bold letters have
60 and more."""
_ACROSS_PX, _ACROSS, _DOWN = 2, (0.27, 0.96), (0.2, 0.92)
"""Distance across, px, and least and largest correlation of speckle over it and over 1 px down. Tissue has 0.3 … 0.9
and 0.35 … 0.85 (5 … 95 % of patches), noise less than 0.1; level and upright edges have 0.97 and more across and
down."""
_CLEAR_ACROSS, _WIDER = 0.5, 1.3
"""Correlation across above which speckle is clear, and factor by which, where it is not, the correlation must fall
faster down than across. Softened noise may be as smooth as fine speckle, but is as high as wide: tissue mostly has a
factor of 1.5 … 5, soft noise of 0.9 … 1.2."""
_SMOOTH = 1.5
"""Ratio by which the correlation must fall more over 2 px across than over 1: 4 for a smooth function, 2 for clean
edges, 1 for noise and strokes 1 px wide. Tissue has 2.1 … 3.5; with white noise of 10 dB less than the echoes, 1.6."""
_FAR_PX, _MOST_FAR = 5, 0.6
"""px down, and largest correlation over that distance, which upright edges keep (0.7 … 1) and speckle has lost
(−0.4 … 0.3)."""
_MOST_JUMPS = 8.0
"""Largest kurtosis of the slope down: tissue has 2.5 … 7, level edges and letters 4 … 40."""
_FLATTEST = 1.9
"""Least kurtosis of the greys: gratings have 1 … 1.5, clipped speckle 2, speckle 2.2 … 6."""
_SPOT_ACROSS, _SPOT_DOWN, _SPOT_PEAKED, _SPOT_SMOOTH = 0.6, 0.4, 4.0, 2.0
"""Least values of the same figures for a spot on black. They were chosen by looking at the recordings of PLUS, the only
ones in water, which have 0.7 … 1, 0.6 … 0.96, 4.5 … 70 and 2.5 … 4; letters mostly fail by the last, 1.6 … 3."""

_SPECKLE_SHARE, _SPOT_SHARE = 0.25, 0.55
"""Shares of the patches showing anything that must be speckle or else spots. With higher ones, little contact and
strong noise are not called a picture; with lower ones, menus in large letters and lone lines on black are. Tissue
reached 1.05 to 4 times the share, water 1.17 and more except for the faintest wall, everything else 0.9 at most; at 160
× 120, where speckle and letters are hardly drawn, one menu in forty reaches 1 and one picture of tissue in six does
not."""
_FEWEST = 3
"""Patches of either kind below which chance decides; the faintest wall in water has 2 and is lost, most have 4 or more.
"""


@dataclass(frozen=True, slots=True)
class Texture:
    """Counts the patches of a picture that show anything, and of these speckle, and spots of echo as in water."""

    visible: int
    speckle: int
    spots: int

    @property
    def water(self) -> bool:
        """Returns whether it shows only spots in water, such as the wires of a phantom: nothing there gives way."""
        few = self.speckle < max(_FEWEST, _SPECKLE_SHARE * self.visible)
        return few and self.spots >= max(_FEWEST, _SPOT_SHARE * self.visible)

    @property
    def tissue(self) -> float:
        """Returns the share of speckle or of spots, whichever is better, ÷ the share required: from 1 on, a picture."""
        speckle = self.speckle / self.visible / _SPECKLE_SHARE if self.speckle >= _FEWEST else 0.0
        spots = self.spots / self.visible / _SPOT_SHARE if self.spots >= _FEWEST else 0.0
        return max(speckle, spots)


class TextureReader:
    """Reads textures. It keeps its arrays between pictures: allocating them takes longer than the arithmetic."""

    def __init__(self) -> None:
        self._grey = self._first = self._second = np.empty((0, 0), np.float32)

    def read(self, image: GreyImage) -> Texture:
        """Returns the texture of a picture, (h, w) uint8; one too small for a patch shows nothing."""
        while image.shape[0] > _MOST_ROWS and image.shape[1] > _PATCH_PX:
            image = half(image)
        rows, columns = (image.shape[0] - _FAR_PX) // _PATCH_PX, (image.shape[1] - _ACROSS_PX) // _PATCH_PX
        if rows < 1 or columns < 1:
            return Texture(0, 0, 0)
        if self._grey.shape != image.shape:
            self._grey = np.empty(image.shape, np.float32)
            self._first, self._second = np.empty((2, rows * _PATCH_PX, columns * _PATCH_PX), np.float32)
        cv2.subtract(image, cv2.blur(image, _AROUND_PX), dst=self._grey, dtype=cv2.CV_32F)
        return _counted(self._figures())

    def _figures(self) -> "_Figures":
        here = self._at(0, 0)
        square = _product(here, here, self._second)
        power = _means(square) + _TINY
        peaked = _means(_product(square, square, self._second)) / power / power
        far = _means(_product(here, self._at(_FAR_PX, 0), self._second)) / power
        next_across, across = _means(self._steps(0, 1)), _means(self._steps(0, _ACROSS_PX))
        steps_down = self._steps(1, 0)
        down = _means(steps_down) + _TINY
        jumps = _means(_product(steps_down, steps_down, self._second)) / down / down
        twice = 2 * power
        return _Figures(power, next_across / twice, across / twice, down / twice, far, peaked, jumps)

    def _at(self, down_px: int, across_px: int) -> Array32:
        height, width = self._first.shape
        return self._grey[down_px : height + down_px, across_px : width + across_px]

    def _steps(self, down_px: int, across_px: int) -> Array32:
        """Returns the squares of the difference from the pixel at that distance."""
        cv2.subtract(self._at(down_px, across_px), self._at(0, 0), dst=self._first)
        return _product(self._first, self._first, self._first)


@dataclass(frozen=True, slots=True, eq=False)
class _Figures:
    """Holds the figures of all patches, each an array (patch rows, patch columns).

    power: mean square, grey levels². next_across, across, down: 1 − correlation over 1 and 2 px across and 1 px down.
    far: correlation `_FAR_PX` down. peaked, jumps: kurtosis of the greys and of the slope down.
    """

    power: Array32
    next_across: Array32
    across: Array32
    down: Array32
    far: Array32
    peaked: Array32
    jumps: Array32


def _counted(of: _Figures) -> Texture:
    visible = of.power > _LEAST_GREY**2
    across, down = 1 - of.across, 1 - of.down
    speckle = visible & (of.power < _MOST_GREY**2) & (of.across > _SMOOTH * of.next_across)
    speckle &= (across > _ACROSS[0]) & (across < _ACROSS[1]) & (down > _DOWN[0]) & (down < _DOWN[1])
    speckle &= (across > _CLEAR_ACROSS) | (of.down > _WIDER * of.next_across)
    speckle &= (of.far < _MOST_FAR) & (of.peaked > _FLATTEST) & (of.jumps < _MOST_JUMPS)
    spots = visible & (of.across > _SPOT_SMOOTH * of.next_across)
    spots &= (across > _SPOT_ACROSS) & (down > _SPOT_DOWN) & (of.peaked > _SPOT_PEAKED)
    return Texture(*(int(np.count_nonzero(which)) for which in (visible, speckle, spots)))


def _product(a: Array32, b: Array32, into: Array32) -> Array32:
    return np.asarray(cv2.multiply(a, b, dst=into), np.float32)


def _means(values: Array32) -> Array32:
    """Returns the mean of every patch."""
    size = values.shape[1] // _PATCH_PX, values.shape[0] // _PATCH_PX
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), np.float32)
