"""A second, independent rendering of ultrasound: points in a slice, seen along the lines of a curved or linear array.

Unlike the simulated cart it works line by line: every line of the array is a radio-frequency echo, whose envelope is
compressed and then drawn into the sector. The lateral resolution widens away from the focus, the depth gain is uneven,
and the scanner averages over pictures.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.samples import GreyImage

Reals = NDArray[np.float32]


@dataclass(frozen=True)
class Array1D:
    """lines across the field, depths along a line. fan_deg: half the opening; 0 is a linear array.

    width_lines: lateral σ of the amplitude at the focus, lines. pulse_depths: axial σ, depths. cycles_per_depth:
    carrier. fills: share of the picture's height and width (linear array) that the field covers.
    """

    lines: int = 160
    depths: int = 640
    fan_deg: float = 30.0
    width_lines: float = 1.3
    pulse_depths: float = 2.5
    cycles_per_depth: float = 0.22
    fills: float = 0.95


@dataclass(frozen=True)
class Look:
    """dynamic_db, gain_db, noise_db: of the display and the receiver. uneven_db: errors of the depth gain.

    contact: share of the array that touches. shadow: share of lines behind bone. averaged: pictures blended.
    """

    dynamic_db: float = 60.0
    gain_db: float = 0.0
    noise_db: float = -35.0
    uneven_db: float = 3.0
    contact: float = 1.0
    shadow: float = 0.0
    averaged: int = 1


def render(
    random: np.random.Generator, size: tuple[int, int], array: Array1D | None = None, look: Look | None = None
) -> GreyImage:
    """(rows, columns) uint8 of new tissue."""
    array, look = array or Array1D(), look or Look()
    echoes = _spread(_tissue(random, array), array)
    echoes[:, round(look.contact * array.lines) :] = 0
    if look.shadow:
        first, start = int(random.integers(0, array.lines // 2)), array.depths // 4
        echoes[start:, first : first + round(look.shadow * array.lines)] *= np.float32(0.01)
    power = np.zeros(echoes.shape, np.float32)
    for _ in range(look.averaged):
        hiss = random.standard_normal((2, *echoes.shape), np.float32) * np.float32(10 ** (look.noise_db / 20))
        hiss = np.stack([cv2.GaussianBlur(part, (0, 0), 0.6, sigmaY=array.pulse_depths / 2) for part in hiss])
        power += np.square(echoes.real + hiss[0]) + np.square(echoes.imag + hiss[1])
    depth = np.linspace(0, 1, array.depths, dtype=np.float32)[:, None]
    gain_db = look.gain_db + look.uneven_db * np.sin(2 * np.pi * (depth + random.random())) * np.float32(1)
    level_db = 10 * np.log10(power / look.averaged + 1e-9) + gain_db
    grey = np.clip(130 + level_db * 255 / look.dynamic_db, 0, 255).astype(np.float32)
    # Drawn large enough that no echo falls between two pixels, then reduced.
    finer = max(1, -(-480 // size[0]))
    drawn = _drawn(grey, (size[0] * finer, size[1] * finer), array)
    return np.asarray(cv2.resize(drawn, size[::-1], interpolation=cv2.INTER_AREA), np.uint8)


def _tissue(random: np.random.Generator, array: Array1D) -> NDArray[np.complex64]:
    """Points at random places, weaker and stronger in regions, a vessel without any, and one sheet."""
    points = 12 * array.lines * array.depths // 40
    place = random.integers(0, array.depths, points), random.integers(0, array.lines, points)
    strength = random.standard_normal(points).astype(np.float32)
    cells = random.uniform(-9, 5, (5, 4)).astype(np.float32)
    region_db = cv2.resize(cells, (array.lines, array.depths), interpolation=cv2.INTER_CUBIC)
    y, x = np.mgrid[0 : array.depths, 0 : array.lines]
    middle = random.uniform(0.2, 0.8, 2) * (array.depths, array.lines)
    inside = ((y - middle[0]) / (0.08 * array.depths)) ** 2 + ((x - middle[1]) / (0.1 * array.lines)) ** 2 < 1
    field = np.zeros((array.depths, array.lines), np.float32)
    np.add.at(field, place, strength)
    field *= 10 ** (region_db / 20)
    field[inside] *= 0.02
    sheet = (random.uniform(0.3, 0.8) * array.depths + 12 * np.sin(np.arange(array.lines) / 30)).astype(int)
    field[sheet, np.arange(array.lines)] += 12
    # The carrier is what makes the echo of neighbouring depths cancel; the envelope is taken as |I + iQ|.
    turn = np.exp(2j * np.pi * array.cycles_per_depth * 4 * np.arange(array.depths))[:, None]
    return (field * turn).astype(np.complex64)


def _spread(field: NDArray[np.complex64], array: Array1D) -> NDArray[np.complex64]:
    """Convolution with the pulse, and across lines with a beam that is narrowest at half depth; mean power about 1."""
    bands = 4
    whole = np.zeros(field.shape, np.complex64)
    for band in range(bands):
        wide = array.width_lines * (1 + 0.5 * abs(band - 1.5))
        low, high = band * array.depths // bands, (band + 1) * array.depths // bands
        for unit, part in ((1, field.real), (1j, field.imag)):
            seen = cv2.GaussianBlur(np.ascontiguousarray(part), (0, 0), wide, sigmaY=array.pulse_depths)
            whole[low:high] += np.complex64(unit) * seen[low:high]
    return whole / np.float32(np.sqrt(np.median(np.abs(whole) ** 2) / 0.7))


def _drawn(grey: Reals, size: tuple[int, int], array: Array1D) -> GreyImage:
    """Scan conversion: polar to picture, black outside."""
    rows, columns = size
    y, x = np.mgrid[0:rows, 0:columns].astype(np.float32)
    x -= np.float32((columns - 1) / 2)
    if array.fan_deg == 0:
        line = (x / (columns * array.fills) + np.float32(0.5)) * np.float32(array.lines - 1)
        depth = y / np.float32(rows * array.fills) * np.float32(array.depths - 1)
    else:
        fan = np.deg2rad(array.fan_deg)
        face, deep = np.float32(0.35 * rows), np.float32(array.fills * rows)
        above = face * np.float32(np.cos(fan))
        radius, angle = np.hypot(x, y + above), np.arctan2(x, y + above)
        line = (angle / np.float32(2 * fan) + np.float32(0.5)) * np.float32(array.lines - 1)
        depth = (radius - face) / (deep + above - face) * np.float32(array.depths - 1)
    picture = cv2.remap(grey, line, depth, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(np.rint(picture), np.uint8)
