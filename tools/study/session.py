"""One session as it truly was: where the probe, the tissue and the marker body were at every time. Pure and seeded."""

from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from appliance.storage.calibration_file import calibration_from_image_to_probe
from appliance.types import Calibration
from drivers.rigid import Array, ComplexArray, inverse, rigid, rotation_from_vector
from drivers.twins.scene.world import World, WorldSettings
from tools.study.hand import ALL, lifted

Tissue = Literal["still", "breathing"]
TISSUES: tuple[Tissue, ...] = ("still", "breathing")
SETTINGS = WorldSettings(width_px=400, height_px=300)
"""A quarter of a full picture's work, with enough speckle for the registration: 32 × 21 mm. Sizes of pictures were not
varied here."""

FPS = 30.0
"""Of a scanner's video output."""

_BREATH_MM, _BREATH_HZ, _JITTER = 4.0, 0.25, 0.1
"""Way of the tissue along the axis, peak to peak, in quiet breathing beside the liver; its rate; and how much period
and depth of one breath differ from the next (standard deviation)."""
_PULSE_MM, _PULSE_HZ = 0.3, 1.1
"""Peak to peak, beside a large vessel."""


@dataclass(frozen=True)
class Session:
    """name: one of ALL. Times are s since its start; duration_s is its length."""

    name: str
    tissue: Tissue
    seed: int
    duration_s: float

    @property
    def title(self) -> str:
        """For file names; of other motion it is another, whatever the session is called."""
        poses = self.pictures(np.arange(0.0, self.duration_s, 1 / FPS))
        motion = sha256(np.round(poses, 6).tobytes()).hexdigest()[:8]
        return f"{self.name}-{self.tissue}-{self.seed}-{self.duration_s:g}s-{motion}"

    @cached_property
    def world(self) -> World:
        """The tissue, its scanner and tracker."""
        return World(self.seed, settings=SETTINGS)

    @cached_property
    def reference(self) -> Calibration:
        """The calibration as it is while nothing is wrong."""
        size_px = SETTINGS.width_px, SETTINGS.height_px
        return replace(calibration_from_image_to_probe(self.world.image_to_probe, size_px), simulated=True)

    def probe(self, t_s: Array) -> Array:
        """(n,) → (n, 4, 4) picture → room, mm: what the tracker could see."""
        rows = ALL[self.name][0](t_s, np.random.default_rng((self.seed, 53)))
        R = rotation_from_vector(np.deg2rad(rows[3:]).T)
        skin = np.array([0.0, -SETTINGS.height_px * SETTINGS.scale_mm_per_px[1] / 2, 0.0])
        return rigid(R, skin + rows[:3].T - np.einsum("nij,j->ni", R, skin))

    def pictures(self, t_s: Array) -> Array:
        """(n,) → (n, 4, 4) picture → tissue, mm: what the scanner sees."""
        poses = self.probe(t_s).copy()
        poses[:, 1, 3] -= self._tissue_mm(t_s)
        return poses

    def touches(self, t_s: Array) -> NDArray[np.bool_]:
        """(n,) whether the probe is on the skin."""
        return ~lifted(self.name, t_s)

    def sensor(self, t_s: Array, body: Array) -> Array:
        """(n,) → (n, 4, 4) sensor → tracker without noise; body: (4, 4) sensor → picture, or (n, 4, 4) at each time."""
        return np.asarray(self.world.tissue_to_tracker @ self.probe(t_s) @ body)

    def _tissue_mm(self, t_s: Array) -> Array:
        if self.tissue == "still":
            return np.zeros_like(t_s)
        random = np.random.default_rng((self.seed, 59))
        breaths = int(self.duration_s * _BREATH_HZ * 2) + 2
        jitter = np.clip(1 + _JITTER * random.standard_normal((2, breaths)), 0.6, 1.4)
        starts = np.concatenate([[-random.uniform(0, 1 / _BREATH_HZ)], jitter[0] / _BREATH_HZ]).cumsum()
        number = np.searchsorted(starts, t_s, side="right") - 1
        share = (t_s - starts[number]) / np.diff(starts)[number]
        # Out is slow and in is quick: the fourth power of a cosine lingers at the end of breathing out.
        breath = _BREATH_MM * jitter[1][number] * (1 - np.cos(np.pi * share) ** 4)
        pulse = _PULSE_MM / 2 * np.sin(2 * np.pi * _PULSE_HZ * t_s + random.uniform(0, 2 * np.pi))
        return np.asarray(breath + pulse)


def picture_path(poses: Array) -> tuple[ComplexArray, Array]:
    """(n, 4, 4) picture → tissue to the way (n,) complex mm, lateral + i · axial, and turn (n,) rad that a perfect
    registration integrates, in the axes of the first picture (docs/method.md, section 7).
    """
    moved, turned, _ = steps_between(poses)
    turn = np.concatenate([[0.0], turned.cumsum()])
    return np.concatenate([[0.0], (-np.exp(-1j * turn[1:]) * moved).cumsum()]), turn


def steps_between(poses: Array) -> tuple[ComplexArray, Array, Array]:
    """(n, 4, 4) picture → anything: how what lies still moves from each picture to the next, in the axes of the later
    one: (n − 1,) complex mm, lateral + i · axial; rad in the plane; mm out of it.
    """
    A = inverse(poses[1:]) @ poses[:-1]
    turned = np.arctan2(A[:, 1, 0] - A[:, 0, 1], A[:, 0, 0] + A[:, 1, 1])
    return A[:, 0, 3] + 1j * A[:, 1, 3], turned, A[:, 2, 3]
