"""Pictures of crossed wires, drawn in another way than the simulated world draws them.

There intensities add, beams are Gaussian and speckle is the tissue's own; here echoes add with their phase, the
beam is a sinc with side lobes of its own that widens away from the focus, the wires have a thickness, so that one lies
below the other, and are rough, and speckle is filtered noise whose strength drifts over the picture.
"""

from dataclasses import dataclass

import cv2
import numpy as np

WIDTH_PX, HEIGHT_PX = 512, 448
_CYCLES_PER_MM = 5.2
_HANN_MM = 0.55


@dataclass(frozen=True)
class Drawn:
    """image: (h, w) uint8. crossing_px: (2,), None where the plane does not meet it."""

    image: np.ndarray
    crossing_px: np.ndarray | None
    scale_mm_per_px: tuple[float, float]


def drawn(seed: int, depth_mm: float | None) -> Drawn:
    """depth_mm: distance of the plane from the crossing; None for a tank without wires."""
    random = np.random.default_rng((seed, 77))
    scale = (random.uniform(0.07, 0.1), random.uniform(0.06, 0.09))
    size_mm = WIDTH_PX * scale[0], HEIGHT_PX * scale[1]
    place = random.uniform(-0.33, 0.33, 2) * size_mm
    focus_mm = random.uniform(-8, 8)
    field = _speckle(random, scale) * 10 ** (random.uniform(-52, -32) / 20)
    if depth_mm is not None:
        field += _wires(random, place, depth_mm, focus_mm, scale, size_mm)
    for _ in range(random.integers(0, 4) if depth_mm is not None else 0):
        bubble = random.uniform(-0.45, 0.45, 2) * size_mm
        phase = np.exp(2j * np.pi * random.random())
        field += 10 ** (-random.uniform(14, 28) / 20) * phase * _point(*bubble, focus_mm, scale, size_mm)
    if random.random() < 0.3:
        _, y = _grid(scale, size_mm)
        field += 0.4 * np.exp(-(((y - 0.42 * size_mm[1]) / 0.3) ** 2))
    if random.random() < 0.4:
        field *= _shadow(random, place, scale, size_mm)
    crossing = None
    if depth_mm is not None:
        crossing = place / scale + (np.array([WIDTH_PX, HEIGHT_PX]) - 1) / 2
    return Drawn(_compressed(field, random), crossing, scale)


def _grid(scale, size_mm):
    x = (np.arange(WIDTH_PX) - (WIDTH_PX - 1) / 2) * scale[0]
    y = (np.arange(HEIGHT_PX) - (HEIGHT_PX - 1) / 2) * scale[1]
    return x[None, :], y[:, None]


def _point(x_mm, y_mm, focus_mm, scale, size_mm, above: float = 3.0) -> np.ndarray:
    """(h, w) complex echo of one point: sinc across, to a power for transmit and receive, Hann pulse along."""
    x, y = _grid(scale, size_mm)
    field = np.zeros((HEIGHT_PX, WIDTH_PX), complex)
    rows = np.flatnonzero(np.abs(y[:, 0] - y_mm) < _HANN_MM)
    if len(rows):
        width = 0.75 * np.hypot(1.0, (y_mm - focus_mm) / 14)
        across = np.abs(np.sinc((x - x_mm) / width)) ** 1.8
        away = y[rows] - y_mm
        pulse = np.cos(np.pi * away / (2 * _HANN_MM)) ** 2 * np.exp(2j * np.pi * _CYCLES_PER_MM * away)
        field[rows] = pulse * across
    return field


def _wires(random, place, depth_mm, focus_mm, scale, size_mm) -> np.ndarray:
    """Both wires as rows of points through the slice, with what the tank throws back again."""
    slopes = np.array([random.uniform(0.5, 1.3), -random.uniform(0.5, 1.3)])
    dips = random.uniform(-0.12, 0.12, 2)
    levels = np.array([1.0, 10 ** (-random.uniform(0, 8) / 20)])
    phases = np.exp(1j * random.uniform(-np.pi, np.pi, 2))
    thick_mm = random.uniform(0.05, 0.12)
    field = np.zeros((HEIGHT_PX, WIDTH_PX), complex)
    steps = np.linspace(-1.6, 1.6, 33)
    beam = np.exp(-((steps / 0.75) ** 2))
    for wire in (0, 1):
        rough = 1 + 0.25 * (random.standard_normal(len(steps)) + 1j * random.standard_normal(len(steps)))
        intensity = np.zeros((HEIGHT_PX, WIDTH_PX))
        for step, weight in zip(steps, beam * np.abs(rough) ** 2, strict=True):
            x = place[0] + slopes[wire] * (step - depth_mm)
            y = place[1] + dips[wire] * (step - depth_mm) + (wire - 0.5) * thick_mm
            intensity += weight**2 * np.abs(_point(x, y, focus_mm, scale, size_mm)) ** 2
        field += levels[wire] * phases[wire] * np.sqrt(intensity / np.sum(beam**2))
    if random.random() < 0.5:
        down = round(random.uniform(2.5, 6) / scale[1])
        level = 10 ** (-random.uniform(8, 16) / 20)
        again = np.roll(field, down, axis=0)
        again[:down] = 0
        field = field + level * again
    return field


def _speckle(random, scale) -> np.ndarray:
    noise = random.standard_normal((HEIGHT_PX, WIDTH_PX)) + 1j * random.standard_normal((HEIGHT_PX, WIDTH_PX))
    parts = [
        cv2.GaussianBlur(part, (0, 0), 0.32 / scale[0], sigmaY=0.12 / scale[1]) for part in (noise.real, noise.imag)
    ]
    speckle = parts[0] + 1j * parts[1]
    drift = cv2.resize(random.uniform(0.4, 1.6, (4, 5)), (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_CUBIC)
    return speckle / np.sqrt(np.mean(np.abs(speckle) ** 2)) * drift


def _shadow(random, place, scale, size_mm) -> np.ndarray:
    """A band below something above the wires, beside the crossing or over a part of it."""
    x, _ = _grid(scale, size_mm)
    edge = place[0] + random.uniform(-3, 3)
    width = random.uniform(0.4, 1.5)
    side = random.choice([-1, 1])
    dark = 10 ** (-random.uniform(4, 10) / 20)
    return dark + (1 - dark) / (1 + np.exp(side * (x - edge) / width))


def _compressed(field, random) -> np.ndarray:
    range_db, gain_db = random.uniform(48, 66), random.uniform(-6, 4)
    noise = random.standard_normal((2, HEIGHT_PX, WIDTH_PX)) * 10 ** (-62 / 20)
    level = 20 * np.log10(np.abs(field + noise[0] + 1j * noise[1]) + 1e-9) + gain_db
    return np.clip(np.rint(255 * (level + range_db) / range_db), 0, 255).astype(np.uint8)
