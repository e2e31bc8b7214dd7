"""Computes B-mode echoes of simulated tissue: 3-D scatterers seen through the point-spread function of a probe.

The echo field at picture point u is F(u) = ∫ h(u − v) s(T v) dv with scatterers s fixed in the tissue, T the pose P →
C, and h = Gaussian × exp(i K y) fixed in the PROBE. The carrier therefore turns with the probe, which is why speckle
changes with in-plane rotation and tilt. Stored is b = s · exp(−i K y_C): white like s, but without the carrier, so a
grid as coarse as a pixel samples it; moving the carrier from tissue to probe axes costs a phase ramp: |F(u)| = |∫ g(u −
v) b(T v) exp(i K (ŷ_C · R v − v_y)) dv|, g the Gaussian alone.

Tissue that has moved by w(T v) shows at v what lies at T v − w when it is at rest, so w is subtracted from T v wherever
it occurs: the echo's place changes by w, and its phase by K w_y.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import ceil
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from probewatch.drivers.rigid import Array
from probewatch.drivers.samples import Matrix4

Floats = NDArray[np.float32]
Complexes = NDArray[np.complex64]
Displacement = Callable[[Array, Array], Array]
"""Places of the picture x and y, mm from its middle, that make up (n, m) together → (3, n, m) how far what is seen
there has moved, mm, in the axes of the tissue."""


@dataclass(frozen=True, slots=True)
class Beam:
    """Describes the point-spread function: amplitude ∝ exp(−Σ x²/2σ²) exp(i carrier y).

    lateral_mm, axial_mm, elevational_mm: σ of the echo amplitude. carrier_rad_per_mm: 4π ÷ wavelength (5 MHz). The
    intensity correlation is exp(−Δz²/2σz²) against elevation and exp(−(K σx α)²/2) against in-plane rotation.
    """

    lateral_mm: float = 0.505
    axial_mm: float = 0.150
    elevational_mm: float = 0.759
    carrier_rad_per_mm: float = 40.8


STEP_MM = (0.16, 0.07, 1.27)
_POINTS = (480, 760, 11)
_TAPS = 4
_PAD = 12
_ROWS = _POINTS[1] + 2 * _PAD
"""Grid of the tissue (x, y, z): steps of two pixels across and one down, and under two σ of the beam out of plane.
Finer ones take memory and time. Then the numbers of points, the points of the spline across planes, and a margin into
which interpolation may step."""

PERIOD_MM = tuple(step * points for step, points in zip(STEP_MM, _POINTS, strict=True))
"""The tissue repeats after 76.8 × 53.2 × 14.0 mm (x, y, z); its origin is in the middle, so few pictures wrap."""

_NODE_MM = 0.5
"""Millimetres between places at which a displacement is asked for; a cubic spline goes through them. A press is
followed to .007 mm, an organ that slides by 12 mm under its wall to .15 mm; with .75 mm to .31 mm, with .375 mm to .08
mm. Closer ones cost time."""
_LAYERS = (16, 5.0)
"""Layers of a muscle: number of fasciae in the period of the tissue, one every 3 mm, and their strength: three times
that in other tissue, ten decibels."""


class Tissue:
    """Holds scatterers without carrier, in planes across z, on a grid that wraps around in all three directions.

    real, imaginary: planes below one another, each (rows + 2 pad, columns + 2 pad) float32. The pad and three more
    planes repeat the other end, so that interpolation may step over the edge.
    """

    def __init__(self, seed: int, structures: bool = True, layers: bool = False) -> None:
        random = np.random.default_rng((seed, 23))
        columns, rows, planes = _POINTS
        white = random.standard_normal((planes, rows, columns, 2), np.float32).view(np.complex64)[..., 0]
        if structures:
            for add in (_add_texture, _add_inclusions, _add_surfaces):
                add(white, random)
        if layers:
            _add_surfaces(white, random, *_LAYERS)
        self.real, self.imaginary = _stored(white.real), _stored(white.imag)


@lru_cache(maxsize=3)
def grown(seed: int, structures: bool, layers: bool = False) -> Tissue:
    """Returns the tissue of this seed, shared by the worlds of a process that look at it: it costs half a second and 44
    MB.
    """
    return Tissue(seed, structures, layers)


def _wrapped_mm(axis: int, centre_mm: float) -> Floats:
    """Returns the signed distance of each grid point from centre_mm along one axis of the periodic tissue."""
    period = PERIOD_MM[axis]
    place = np.arange(_POINTS[axis]) * STEP_MM[axis] - centre_mm
    return ((place + period / 2) % period - period / 2).astype(np.float32)


def _add_texture(white: Complexes, random: np.random.Generator) -> None:
    """Adds layers and lobules: the echo strength varies by some decibels over several millimetres."""
    x, y, z = (_wrapped_mm(axis, 0.0) * np.float32(2 * np.pi / PERIOD_MM[axis]) for axis in range(3))
    lobes = np.zeros((3, len(y), len(x)), np.float32)
    for lobe in (0, 0, 0, 1, 1, 2, 2):
        across, down, phase = random.integers(-3, 4), random.integers(2, 8), random.uniform(0, 2 * np.pi)
        lobes[lobe] += np.float32(0.13) * np.cos(across * x[None, :] + down * y[:, None] + np.float32(phase))
    for plane, angle in enumerate(z):
        white[plane] *= 1 + lobes[0] + lobes[1] * np.cos(angle) + lobes[2] * np.sin(angle)


def _add_inclusions(white: Complexes, random: np.random.Generator) -> None:
    """Adds cysts, without echo inside, and echogenic blobs; ellipsoids with soft rims."""
    for gain, count, size_mm in ((0.03, 12, 2.6), (2.8, 16, 1.8), (6.0, 60, 0.4)):
        for _ in range(count):
            centre_mm = random.uniform(0, PERIOD_MM)
            radii_mm = size_mm * random.uniform(0.7, 1.4, 3) * (1.2, 1.0, 1.3)
            away = [_wrapped_mm(axis, centre_mm[axis]) / np.float32(radii_mm[axis]) for axis in range(3)]
            near = [np.flatnonzero(np.abs(distance) < 1.15) for distance in away]
            x, y, z = (distance[kept] ** 2 for distance, kept in zip(away, near, strict=True))
            radius = np.sqrt(x[None, None, :] + y[None, :, None] + z[:, None, None])
            inside = np.clip((1.15 - radius) / np.float32(0.3), 0, 1)
            white[np.ix_(near[2], near[1], near[0])] *= 1 + np.float32(gain - 1) * inside


def _add_surfaces(white: Complexes, random: np.random.Generator, count: int = 5, strength: float = 1.5) -> None:
    """Adds fasciae: thin gently waved sheets that echo in phase, hence bright where the beam meets them squarely."""
    x, z = (_wrapped_mm(axis, 0.0) * np.float32(2 * np.pi / PERIOD_MM[axis]) for axis in (0, 2))
    for depth_mm in random.uniform(0.02, 0.18) * PERIOD_MM[1] + np.arange(count) * (PERIOD_MM[1] / count):
        phase_x, phase_z = random.uniform(0, 2 * np.pi, 2)
        waves_mm = 0.5 * np.sin(x + phase_x)[None, :] + 0.03 * np.sin(3 * x[None, :] + z[:, None] + phase_z)
        sheet_mm = (depth_mm + waves_mm).astype(np.float32)
        rows = np.arange(round((depth_mm - 1) / STEP_MM[1]), round((depth_mm + 1) / STEP_MM[1]))
        away_mm = (rows * np.float32(STEP_MM[1]))[None, :, None] - sheet_mm[:, None, :]
        phase = np.exp(np.complex64(-1j * Beam().carrier_rad_per_mm) * sheet_mm)[:, None, :]
        white[:, rows % _POINTS[1]] += np.float32(strength) * np.exp(away_mm**2 * np.float32(-1 / (2 * 0.1**2))) * phase


def bell(place: NDArray[Any], sigma: float) -> Floats:
    """Returns Gaussian weights that keep the variance of white noise."""
    taps = np.exp(-((place / sigma) ** 2) / 2)
    return np.asarray(taps / np.sqrt(np.sum(taps**2)), np.float32)


def _stored(planes: Floats) -> Floats:
    """Pads the planes around and stacks them, with mean square ½ after the four taps of the elevational spline."""
    grown = np.pad(planes, ((0, _TAPS - 1), (_PAD, _PAD), (_PAD, _PAD)), mode="wrap")
    return grown.reshape(-1, _POINTS[0] + 2 * _PAD) / np.float32(np.sqrt(2 * 0.479))


class Renderer:
    """Computes the field of echoes in one picture geometry.

    size_px: (width, height). scale_mm_per_px: (lateral, axial). Work is done on every second column; the point spread
    function, several pixels wide, fills in the others exactly.
    """

    def __init__(self, size_px: tuple[int, int], scale_mm_per_px: tuple[float, float], beam: Beam) -> None:
        sigma_px = (beam.lateral_mm / scale_mm_per_px[0] / 2, beam.axial_mm / scale_mm_per_px[1])
        self._lay(size_px, sigma_px, beam)
        self._x_mm = ((np.arange(self._columns) - self._reach[0]) * 2 - (size_px[0] - 1) / 2) * scale_mm_per_px[0]
        self._y_mm = (np.arange(self._rows) - self._reach[1] - (size_px[1] - 1) / 2) * scale_mm_per_px[1]

    def _lay(self, size_px: tuple[int, int], sigma: tuple[float, float], beam: Beam) -> None:
        """Lays out the grid of echoes for a picture of this size. sigma: that of the beam in columns and rows of the
        grid.
        """
        self._size_px, self._carrier = size_px, beam.carrier_rad_per_mm
        reach = self._reach = [ceil(3.2 * one) for one in sigma]
        self._columns, self._rows = (size_px[0] + 1) // 2 + 2 * reach[0] + 1, size_px[1] + 2 * reach[1]
        self._down = bell(np.arange(-reach[1], reach[1] + 1), sigma[1])
        self._across = [bell(np.arange(-reach[0], reach[0] + 1) - half, sigma[0]) for half in (0.0, 0.5)]

    def field(self, tissue: Tissue, pose: Matrix4, moved: Displacement | None = None) -> tuple[Floats, Floats]:
        """Returns the real and imaginary part of F, each (height, width); mean |F|² is 1 for uniform tissue.

        pose: (4, 4) P → C, mm. moved: must be smooth over a millimetre.
        """
        drift_mm = None if moved is None else self._drift(moved)
        per_plane_rad = self._carrier * pose[1, 2] / pose[2, 2] * STEP_MM[2]
        along_rad = self._carrier * (pose[1, :2] - (0, 1)) - per_plane_rad / STEP_MM[2] * pose[2, :2]
        echoes = self._slice(tissue, pose, per_plane_rad, drift_mm)
        if drift_mm is not None:
            back_rad = np.float32(per_plane_rad / STEP_MM[2]) * drift_mm[2] - np.float32(self._carrier) * drift_mm[1]
            echoes *= turned(back_rad)
        echoes = self._carried(echoes, along_rad)
        return self._spread(echoes.real), self._spread(echoes.imag)

    def _carried(self, echoes: Complexes, along_rad: Array) -> Complexes:
        """Multiplies by the part of the carrier's phase that is linear in the picture."""
        echoes *= np.exp(1j * along_rad[0] * self._x_mm).astype(np.complex64)[None, :]
        echoes *= np.exp(1j * along_rad[1] * self._y_mm).astype(np.complex64)[:, None]
        return echoes

    def _drift(self, moved: Displacement) -> Floats:
        """Returns the displacement at every grid point, (3, rows, columns) mm."""
        (nodes_x, across), (nodes_y, down) = self._nodes
        nodes = moved(*self._node_places(nodes_x, nodes_y)).astype(np.float32)
        return np.asarray(down @ nodes @ across.T, np.float32)

    @cached_property
    def _nodes(self) -> list[tuple[Array, Floats]]:
        """Returns the nodes along columns and rows, and the matrices that turn values there into values at the grid
        points.
        """
        found = []
        for place, step in zip(self._axes(), self._node_steps(), strict=True):
            nodes = np.linspace(place[0], place[-1], ceil(np.ptp(place) / step) + 1)
            found.append((nodes, np.asarray(CubicSpline(nodes, np.eye(nodes.size))(place), np.float32)))
        return found

    def _axes(self) -> tuple[Array, Array]:
        """Returns where the grid points are along columns and rows."""
        return np.asarray(self._x_mm, np.float64), np.asarray(self._y_mm, np.float64)

    def _node_steps(self) -> tuple[float, float]:
        """Returns the steps between nodes, in the unit of each axis."""
        return _NODE_MM, _NODE_MM

    def _node_places(self, across: Array, down: Array) -> tuple[Array, Array]:
        """Returns x and y of nodes, mm."""
        return across, down[:, None]

    def _slice(self, tissue: Tissue, pose: Matrix4, per_plane_rad: float, drift_mm: Floats | None) -> Complexes:
        """Returns b summed along the elevational axis of the beam, over the four stored planes that its profile
        reaches.

        The carrier's phase at a plane is that of the whole number of the plane; field() adds the part that is linear in
        the picture.
        """
        column, row, plane = (self._index(pose, axis, drift_mm) for axis in range(3))
        below = np.floor(plane)
        plane -= below
        number = below.astype(np.intp)
        lowest = int(number.min())
        turns = np.exp(1j * per_plane_rad * np.arange(lowest, int(number.max()) + _TAPS)).astype(np.complex64)
        number -= lowest
        column, row = _wrapped(column, 0), _wrapped(row, 1) + _wrapped(below, 2) * np.float32(_ROWS)
        # One plane further along the beam lies this far aside in the tissue, in columns and rows.
        aside = [np.float32(pose[axis, 2] / pose[2, 2] * STEP_MM[2] / STEP_MM[axis]) for axis in (0, 1)]
        echoes = np.zeros(plane.shape, np.complex64)
        for tap, weight in enumerate(_spline(plane)):
            beyond = np.float32(tap - 1) - plane
            place = column + aside[0] * beyond, row + (aside[1] * beyond + np.float32(tap * _ROWS))
            parts = [_interpolated(part, *place) for part in (tissue.real, tissue.imaginary)]
            echoes += cv2.merge(parts).view(np.complex64)[..., 0] * (turns[tap:][number] * weight)
        return echoes

    def _index(self, pose: Matrix4, axis: int, drift_mm: Floats | None) -> Floats:
        """Returns the place of every grid point along one tissue axis, in steps of the stored tissue, not wrapped."""
        middle_mm = pose[axis, 3] + PERIOD_MM[axis] / 2
        across = ((pose[axis, 0] * self._x_mm + middle_mm) / STEP_MM[axis]).astype(np.float32)
        down = (pose[axis, 1] * self._y_mm / STEP_MM[axis]).astype(np.float32)
        index: Floats = across[None, :] + down[:, None]
        return index if drift_mm is None else index - drift_mm[axis] * np.float32(1 / STEP_MM[axis])

    def _spread(self, part: Floats) -> Floats:
        """Convolves with the Gaussian, and interpolates the columns in between."""
        width, height = self._size_px
        kept = (slice(self._reach[1], self._reach[1] + height), slice(self._reach[0], -self._reach[0]))
        whole = np.empty((height, width), np.float32)
        for first, across in enumerate(self._across):
            whole[:, first::2] = cv2.sepFilter2D(part, -1, across, self._down)[kept][:, : (width - first + 1) // 2]
        return whole


def turned(phase_rad: Floats) -> Complexes:
    """Returns exp(i phase)."""
    return cv2.merge(cv2.polarToCart(np.ones_like(phase_rad), phase_rad)).view(np.complex64)[..., 0]


def _interpolated(stored: Floats, column: Floats, row: Floats) -> Floats:
    """Returns bilinear samples of one part of the stored tissue."""
    band = stored[int(row.min()) : int(row.max()) + 2]
    if len(band) < 2 * _ROWS:
        # Reading the band in order first fills the cache; scattered reads wait for memory and take three times as long.
        band.max()
    return np.asarray(cv2.remap(stored, column, row, cv2.INTER_LINEAR), np.float32)


def _wrapped(index: Floats, axis: int) -> Floats:
    """Returns the index brought into one period; columns and rows then skip the pad."""
    turns = np.floor(index * np.float32(1 / _POINTS[axis]))
    wrapped: Floats = index + (np.float32(_PAD if axis < 2 else 0) - turns * np.float32(_POINTS[axis]))
    return wrapped


def _spline(part: Floats) -> list[Floats]:
    """Returns the cubic B-spline at distances 1 + part, part, 1 − part, 2 − part: smooth, and near enough a Gaussian
    beam.
    """
    rest = 1 - part
    square, rest_square = part * part, rest * rest
    inner = [(4 - (6 - 3 * part) * square) / 6, (4 - (6 - 3 * rest) * rest_square) / 6]
    return [np.asarray(weight, np.float32) for weight in (rest_square * rest / 6, *inner, square * part / 6)]
