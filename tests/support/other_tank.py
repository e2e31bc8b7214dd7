"""A third way to draw crossed wires, for measuring alone: no threshold of the finder was ever set by it.

Unlike the other two its echoes are sheared (a steered beam) and ring on below themselves, the beam's width differs from
picture to picture by a factor of two, speckle is K-distributed (few scatterers, bright grains), noise grows with depth,
and the picture holds the scanner's own smoothing.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from tests.support.wire_pictures import Drawn

WIDTH_PX, HEIGHT_PX = 600, 520
_SLICE_MM = np.linspace(-1.8, 1.8, 37)
_GRAINS = 1.5
"""Shape of the gamma texture: Rayleigh speckle has infinity, tissue with few scatterers about 1."""


@dataclass(frozen=True)
class _Beam:
    """lateral_mm, axial_mm, slice_mm: sigma of the amplitude. shear: mm across per mm down. rings_mm: decay below."""

    lateral_mm: float
    axial_mm: float
    slice_mm: float
    shear: float
    rings_mm: float


def other_drawn(seed: int, depth_mm: float | None) -> Drawn:
    """depth_mm: distance of the plane from the crossing; None for a tank without wires."""
    random = np.random.default_rng((seed, 113))
    scale = random.uniform(0.06, 0.09), random.uniform(0.055, 0.085)
    beam = _Beam(*(random.uniform(*span) for span in ((0.3, 0.6), (0.1, 0.2), (0.5, 1.0), (-0.25, 0.25), (0.1, 0.35))))
    size_mm = np.array([WIDTH_PX, HEIGHT_PX]) * scale
    place_mm = random.uniform(-0.33, 0.33, 2) * size_mm
    power = (_texture(random, scale) * 10 ** (random.uniform(-50, -30) / 20)) ** 2
    if depth_mm is not None:
        wires = _wires(random, beam, place_mm, depth_mm, scale)
        if random.random() < 0.5:
            down = round(random.uniform(2.5, 6) / scale[1])
            wires[down:] += 10 ** (-random.uniform(8, 16) / 10) * wires[:-down]
        power += wires
    for _ in range(random.integers(0, 4) if depth_mm is not None else 0):
        bubble_mm = random.uniform(-0.45, 0.45, 2) * size_mm
        power += 10 ** (-random.uniform(14, 28) / 10) * _echo(*bubble_mm, beam, scale)
    if random.random() < 0.3:
        y = (np.arange(HEIGHT_PX) - (HEIGHT_PX - 1) / 2)[:, None] * scale[1]
        power += 0.3 * np.exp(-(((y - 0.42 * size_mm[1]) / 0.35) ** 2))
    if random.random() < 0.4:
        power *= _shadow(random, place_mm, scale)
    crossing = None if depth_mm is None else place_mm / scale + (np.array([WIDTH_PX, HEIGHT_PX]) - 1) / 2
    return Drawn(_compressed(power, random), crossing, scale)


def _echo(x_mm: float, y_mm: float, beam: _Beam, scale) -> np.ndarray:
    """(h, w) intensity of one point whose envelope's top lies at (x, y): rises fast, rings on below, leans aside."""
    x = (np.arange(WIDTH_PX) - (WIDTH_PX - 1) / 2) * scale[0] - x_mm
    y = (np.arange(HEIGHT_PX) - (HEIGHT_PX - 1) / 2) * scale[1] - y_mm
    rise = np.exp(-np.square(y) / beam.axial_mm**2)
    rings = 0.12 * np.exp(-y / beam.rings_mm) * (y > 2 * beam.axial_mm)
    leaning = x[None, :] - beam.shear * y[:, None]
    return (rise + rings)[:, None] * np.exp(-np.square(leaning) / beam.lateral_mm**2)


def _wires(random, beam: _Beam, place_mm, depth_mm: float, scale) -> np.ndarray:
    slopes = np.array([1, -1]) * random.uniform(0.5, 1.4, 2)
    dips = random.uniform(-0.12, 0.12, 2)
    levels = np.array([1.0, 10 ** (-random.uniform(0, 8) / 10)])
    weights = np.exp(-np.square(_SLICE_MM / beam.slice_mm))
    total = np.zeros((HEIGHT_PX, WIDTH_PX))
    for wire in (0, 1):
        rough = random.gamma(4.0, 0.25, len(_SLICE_MM))
        for step, weight in zip(_SLICE_MM, weights * rough / weights.sum(), strict=True):
            x, y = place_mm + np.array([slopes[wire], dips[wire]]) * (step - depth_mm)
            total += levels[wire] * weight * _echo(x, y, beam, scale)
    return total


def _texture(random, scale) -> np.ndarray:
    """K-distributed amplitude: Gaussian speckle whose strength is itself a random field."""
    parts = [
        cv2.GaussianBlur(random.standard_normal((HEIGHT_PX, WIDTH_PX)), (0, 0), 0.25 / scale[0], sigmaY=0.1 / scale[1])
        for _ in range(2)
    ]
    speckle = np.hypot(*parts)
    strength = random.gamma(_GRAINS, 1 / _GRAINS, (HEIGHT_PX // 4, WIDTH_PX // 4))
    strength = cv2.resize(strength, (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_LINEAR)
    return speckle / np.sqrt(np.mean(speckle**2)) * np.sqrt(strength)


def _shadow(random, place_mm, scale) -> np.ndarray:
    """A dark wedge that opens with depth, beside the crossing or over a part of it."""
    x = ((np.arange(WIDTH_PX) - (WIDTH_PX - 1) / 2) * scale[0])[None, :]
    y = ((np.arange(HEIGHT_PX) - (HEIGHT_PX - 1) / 2) * scale[1])[:, None]
    edge = place_mm[0] + random.uniform(-3, 3) + random.uniform(-0.15, 0.15) * (y - place_mm[1])
    dark = 10 ** (-random.uniform(4, 10) / 10)
    return dark + (1 - dark) / (1 + np.exp(random.choice([-1, 1]) * (x - edge) / random.uniform(0.4, 1.5)))


def _compressed(power: np.ndarray, random) -> np.ndarray:
    """Noise that grows by some dB from top to bottom, logarithm, 8 bits, and a scanner's 3 × 3 smoothing."""
    range_db, gain_db = random.uniform(48, 66), random.uniform(-6, 4)
    floor = 10 ** ((-64 + random.uniform(0, 12) * np.linspace(0, 1, HEIGHT_PX)) / 10)
    power = power + floor[:, None] * random.exponential(1.0, power.shape)
    level = 10 * np.log10(power + 1e-12) + gain_db
    grey = np.clip(np.rint(255 * (level + range_db) / range_db), 0, 255).astype(np.uint8)
    return cv2.GaussianBlur(grey, (3, 3), 0)
