"""Models a simulated cart's world over a patient: named surroundings, seen in order of time."""

from collections.abc import Collection

import numpy as np

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import GreyImage, Matrix4
from probewatch.drivers.twins.scene.patient import Patient
from probewatch.drivers.twins.scene.processing import ProcessingScanner
from probewatch.drivers.twins.scene.softness import dragged
from probewatch.drivers.twins.scene.surroundings import Surroundings, surroundings
from probewatch.drivers.twins.scene.world import World, WorldSettings

_HISTORY_HZ = 120.0
"""Rate at which the path of the face is followed between pictures: a third of a millimetre at 40 mm/s. More costs
time."""
_HISTORY_S = 30.0
"""Seconds of the past that a first picture asks for: the hand turns several times in it, after which the drag of the
skin no longer depends on where it began."""
_LONGEST_S = 7 * 86_400.0
"""Seconds of breaths that are drawn; after a week they begin again, with a jerk."""


def scanned(name: str) -> Surroundings:
    """Returns the surroundings of a name. Raises ConfigurationError for an unknown name, or one that names something
    over which a scanner has no control.
    """
    named = surroundings(name)
    if named.deep or named.tracker_mm:
        what = f"the world '{name}' changes the scale of the picture or the tracker, which only a study can"
        raise ConfigurationError(what, "simulated world", "Leave out deep and tracker")
    return named


class Bedside(World):
    """Shows a patient instead of rigid tissue. tissue: a name as `scanned` takes it."""

    def __init__(self, seed: int, program: str, settings: WorldSettings, tissue: str) -> None:
        named = scanned(tissue)
        super().__init__(seed, program, settings=settings, surroundings=named)
        self._patient = Patient(named, seed, self.geometry, _LONGEST_S)
        self._scanner, self._shown = ProcessingScanner(named.processing), (-1, np.zeros((0, 0), np.uint8))
        self._followed_s, self._face_mm, self._drag_mm = -np.inf, np.zeros(2), np.zeros(2)

    def frame(self, t_s: float, index: int, active: Collection[str] = ()) -> GreyImage:
        """Returns a picture as World.frame does; it averages over the pictures that were asked for before."""
        processing = self.surroundings.processing
        number = index // processing.repeats
        if number != self._shown[0]:
            pose = self._pose(t_s)
            plain = self.plain_at(pose, index, self._patient.sight(pose, t_s % _LONGEST_S, self._drag(t_s)))
            self._shown = number, self._scanner.processed(plain)
        return self._scanner.grabbed(self.on_screen(self._shown[1], active))

    def _pose(self, t_s: float) -> Matrix4:
        pose = self.trajectory.pose(t_s)
        pose[:3, 3] -= self._patient.breathed(np.array([t_s % _LONGEST_S]))[0]
        return pose

    def _drag(self, t_s: float) -> Array:
        """Returns the drag of the skin now, (2,) mm."""
        if not self.surroundings.play_mm:
            return self._drag_mm
        if not self._followed_s <= t_s <= self._followed_s + _HISTORY_S:
            self._followed_s, self._drag_mm = max(0.0, t_s - _HISTORY_S), np.zeros(2)
            self._face_mm = self._face(self._followed_s)
        while self._followed_s < t_s:
            self._followed_s = min(self._followed_s + 1 / _HISTORY_HZ, t_s)
            face_mm = self._face(self._followed_s)
            self._drag_mm = dragged(self._drag_mm, face_mm - self._face_mm, self.surroundings.play_mm)
            self._face_mm = face_mm
        return self._drag_mm

    def _face(self, t_s: float) -> Array:
        pose = self._pose(t_s)
        return np.asarray((pose[:3, 3] + self.geometry.skin_mm * pose[:3, 1])[[0, 2]])
