"""Computes what the scanner sees of one patient, picture by picture. It is seeded."""

from collections.abc import Iterator
from functools import cached_property, reduce

import numpy as np

from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import Matrix4
from probewatch.drivers.twins.scene.anatomy import (
    RIBS_MM,
    Beams,
    needle,
    off_the_skin,
    peeled,
    rib_place,
    ringing,
    shadowed,
)
from probewatch.drivers.twins.scene.breathing import DIRECTIONS, Rhythm
from probewatch.drivers.twins.scene.geometry import Geometry
from probewatch.drivers.twins.scene.sight import Sight
from probewatch.drivers.twins.scene.softness import Face, displacement
from probewatch.drivers.twins.scene.surroundings import Surroundings
from probewatch.drivers.twins.scene.tissue import Displacement, Floats

_ASIDE_MM = 5.0
"""Millimetres, at most, from the middle of the face to the place from which tissue gives way: a patient is rounder on
one side. With 0 no press would move tissue out of the plane. Not measured."""
_WALL_MM, _SLIDE_MM = 8.0, 2.0
"""Millimetres: how deep the wall of the body is, and over what depth it merges into the organ below: a thin person's
ribs and liver. A sharper change would be finer than what the renderer follows."""
_WALL_SHARE = 0.25
"""Share of the organ's breath that the wall makes, along another axis. Not measured."""


class Patient:
    """Moves the tissue of one patient. The skin at rest lies where the face is while picture and tissue have the same
    axes. Times are s, up to duration_s.
    """

    def __init__(self, surroundings: Surroundings, seed: int, geometry: Geometry, duration_s: float) -> None:
        self.surroundings = surroundings
        self._geometry, self._skin_mm = geometry, geometry.skin_mm
        self._rhythm = Rhythm(seed, duration_s)
        aside = np.random.default_rng((seed, 67)).uniform(-_ASIDE_MM, _ASIDE_MM, 2)
        self._aside_mm = (float(aside[0]), float(aside[1]))

    def breathed(self, t_s: Array) -> Array:
        """Returns how far the tissue has moved as a whole, (n,) → (n, 3), mm; for an organ under a wall, how far the
        wall has.
        """
        return self._way(t_s, wall=self.surroundings.organ)

    def sight(self, pose: Matrix4, t_s: float, drag_mm: Array) -> Sight | None:
        """Returns where tissue is seen; None for rigid tissue with nothing in it. pose: (4, 4) picture → tissue that
        has moved as a whole. drag_mm: (2,) drag of the skin.
        """
        now = self.surroundings
        shades = list(self._shades(pose, t_s, drag_mm))
        added = [part for _, part in shades]
        if now.needle:
            added.append(needle(self._geometry.x_mm, self._geometry.y_mm, t_s))
        if not (now.yields or added):
            return None
        return Sight(
            self._displacement(pose, t_s, drag_mm) if now.yields else None,
            reduce(np.multiply, [gain for gain, _ in shades]) if shades else None,
            reduce(np.add, added) if added else None,
        )

    def _shades(self, pose: Matrix4, t_s: float, drag_mm: Array) -> Iterator[tuple[Floats, Floats]]:
        """Yields (gain, added) of each thing that obstructs the beam."""
        now = self.surroundings
        for rib_mm in RIBS_MM.get(now.ribs, ()):
            rest = rib_place(rib_mm, self._skin_mm, pose)
            place = pose[:3, :3].T @ (rest + self.displaced(pose, rest, t_s, drag_mm) - pose[:3, 3])
            across_mm, depth_mm, spread = map(float, self._geometry.beam(*place[:2]))
            gain, added = shadowed(self._beams, across_mm, depth_mm, spread)
            yield gain, added + ringing(gain, self._beams, depth_mm) if now.gas else added
        if now.contact < 1:
            yield off_the_skin(self._beams, peeled(now.contact, t_s)) if now.peels else self._off_the_skin

    @cached_property
    def _beams(self) -> Beams:
        return self._geometry.beams()

    @cached_property
    def _off_the_skin(self) -> tuple[Floats, Floats]:
        return off_the_skin(self._beams, self.surroundings.contact)

    def displaced(self, pose: Matrix4, points_mm: Array, t_s: float, drag_mm: Array) -> Array:
        """Returns the displacement, (3, …) mm, of places in the tissue's axes, (3, …)."""
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
            across, down, middle = (pose[:3, column, None, None] for column in (0, 1, 3))
            return self.displaced(pose, across * x_mm + down * y_mm + middle, t_s, drag_mm)

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
    """Returns the face: it is the upper edge of the picture, whose middle is skin_mm from the middle of the picture."""
    middle = pose[:3, 3] + skin_mm * pose[:3, 1]
    return Face(middle, float(middle[1] - skin_mm), float(pose[1, 0] / pose[0, 0]), drag_mm)
