"""Computes one session as it truly was: where the probe, the tissue and the marker body were at every time.

Everything here is pure and seeded.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array, ComplexArray, inverse, rigid, rotation_from_vector
from probewatch.drivers.twins.scene.patient import Patient
from probewatch.drivers.twins.scene.sight import Sight
from probewatch.drivers.twins.scene.softness import dragged_along
from probewatch.drivers.twins.scene.surroundings import surroundings
from probewatch.drivers.twins.scene.world import World, WorldSettings
from probewatch.tools.study.hand import ALL, lifted

TISSUES = ("still", "breathing")
"""Worlds of which a study consists unless others are named: rigid tissue."""
SETTINGS = WorldSettings(width_px=400, height_px=300)
"""A quarter of a full picture's work, with enough speckle for the registration: 32 × 21 mm. Sizes of pictures were not
varied here."""

_DEEP = WorldSettings(width_px=400, height_px=450, scale_mm_per_px=(0.1, 0.1))
"""Settings of the world `deep`: 40 × 45 mm, as far as the simulated tissue goes before it repeats. Pixels as long as
the pulse, of .15 mm, are too coarse to be registered well."""

_CORNERS_MM = np.array([[-10.0, 10.0, -10.0, 10.0], [-9.0, -9.0, 9.0, 9.0]])
"""Places of the picture by whose displacement the title distinguishes one motion of the tissue from another."""

FPS = 30.0
"""Frame rate of a scanner's video output."""

_HISTORY_HZ = 240.0
"""Rate at which the path of the face over the skin is followed, whatever pictures are asked for: a quarter of a
millimetre at the quickest slide. Not varied."""


