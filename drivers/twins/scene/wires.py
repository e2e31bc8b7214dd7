"""Models two crossed wires in a tank, and what spoils their picture: haze, shadow, side lobes, reverberation, bubbles.

A wire's intensity is summed along it over the thickness of the slice, so that an oblique wire is drawn out. What the
probe adds to every echo, side lobes and reverberation, it adds to both wires alike. The functions are pure.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from probewatch.drivers.samples import Matrix4
from probewatch.drivers.twins.scene.tissue import Beam, Floats

_STRENGTH = 300.0
"""Intensity of a wire relative to plain tissue: 25 dB, so that a 60 dB picture shows it near white."""


@dataclass(frozen=True, slots=True)
class Clutter:
    """Describes the wires and what spoils their picture. directions: those of the wires, tissue axes; they cross at its
    origin. gap_mm: how far the second passes the first.

    haze_db: speckle in the water relative to plain tissue. second_db: the second wire relative to the first, as in a
    shadow. side_lobe_db: wings at the depth of an echo, relative to it, side_lobe_mm wide (sigma). reverberation_db:
    level of the first echo below each, and again for the next, reverberation_mm apart. bubbles: (x mm, y mm, dB
    relative to a wire) in the picture. wall_mm: depth of a bright line over the whole picture, from its middle. -inf
    and NaN leave a thing out.
    """

    directions: tuple[tuple[float, float, float], tuple[float, float, float]] = (
        (0.72, 0.05, 0.69),
        (-0.66, 0.04, 0.75),
    )
    gap_mm: float = 0.0
    haze_db: float = -np.inf
    second_db: float = 0.0
    side_lobe_db: float = -np.inf
    side_lobe_mm: float = 3.0
    reverberation_db: float = -np.inf
    reverberation_mm: float = 3.5
    bubbles: tuple[tuple[float, float, float], ...] = ()
    wall_mm: float = np.nan


def cluttered(random: np.random.Generator) -> Clutter:
    """Draws a tank as technicians have it: both wires oblique, and two or three of the disturbances."""
    around = Rotation.from_rotvec(np.radians(random.uniform([-6, -12, -8], [6, 12, 8])))
    opening = np.radians(random.uniform(30, 48, 2))
    dips = random.uniform(-0.15, 0.15, 2)
    wires = [
        around.apply([side * np.sin(angle), dip, np.cos(angle)])
        for side, angle, dip in zip((1, -1), opening, dips, strict=True)
    ]
    some = random.random(5) < 0.5
    spots = random.uniform([-20, -14, -28], [20, 14, -14], (random.integers(1, 5), 3))
    plain = Clutter(directions=(_triple(wires[0]), _triple(wires[1])))
    return replace(
        plain,
        haze_db=random.uniform(-25, 0),
        second_db=-random.uniform(3, 10) if some[0] else 0.0,
        side_lobe_db=-random.uniform(18, 28) if some[1] else -np.inf,
        reverberation_db=-random.uniform(8, 16) if some[2] else -np.inf,
        bubbles=tuple(_triple(spot) for spot in spots) if some[3] else (),
        wall_mm=random.uniform(10, 15) if some[4] else np.nan,
    )


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    first, second, third = (float(value) for value in values)
    return first, second, third


def wire_intensity(pose: Matrix4, x_mm: Floats, y_mm: Floats, clutter: Clutter, beam: Beam) -> Floats:
    """Returns the intensity, (h, w), relative to plain tissue. pose: (4, 4) P → C, mm. x_mm: (1, w), y_mm: (h, 1) from
    the middle.
    """
    crossing_mm = -pose[:3, :3].T @ pose[:3, 3]
    first, second = (np.array(direction) for direction in clutter.directions)
    apart = np.cross(first, second)
    apart *= clutter.gap_mm / np.linalg.norm(apart)
    total = np.zeros((y_mm.size, x_mm.size))
    for wire, shift, level_db in ((first, 0.0, 0.0), (second, 1.0, clutter.second_db)):
        # Where the wire passes through the picture, and how the thickness of the slice spreads it along its slope.
        direction = pose[:3, :3].T @ wire
        place = crossing_mm + shift * (pose[:3, :3].T @ apart)
        slope = direction[:2] / direction[2]
        spread = np.diag([beam.lateral_mm**2, beam.axial_mm**2]) + beam.elevational_mm**2 * np.outer(slope, slope)
        total += 10 ** (level_db / 10) * _echo(x_mm, y_mm, place[:2] - slope * place[2], spread, clutter)
    plain = np.diag([beam.lateral_mm**2, beam.axial_mm**2])
    for x, y, level_db in clutter.bubbles:
        total += 10 ** (level_db / 10) * _echo(x_mm, y_mm, np.array([x, y]), plain, clutter)
    if np.isfinite(clutter.wall_mm):
        total += np.exp(-(((y_mm - clutter.wall_mm) / (2 * beam.axial_mm)) ** 2))
    return np.asarray(_STRENGTH * total, np.float32)


def _echo(x_mm: Floats, y_mm: Floats, spot_mm: np.ndarray, spread: np.ndarray, clutter: Clutter) -> np.ndarray:
    """Returns an echo of intensity 1 with its wings and its reverberation."""
    echo = _bell(x_mm - spot_mm[0], y_mm - spot_mm[1], spread)
    if np.isfinite(clutter.side_lobe_db):
        wide = spread + np.diag([clutter.side_lobe_mm**2, 0.0])
        echo += 10 ** (clutter.side_lobe_db / 10) * _bell(x_mm - spot_mm[0], y_mm - spot_mm[1], wide)
    if np.isfinite(clutter.reverberation_db):
        for number in (1, 2):
            below_mm = spot_mm[1] + number * clutter.reverberation_mm
            echo += 10 ** (number * clutter.reverberation_db / 10) * _bell(x_mm - spot_mm[0], y_mm - below_mm, spread)
    return echo


def _bell(x: Floats, y: Floats, spread: np.ndarray) -> np.ndarray:
    sharp = np.linalg.inv(spread)
    return np.asarray(np.exp(-(sharp[0, 0] * x * x + 2 * sharp[0, 1] * x * y + sharp[1, 1] * y * y)))
