"""What the scanner sees of one patient, picture by picture. Seeded."""

import numpy as np

from drivers.rigid import Array
from drivers.samples import Matrix4
from drivers.twins.scene.breathing import DIRECTIONS, Rhythm
from drivers.twins.scene.sight import Sight
from drivers.twins.scene.softness import Face, displacement
from drivers.twins.scene.surroundings import Surroundings
from drivers.twins.scene.tissue import Displacement

_ASIDE_MM = 5.0
"""At most, by which tissue gives way from somewhere else than the middle of the face: a patient is rounder on one side.
0 would let no press move tissue out of the plane. Not measured."""
_WALL_MM, _SLIDE_MM = 8.0, 2.0
"""How deep the wall of the body is, and over what it goes over into the organ below: a thin person's ribs and liver.
A sharper change would be finer than what the renderer follows."""
_WALL_SHARE = 0.25
"""Of the organ's breath that the wall makes, along another axis. Not measured."""


class Patient:
    """skin_mm: y of the skin at rest, in the axes of the tissue. Times are s, up to duration_s."""

    def __init__(self, surroundings: Surroundings, seed: int, skin_mm: float, duration_s: float) -> None:
        self.surroundings = surroundings
        self._skin_mm = skin_mm
        self._rhythm = Rhythm(seed, duration_s)
        aside = np.random.default_rng((seed, 67)).uniform(-_ASIDE_MM, _ASIDE_MM, 2)
        self._aside_mm = (float(aside[0]), float(aside[1]))

    def breathed(self, t_s: Array) -> Array:
        """(n,) → (n, 3) how far the tissue has moved as a whole, mm; of an organ under a wall, the wall."""
        return self._way(t_s, wall=self.surroundings.organ)

    def sight(self, pose: Matrix4, t_s: float, drag_mm: Array) -> Sight | None:
        """pose: (4, 4) picture → tissue that has moved as a whole. drag_mm: (2,) of the skin. None for rigid tissue."""
        return Sight(self._displacement(pose, t_s, drag_mm)) if self.surroundings.yields else None

    def displaced(self, pose: Matrix4, points_mm: Array, t_s: float, drag_mm: Array) -> Array:
        """(3, …) places in the tissue's axes → (3, …) mm."""
        now = self.surroundings
        face = face_at(pose, self._skin_mm, drag_mm)
        moved = displacement(points_mm, face, now.follow, self._aside_mm)
        if now.organ:
            below = np.clip((points_mm[1] - self._skin_mm - _WALL_MM) / _SLIDE_MM + 0.5, 0.0, 1.0)
            t = np.array([t_s])
            further = (self._way(t, wall=False) - self._way(t, wall=True))[0]
            moved += np.multiply.outer(further, below * below * (3 - 2 * below))
        return moved

    def _displacement(self, pose: Matrix4, t_s: float, drag_mm: Array) -> Displacement:
        def moved(x_mm: Array, y_mm: Array) -> Array:
            across, down = pose[:3, 0, None, None] * x_mm, pose[:3, 1, None, None] * y_mm[:, None]
            return self.displaced(pose, across + down + pose[:3, 3, None, None], t_s, drag_mm)

        return moved

    def _way(self, t_s: Array, wall: bool) -> Array:
        now = self.surroundings
        to = np.array(now.breath_to)
        if wall:
            other = "lateral" if now.breath_to == DIRECTIONS["axial"] else "axial"
            to = _WALL_SHARE * np.array(DIRECTIONS[other])
        way = np.zeros((t_s.size, 3))
        if now.breath_mm:
            way += self._rhythm.breath_mm(t_s, now.breath_mm)[:, None] * to
        if now.pulse:
            way[:, 1] += self._rhythm.pulse_mm(t_s)
        return way


def face_at(pose: Matrix4, skin_mm: float, drag_mm: Array) -> Face:
    """The face is the upper edge of the picture, whose middle is skin_mm from the middle of the picture."""
    middle = pose[:3, 3] + skin_mm * pose[:3, 1]
    return Face(middle, float(middle[1] - skin_mm), float(pose[1, 0] / pose[0, 0]), drag_mm)
