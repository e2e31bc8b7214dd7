"""Pairs of rendered pictures whose motion is known. Pixels are square here, so that no peer's motion model is wrong."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from probewatch.drivers.samples import GreyImage
from probewatch.drivers.twins.scene.world import WorldSettings
from tests.support.rendered import Warp, learnt_mask, moved, true_motion, world

Bits = NDArray[np.bool_]

PLAIN = WorldSettings(scale_mm_per_px=(0.075, 0.075), overlay=False)
SCREEN = WorldSettings(scale_mm_per_px=(0.075, 0.075))


@dataclass(frozen=True)
class Scene:
    """What happens between the two pictures. px: length of the shift; its direction is drawn. shadow: a tenth of the
    width loses 14 dB. overlay: text, ruler and sector border as the simulated scanner draws them."""

    name: str
    px: float = 2.8
    turn_deg: float = 0.0
    elevation_mm: float = 0.0
    gain: float = 1.0
    overlay: bool = False
    shadow: bool = False

    @property
    def settings(self) -> WorldSettings:
        return SCREEN if self.overlay else PLAIN


SCENES = (
    Scene("shift 0.7 px", 0.7),
    Scene("shift 2.8 px"),
    Scene("shift 20 px", 20),
    Scene("shift 40 px", 40),
    Scene("shift 80 px", 80),
    Scene("turn 1 deg", turn_deg=1),
    Scene("turn 3 deg", turn_deg=3),
    Scene("turn 5 deg", turn_deg=5),
    Scene("elevation 0.2 mm", elevation_mm=0.2),
    Scene("elevation 0.5 mm", elevation_mm=0.5),
    Scene("elevation 1.0 mm", elevation_mm=1.0),
    Scene("elevation 1.5 mm", elevation_mm=1.5),
    Scene("gain 0.7", gain=0.7),
    Scene("overlay", overlay=True),
    Scene("new shadow", shadow=True),
    Scene("overlay, shadow", overlay=True, shadow=True),
)
CLEAN = ("shift 0.7 px", "shift 2.8 px", "shift 20 px", "shift 40 px")
DECORRELATED = tuple(scene.name for scene in SCENES if scene.elevation_mm)
CHANGED = ("elevation 0.2 mm", "elevation 0.5 mm", "turn 1 deg")


@dataclass(frozen=True, eq=False)
class Pair:
    """truth: (u px, α rad) of the tissue. mask: what the overlay mask had learnt, None where nothing is drawn."""

    before: GreyImage
    after: GreyImage
    truth: Warp
    mask: Bits | None


def pairs(scene: Scene, count: int) -> Iterator[Pair]:
    """`count` pairs over four tissues, seeded by the scene's place in the list."""
    random = np.random.default_rng(SCENES.index(scene))
    for k in range(count):
        seen = world(1 + k % 4, scene.settings, scene.overlay)
        first = moved(np.eye(4), scene.settings, tuple(random.uniform(-30, 30, 2)), 0, random.uniform(-3, 3))
        angle, (turn, out) = random.uniform(0, 2 * np.pi), random.choice([-1, 1], 2)
        px = (scene.px * np.cos(angle), scene.px * np.sin(angle))
        later = moved(first, scene.settings, px, turn * scene.turn_deg, out * scene.elevation_mm)
        in_plane = moved(first, scene.settings, px, turn * scene.turn_deg)
        after = _spoilt(seen.frame_at(later, 2 * k + 1), scene, random)
        mask = learnt_mask(seen).mask if scene.overlay else None
        yield Pair(seen.frame_at(first, 2 * k), after, true_motion(first, in_plane, scene.settings), mask)


def _spoilt(image: GreyImage, scene: Scene, random: np.random.Generator) -> GreyImage:
    if scene.shadow:
        column = int(random.integers(100, 480))
        image = image.copy()
        image[:, column : column + 64] = cv2.subtract(image[:, column : column + 64], np.full((480, 64), 60, np.uint8))
    return image if scene.gain == 1 else np.round(scene.gain * image).astype(np.uint8)