@dataclass(frozen=True)
class Session:
    """Represents a session. name: one of ALL. tissue: the world that the probe looks at, by name (`surroundings`).
    Times are s since its start; duration_s is its length.
    """

    name: str
    tissue: str
    seed: int
    duration_s: float

    @property
    def title(self) -> str:
        """Returns the title for file names; a different motion has a different one, whatever the session is called."""
        t_s = np.arange(0.0, self.duration_s, 1 / FPS)
        poses, soft = self.pictures(t_s), self.patient.surroundings.yields
        moved = [np.round(self.displaced(t, _CORNERS_MM), 6).tobytes() for t in t_s] if soft else []
        motion = sha256(b"".join([np.round(poses, 6).tobytes(), *moved])).hexdigest()[:8]
        return f"{self.name}-{self.tissue}-{self.seed}-{self.duration_s:g}s-{motion}"

    @cached_property
    def world(self) -> World:
        """Returns the tissue, its scanner and tracker."""
        named = surroundings(self.tissue)
        settings = _DEEP if named.deep else SETTINGS
        return World(self.seed, settings=settings, surroundings=named)

    @property
    def size_px(self) -> tuple[int, int]:
        """Returns the size of a picture, columns and rows."""
        return self.world.settings.width_px, self.world.settings.height_px

    @property
    def at_rest(self) -> "Session":
        """Returns the same hand and picture on rigid tissue that is still."""
        return replace(self, tissue="deep" if self.world.surroundings.deep else "still")

    @cached_property
    def patient(self) -> Patient:
        """Returns what the probe is on."""
        return Patient(self.world.surroundings, self.seed, self.world.geometry, self.duration_s)

    @cached_property
    def reference(self) -> Calibration:
        """Returns the calibration as it is while nothing is wrong."""
        return replace(calibration_from_image_to_probe(self.world.image_to_probe, self.size_px), simulated=True)

    def probe(self, t_s: Array) -> Array:
        """Returns what the tracker could see, (n,) → (n, 4, 4) picture → room, mm."""
        rows = ALL[self.name][0](t_s, np.random.default_rng((self.seed, 53)))
        R = rotation_from_vector(np.deg2rad(rows[3:]).T)
        skin = np.array([0.0, self.world.geometry.skin_mm, 0.0])
        return rigid(R, skin + rows[:3].T - np.einsum("nij,j->ni", R, skin))

    def pictures(self, t_s: Array) -> Array:
        """Returns what the scanner sees of the tissue, as far as it moves as a whole, (n,) → (n, 4, 4) picture →
        tissue, mm.
        """
        poses = self.probe(t_s).copy()
        poses[:, :3, 3] -= self.patient.breathed(t_s)
        return poses

    def sights(self, t_s: Array) -> Iterator[Sight | None]:
        """Yields how each picture differs from what `pictures` gives, (n,) → n."""
        drags_mm = self._drags(t_s)
        for pose, t, drag_mm in zip(self.pictures(t_s), t_s, drags_mm, strict=True):
            yield self.patient.sight(pose, float(t), drag_mm)

    def displaced(self, t_s: float, places_mm: Array) -> Array:
        """Returns how far what is seen at places has moved from rest beyond what `pictures` gives, mm, in the axes of
        the tissue: (2, m) places in the picture, mm from its middle → (3, m).
        """
        t = np.array([t_s])
        pose = self.pictures(t)[0]
        points = pose[:3, :2] @ places_mm + pose[:3, 3, None]
        return self.patient.displaced(pose, points, t_s, self._drags(t)[0])

    def touches(self, t_s: Array) -> NDArray[np.bool_]:
        """Returns whether the probe is on the skin, (n,)."""
        return ~lifted(self.name, t_s)

    def sensor(self, t_s: Array, body: Array) -> Array:
        """Returns the true poses without noise, (n,) → (n, 4, 4) sensor → tracker. body: (4, 4) sensor → picture, or
        (n, 4, 4) at each time.
        """
        return np.asarray(self.world.tissue_to_tracker @ self.probe(t_s) @ body)

    def _drags(self, t_s: Array) -> Array:
        """Returns how far the face holds the skin from its rest, (n, 2) mm, lateral and elevational."""
        history_s, held_mm = self._history
        return np.stack([np.interp(t_s, history_s, axis) for axis in held_mm.T], axis=1)

    @cached_property
    def _history(self) -> tuple[Array, Array]:
        """Returns times over the whole session, and the drags at these times."""
        t_s = np.arange(0.0, self.duration_s + 1 / _HISTORY_HZ, 1 / _HISTORY_HZ)
        play_mm = self.patient.surroundings.play_mm
        if not play_mm:
            return t_s, np.zeros((t_s.size, 2))
        poses = self.pictures(t_s)
        faces = poses[:, :3, 3] + self.world.geometry.skin_mm * poses[:, :3, 1]
        return t_s, dragged_along(faces[:, [0, 2]], play_mm, self.touches(t_s))


def picture_path(poses: Array) -> tuple[ComplexArray, Array]:
    """Returns the path that a perfect registration integrates from poses, (n, 4, 4) picture → tissue: (n,) complex mm,
    lateral + i · axial, and turn (n,) rad, in the axes of the first picture (docs/method.md, section 7).
    """
    moved, turned, _ = steps_between(poses)
    turn = np.concatenate([[0.0], turned.cumsum()])
    return np.concatenate([[0.0], (-np.exp(-1j * turn[1:]) * moved).cumsum()]), turn


def steps_between(poses: Array) -> tuple[ComplexArray, Array, Array]:
    """Returns how what is stationary moves from each picture to the next, in the axes of the later one: (n − 1,)
    complex mm, lateral + i · axial; rad in the plane; mm out of it. poses: (n, 4, 4) picture → anything.
    """
    A = inverse(poses[1:]) @ poses[:-1]
    turned = np.arctan2(A[:, 1, 0] - A[:, 0, 1], A[:, 0, 0] + A[:, 1, 1])
    return A[:, 0, 3] + 1j * A[:, 1, 3], turned, A[:, 2, 3]
