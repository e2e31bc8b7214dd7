"""B-mode echoes of simulated tissue: 3-D scatterers seen through the point-spread function of a probe.

The echo field at picture point u is F(u) = ∫ h(u − v) s(T v) dv with scatterers s fixed in the tissue, T the pose
P → C, and h = Gaussian × exp(i K y) fixed in the PROBE. The carrier therefore turns with the probe, which is why
speckle changes with in-plane rotation and tilt. Stored is b = s · exp(−i K y_C): white like s, but without the
carrier, so a grid as coarse as a pixel samples it; moving the carrier from tissue to probe axes costs a phase ramp:
|F(u)| = |∫ g(u − v) b(T v) exp(i K (ŷ_C · R v − v_y)) dv|, g the Gaussian alone.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.samples import Matrix4

Floats = NDArray[np.float32]
Complexes = NDArray[np.complex64]


@dataclass(frozen=True, slots=True)
class Beam:
    """Point-spread function: amplitude ∝ exp(−Σ x²/2σ²) exp(i carrier y).

    lateral_mm, axial_mm, elevational_mm: σ of the echo amplitude. carrier_rad_per_mm: 4π ÷ wavelength (5 MHz).
    Intensity correlation exp(−Δz²/2σz²) against elevation and exp(−(K σx α)²/2) against in-plane rotation.
    """

    lateral_mm: float = 0.505
    axial_mm: float = 0.150
    elevational_mm: float = 0.759
    carrier_rad_per_mm: float = 40.8


_STEP_MM = (0.12, 0.07, 0.35)
_POINTS = (500, 640, 36)
_PAD = 2
PERIOD_MM = tuple(step * points for step, points in zip(_STEP_MM, _POINTS, strict=True))
"""The tissue repeats after 60 × 44.8 × 12.6 mm (x, y, z)."""

_PLANE_MM = 0.5
"""σ of the slice that a stored plane already integrates; the rest of the beam is summed while rendering."""


class Tissue:
    """Scatterers without carrier, on a grid that wraps around in all three directions.

    atlas: (planes + 1) planes below one another, each (rows + pad, columns + pad, 2) float32, real and imaginary;
    the extra plane and the pad repeat the beginning, so that interpolation may step over the edge.
    """

    def __init__(self, seed: int, structures: bool = True) -> None:
        random = np.random.default_rng((seed, 23))
        columns, rows, planes = _POINTS
        white = random.standard_normal((planes, rows, columns, 2), np.float32).view(np.complex64)[..., 0]
        if structures:
            for add in (_add_texture, _add_inclusions, _add_surfaces):
                add(white, random)
        self.atlas = _padded(_integrated(white))


def _wrapped_mm(axis: int, centre_mm: float) -> Floats:
    """Signed distance of each grid point from centre_mm along one axis of the periodic tissue."""
    period = PERIOD_MM[axis]
    place = np.arange(_POINTS[axis]) * _STEP_MM[axis] - centre_mm
    return ((place + period / 2) % period - period / 2).astype(np.float32)


def _add_texture(white: Complexes, random: np.random.Generator) -> None:
    """Layers and lobules: the echo strength varies by some decibels over several millimetres."""
    y, z, x = (_wrapped_mm(axis, 0.0) * (2 * np.pi / PERIOD_MM[axis]) for axis in (1, 2, 0))
    for _ in range(6):
        across, down, out = random.integers(-3, 4), random.integers(2, 8), random.integers(-1, 2)
        phase = random.uniform(0, 2 * np.pi)
        swing = np.cos(out * z[:, None, None] + down * y[None, :, None] + phase + across * x[None, None, :])
        white *= 1 + np.float32(0.13) * swing


def _add_inclusions(white: Complexes, random: np.random.Generator) -> None:
    """Cysts, without echo inside, and echogenic blobs; ellipsoids with soft rims."""
    for gain, count, size_mm in ((0.03, 7, 2.6), (2.8, 8, 1.6), (6.0, 14, 0.35)):
        for _ in range(count):
            centre_mm = random.uniform(0, PERIOD_MM)
            radii_mm = size_mm * random.uniform(0.7, 1.4, 3) * (1.2, 1.0, 1.8)
            near = [np.flatnonzero(np.abs(_wrapped_mm(a, centre_mm[a])) < 1.5 * radii_mm[a]) for a in range(3)]
            x, y, z = (_wrapped_mm(a, centre_mm[a])[near[a]] / np.float32(radii_mm[a]) for a in range(3))
            radius = np.sqrt(x[None, None, :] ** 2 + y[None, :, None] ** 2 + z[:, None, None] ** 2)
            inside = np.clip((1.15 - radius) / 0.3, 0, 1)
            white[np.ix_(near[2], near[1], near[0])] *= 1 + (gain - 1) * inside


def _add_surfaces(white: Complexes, random: np.random.Generator) -> None:
    """Fasciae: thin gently waved sheets that echo in phase, hence bright where the beam meets them squarely."""
    carrier = Beam().carrier_rad_per_mm
    x, z = (_wrapped_mm(axis, 0.0) * np.float32(2 * np.pi / PERIOD_MM[axis]) for axis in (0, 2))
    y = np.arange(_POINTS[1], dtype=np.float32) * np.float32(_STEP_MM[1])
    for depth_mm in random.uniform(0.02, 0.18) * PERIOD_MM[1] + np.arange(5) * (PERIOD_MM[1] / 5):
        phase_x, phase_z = random.uniform(0, 2 * np.pi, 2)
        for plane in range(_POINTS[2]):
            sheet_mm = depth_mm + 0.5 * np.sin(x + phase_x) + 0.15 * np.sin(2 * x + z[plane] + phase_z)
            near = (y > sheet_mm.min() - 0.5) & (y < sheet_mm.max() + 0.5)
            away_mm = y[near, None] - sheet_mm[None, :]
            echo = np.exp(-((away_mm / 0.1) ** 2) / 2) * np.exp(-1j * carrier * sheet_mm)[None, :]
            white[plane, near] += (1.6 * echo).astype(np.complex64)


def _integrated(white: Complexes) -> Complexes:
    """Each plane summed over the slice thickness it stands for, unit variance where the tissue is uniform."""
    planes = len(white)
    weights = np.exp(-((_wrapped_mm(2, 0.0) / _PLANE_MM) ** 2) / 2)
    weights /= np.sqrt(2 * np.sum(weights**2))
    wheel = np.stack([np.roll(weights, plane) for plane in range(planes)]).astype(np.float32)
    flat = white.view(np.float32).reshape(planes, -1)
    mixed: Complexes = (wheel @ flat).view(np.complex64).reshape(white.shape)
    return mixed


def _padded(planes: Complexes) -> Floats:
    grown = np.pad(planes, ((0, 1), (0, _PAD), (0, _PAD)), mode="wrap")
    return grown.reshape(-1, grown.shape[2]).view(np.float32).reshape(-1, grown.shape[2], 2)


class Renderer:
    """The field of echoes in one picture geometry.

    size_px: (width, height). scale_mm_per_px: (lateral, axial). Work is done on every second column and the point
    spread function, five pixels wide, fills in the others exactly.
    """

    def __init__(self, size_px: tuple[int, int], scale_mm_per_px: tuple[float, float], beam: Beam) -> None:
        self._size_px, self._beam = size_px, beam
        sigma_px = (beam.lateral_mm / scale_mm_per_px[0] / 2, beam.axial_mm / scale_mm_per_px[1])
        reach = [ceil(3.2 * sigma) for sigma in sigma_px]
        columns, rows = (size_px[0] + 1) // 2 + 2 * reach[0] + 1, size_px[1] + 2 * reach[1]
        self._x_mm = ((np.arange(columns) - reach[0]) * 2 - (size_px[0] - 1) / 2) * scale_mm_per_px[0]
        self._y_mm = (np.arange(rows) - reach[1] - (size_px[1] - 1) / 2) * scale_mm_per_px[1]
        self._reach = reach
        self._down = _bell(np.arange(-reach[1], reach[1] + 1), sigma_px[1])
        self._across = [_bell(np.arange(-reach[0], reach[0] + 1) - half, sigma_px[0]) for half in (0.0, 0.5)]

    def field(self, tissue: Tissue, pose: Matrix4) -> tuple[Floats, Floats]:
        """Real and imaginary part of F, each (height, width), unit variance of |F|² for uniform tissue.

        pose: (4, 4) P → C, mm.
        """
        echoes = sum(self._slices(tissue, pose))
        assert isinstance(echoes, np.ndarray)
        carrier = self._beam.carrier_rad_per_mm
        echoes *= np.exp(1j * carrier * pose[1, 0] * self._x_mm).astype(np.complex64)[None, :]
        echoes *= np.exp(1j * carrier * (pose[1, 1] - 1) * self._y_mm).astype(np.complex64)[:, None]
        real, imaginary = cv2.split(echoes.view(np.float32).reshape(*echoes.shape, 2))
        return self._spread(real), self._spread(imaginary)

    def _slices(self, tissue: Tissue, pose: Matrix4) -> Iterator[Complexes]:
        """The planes of the beam, each with its weight and its phase, by three-point Gauss-Hermite summation."""
        rest_mm = np.sqrt(self._beam.elevational_mm**2 - _PLANE_MM**2)
        for offset_mm, weight in ((-np.sqrt(3) * rest_mm, 1 / 6), (0.0, 2 / 3), (np.sqrt(3) * rest_mm, 1 / 6)):
            phase = np.exp(1j * self._beam.carrier_rad_per_mm * pose[1, 2] * offset_mm)
            echoes = self._sampled(tissue, pose, pose[:3, 3] + offset_mm * pose[:3, 2])
            yield echoes * np.complex64(weight * phase)

    def _sampled(self, tissue: Tissue, pose: Matrix4, origin_mm: NDArray[np.float64]) -> Complexes:
        """b(T v) on the grid of the renderer: bilinear in the stored planes, linear between two of them."""
        column, row, plane = (self._grid(pose[axis, :2], float(origin_mm[axis]), axis) for axis in range(3))
        below = np.floor(plane)
        row += below * np.float32(_POINTS[1] + _PAD)
        near = cv2.remap(tissue.atlas, column, row, cv2.INTER_LINEAR)
        row += np.float32(_POINTS[1] + _PAD)
        far = cv2.remap(tissue.atlas, column, row, cv2.INTER_LINEAR)
        plane -= below
        mixed: Complexes = cv2.blendLinear(near, far, 1 - plane, plane).view(np.complex64)[..., 0]
        return mixed

    def _grid(self, direction: NDArray[np.float64], origin_mm: float, axis: int) -> Floats:
        """Index along one tissue axis of every grid point, wrapped into 0 … points."""
        across = ((direction[0] * self._x_mm + origin_mm) / _STEP_MM[axis]).astype(np.float32)
        down = (direction[1] * self._y_mm / _STEP_MM[axis]).astype(np.float32)
        index: Floats = across[None, :] + down[:, None]
        index -= np.floor(index * np.float32(1 / _POINTS[axis])) * np.float32(_POINTS[axis])
        return index

    def _spread(self, part: Floats) -> Floats:
        """Convolution with the Gaussian g, and interpolation of the columns in between."""
        width, height = self._size_px
        kept = (slice(self._reach[1], self._reach[1] + height), slice(self._reach[0], -self._reach[0]))
        whole = np.empty((height, width), np.float32)
        for first, across in enumerate(self._across):
            columns = (width - first + 1) // 2
            whole[:, first::2] = cv2.sepFilter2D(part, -1, across, self._down)[kept][:, :columns]
        return whole


def _bell(place_px: NDArray[np.float64], sigma_px: float) -> Floats:
    """Gaussian taps that keep the variance of white noise."""
    taps = np.exp(-((place_px / sigma_px) ** 2) / 2)
    return (taps / np.sqrt(np.sum(taps**2))).astype(np.float32)
