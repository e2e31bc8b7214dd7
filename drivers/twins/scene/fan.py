"""Computes echoes of a convex probe: speckle made along its beams, so its cell widens with depth and turns with the
beam.
"""

from math import ceil

import cv2
import numpy as np

from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import Matrix4
from probewatch.drivers.twins.scene.geometry import Geometry
from probewatch.drivers.twins.scene.tissue import PERIOD_MM, STEP_MM, Beam, Complexes, Floats, Renderer, turned

FAN_BEAM = Beam(lateral_mm=0.505, axial_mm=0.2, carrier_rad_per_mm=28.6)
"""3.5 MHz, as convex probes have; the lateral width is that half way down. At 5 MHz the carrier would turn faster
across a beam 28° off the axis (20° of the fan and a rock) than a grid of .16 mm can hold."""
_MARGIN_DEG = 1.0
"""Degrees beyond the edges of the sector, for interpolation."""


class FanRenderer(Renderer):
    """Works on beams (columns) and depths (rows) and turns them into a picture. geometry: that of a fan."""

    def __init__(self, geometry: Geometry, half_angle_deg: float, beam: Beam = FAN_BEAM) -> None:
        apex_mm, step_mm = geometry.apex_mm, geometry.scale_mm_per_px[1]
        assert apex_mm is not None
        near_mm, far_mm = geometry.skin_mm - apex_mm, -geometry.skin_mm - apex_mm
        half_rad = np.radians(half_angle_deg + _MARGIN_DEG)
        step_rad = STEP_MM[0] / 2 / far_mm
        columns, rows = 2 * ceil(half_rad / step_rad) + 1, ceil((far_mm - near_mm) / step_mm) + 1
        middle_mm = (near_mm + far_mm) / 2
        sigma = (beam.lateral_mm / middle_mm / step_rad / 2, beam.axial_mm / step_mm)
        self._lay((columns, rows), sigma, beam)
        angle = np.asarray(((np.arange(self._columns) - self._reach[0]) * 2 - (columns - 1) / 2) * step_rad)
        radius = np.asarray(near_mm + (np.arange(self._rows) - self._reach[1]) * step_mm)
        self._angle, self._radius, self._apex_mm = angle, radius, apex_mm
        self._along_mm, self._down_mm = _places(angle, radius, apex_mm)
        # Nearer the apex the beams lie closer than the grid of the tissue, and neighbours see the same scatterer.
        self._even = np.sqrt(radius / far_mm).astype(np.float32)[:, None]
        x_mm, y_mm = geometry.x_mm, geometry.y_mm - apex_mm
        self._to_column = (np.arctan2(x_mm, y_mm) / step_rad + (columns - 1) / 2).astype(np.float32)
        self._to_row = ((np.hypot(x_mm, y_mm) - near_mm) / step_mm).astype(np.float32)

    def _node_places(self, across: Array, down: Array) -> tuple[Array, Array]:
        return _places(across, down, self._apex_mm)

    def _axes(self) -> tuple[Array, Array]:
        return self._angle, self._radius

    def _node_steps(self) -> tuple[float, float]:
        across, down = super()._node_steps()
        return across / float(self._radius[-1]), down

    def _index(self, pose: Matrix4, axis: int, drift_mm: Floats | None) -> Floats:
        place = pose[axis, 0] * self._along_mm + pose[axis, 1] * self._down_mm + pose[axis, 3] + PERIOD_MM[axis] / 2
        place = place if drift_mm is None else place - drift_mm[axis]
        return np.asarray(place / STEP_MM[axis], np.float32)

    def _carried(self, echoes: Complexes, along_rad: Array) -> Complexes:
        """Applies the carrier along each beam instead of along the axis of the picture."""
        beam_mm = self._down_mm - self._radius[:, None]
        phase = along_rad[0] * self._along_mm + along_rad[1] * self._down_mm + self._carrier * beam_mm
        return np.asarray(echoes * turned(phase.astype(np.float32)) * self._even)

    def _spread(self, part: Floats) -> Floats:
        beams = super()._spread(part)
        return np.asarray(cv2.remap(beams, self._to_column, self._to_row, cv2.INTER_LINEAR), np.float32)


def _places(angle: Array, radius: Array, apex_mm: float) -> tuple[Array, Array]:
    """Returns x and y, (n, m), mm from the middle of the picture, of beams (m,) rad at distances (n,) from the apex."""
    return radius[:, None] * np.sin(angle), apex_mm + radius[:, None] * np.cos(angle)
