"""Sweeps as in the paper, on the simulator: a sensor turned by half a turn about image depth, 3 mm/s, 33 frames a
second."""

from dataclasses import dataclass

import cv2
import numpy as np

from probewatch.drivers.rigid import Array, rigid, rotation_from_vector
from probewatch.drivers.samples import GreyImage
from probewatch.drivers.twins.scene.world import World, WorldSettings

FPS = 33.0
SPEED_MM_PER_S = 3.0
SCALE = np.array([0.22, 0.26])

SIZE_PX = (180, 180)
"""40 × 47 mm: the stored tissue is not as deep as the paper's 8 cm."""

_FINER = 3
_SETTINGS = WorldSettings(
    width_px=_FINER * SIZE_PX[0],
    height_px=_FINER * SIZE_PX[1],
    scale_mm_per_px=(SCALE[0] / _FINER, SCALE[1] / _FINER),
    fps=FPS,
    overlay=False,
)
"""A scanner samples finer than it shows: rendered so, speckle is not aliased by pixels wider than itself."""

X = rigid(
    rotation_from_vector(3.06 * np.array([0.03, 0.999, -0.02]) / np.linalg.norm([0.03, 0.999, -0.02])),
    np.array([8.0, 45.0, 12.0]),
)
"""Sensor → picture."""


@dataclass(frozen=True, eq=False)
class Sweep:
    """pictures: n, uint8. poses: (n, 4, 4) sensor → tracker as measured. t_s: (n,)."""

    pictures: list[GreyImage]
    poses: Array
    t_s: Array


def sweep(
    seed: int, headings_deg: Array, position_mm: float = 0.1, angle_deg: float = 0.02, flipped: bool = False
) -> Sweep:
    """In-plane translation at constant speed, frame by frame along headings_deg (n,): 0 lateral, 90 axial.

    The hand wanders out of the plane by some hundredths of a millimetre and of a degree per √s.
    """
    random = np.random.default_rng((seed, 7))
    world = World(seed, settings=_SETTINGS)
    n = len(headings_deg)
    heading = np.deg2rad(headings_deg)
    step = SPEED_MM_PER_S / FPS * np.stack([np.cos(heading), np.sin(heading), np.zeros(n)], axis=1)
    wander = np.cumsum(random.normal(0, 0.03 / np.sqrt(FPS), (n, 3)), axis=0)
    turn = np.cumsum(random.normal(0, np.deg2rad(0.03) / np.sqrt(FPS), (n, 3)), axis=0)
    place = np.cumsum(step, axis=0)
    place += wander * [0, 0, 1] - place.mean(axis=0)
    true = rigid(rotation_from_vector(turn), place)
    pictures = [_shown(world.frame_at(pose, k)) for k, pose in enumerate(true)]
    if flipped:
        pictures = [np.ascontiguousarray(picture[:, ::-1]) for picture in pictures]
    measured = world.tissue_to_tracker @ true @ X
    measured = measured @ rigid(rotation_from_vector(random.normal(0, np.deg2rad(angle_deg), (n, 3))), np.zeros((n, 3)))
    measured[:, :3, 3] += random.normal(0, position_mm, (n, 3))
    return Sweep(pictures, measured, np.arange(n) / FPS)


def _shown(fine: GreyImage) -> GreyImage:
    smooth = cv2.GaussianBlur(fine, (0, 0), _FINER / 2)
    return np.asarray(cv2.resize(smooth, SIZE_PX, interpolation=cv2.INTER_AREA), np.uint8)
