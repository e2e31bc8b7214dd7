"""Real-time Tracker: direct registration of a picture against a keyframe.

Inverse-compositional Gauss–Newton (Hager and Belhumeur 1998, the paper's ref. 12) over translation u, in-plane rotation
α, gain and bias. The rotation acts in millimetres, W(x) = Λ⁻¹ R(α) Λ x + u, because pixels are not square. Everything
that depends on the keyframe alone is computed once per keyframe. Coordinates are px relative to the image centre.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.samples import GreyImage

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]

_LEVELS = 4
_POINTS = (20_000, 8_000, 4_000, 3_000)
_ITERATIONS = (8, 8, 10, 20)
_CONVERGED_PX = 0.01
_SAMPLES_PER_SPECKLE = 12.0
_TUKEY = 4.685


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """A from the picture. u_px: (2,), alpha_rad, covariance (3, 3) of (u_x px, u_y px, α rad).

    correlation: of keyframe and warped picture over the points in view, −1 … 1. overlap: share of points in view.
    """

    u_px: Array
    alpha_rad: float
    gain: float
    bias: float
    covariance: Array
    correlation: float
    overlap: float
    converged: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """Points of one pyramid level. xy: (n, 2) px of the full picture, centred. design: (n, 5) ∂I/∂(u, α), I, 1."""

    factor: float
    xy: Array32
    intensity: Array32
    design: Array32


Pyramid = tuple[Array32, ...]


def pyramid(image: GreyImage) -> Pyramid:
    """(h, w) uint8 → levels of float32, each half the size of the one before; row i is row 2i of the finer level."""
    levels = [np.asarray(image, dtype=np.float32)]
    while len(levels) < _LEVELS and min(levels[-1].shape) >= 32:
        levels.append(np.asarray(cv2.pyrDown(levels[-1]), dtype=np.float32))
    return tuple(levels)


def centre_px(width: int, height: int) -> Array:
    """(2,) column and row of the image centre."""
    return np.array([(width - 1) / 2, (height - 1) / 2])


def warp_matrix(alpha_rad: float, aspect: float) -> Array:
    """(2, 2) Λ⁻¹ R(α) Λ; aspect = λ_axial ÷ λ_lateral."""
    c, s = np.cos(alpha_rad), np.sin(alpha_rad)
    return np.array([[c, -s * aspect], [s / aspect, c]])


def compose(first: tuple[Array, float], then: tuple[Array, float], aspect: float) -> tuple[Array, float]:
    """(u, α) of `then` after `first`, in px and rad."""
    return warp_matrix(then[1], aspect) @ first[0] + then[0], first[1] + then[1]


class Keyframe:
    """The picture others are registered to, with its gradients and normal equations.

    mask: (h, w) bool, True where tissue may be seen; None for everywhere.
    """

    def __init__(self, levels: Pyramid, aspect: float, mask: NDArray[np.bool_] | None = None) -> None:
        self.aspect = aspect
        height, width = levels[0].shape
        self.centre = centre_px(width, height)
        self._levels = [
            level
            for k, image in enumerate(levels)
            if (level := self._prepare(image, 2.0**k, _POINTS[k], mask)) is not None
        ]

    @property
    def textured(self) -> bool:
        """False where the picture holds too little structure to be registered at all."""
        return bool(self._levels) and self._levels[0].factor == 1.0

    def _prepare(self, image: Array32, factor: float, most: int, mask: NDArray[np.bool_] | None) -> _Level | None:
        gx = cv2.Sobel(image, cv2.CV_32F, 1, 0, scale=0.125 / factor)
        gy = cv2.Sobel(image, cv2.CV_32F, 0, 1, scale=0.125 / factor)
        strength = gx * gx + gy * gy
        strength[[0, -1], :] = 0
        strength[:, [0, -1]] = 0
        if mask is not None:
            strength *= _mask_at(mask, image.shape)
        chosen = _strongest(strength, most, floor=(0.5 / factor) ** 2)
        if chosen.size < 64:
            return None
        rows, columns = np.divmod(chosen, image.shape[1])
        xy = np.stack([columns * factor - self.centre[0], rows * factor - self.centre[1]], axis=1)
        grad = np.stack([gx.ravel()[chosen], gy.ravel()[chosen]], axis=1).astype(np.float64)
        turn = np.stack([-xy[:, 1] * self.aspect, xy[:, 0] / self.aspect], axis=1)
        intensity = image.ravel()[chosen]
        design = np.column_stack([grad, (grad * turn).sum(axis=1), intensity, np.ones(chosen.size)])
        return _Level(factor, xy.astype(np.float32), intensity, design.astype(np.float32))

    def register(
        self, levels: Pyramid, start: tuple[Array, float] = (np.zeros(2), 0.0), coarsest: int = _LEVELS
    ) -> Registration:
        """Register a picture of the same size, coarse to fine from `start`. Needs `textured`."""
        u, alpha = np.asarray(start[0], dtype=np.float64), float(start[1])
        fit = _Fit(u, alpha)
        usable = [level for level in self._levels if level.factor < 2**coarsest]
        for level in reversed(usable or self._levels[:1]):
            index = round(np.log2(level.factor))
            fit = self._descend(level, levels[index], fit, _ITERATIONS[index])
        return self._conclude(self._levels[0], levels[0], fit)

    def _descend(self, level: _Level, image: Array32, fit: "_Fit", iterations: int) -> "_Fit":
        for _ in range(iterations):
            warped, seen = self._sample(level, image, fit)
            if seen.sum() < 64:
                return _Fit(fit.u, fit.alpha)
            error = warped - level.intensity
            H, weighted, fitted = _robust_normal(level.design, error, seen, fit.photometric)
            step = np.asarray(np.linalg.solve(H + np.diag(H.diagonal() * 1e-9 + 1e-12), weighted), dtype=np.float64)
            alpha = fit.alpha - step[2]
            move = warp_matrix(alpha, self.aspect) @ step[:2]
            gain = 1.0 + step[3]
            fit = _Fit(fit.u - move / max(gain, 0.1), alpha, step[3:], H, fitted)
            if np.hypot(*step[:2]) + abs(step[2]) * self.centre[0] < _CONVERGED_PX * level.factor:
                fit.converged = True
                break
        return fit

    def _sample(self, level: _Level, image: Array32, fit: "_Fit") -> tuple[Array32, NDArray[np.bool_]]:
        M = warp_matrix(fit.alpha, self.aspect).astype(np.float32)
        where = level.xy @ M.T + (fit.u + self.centre).astype(np.float32)
        where *= np.float32(1 / level.factor)
        columns, rows = np.ascontiguousarray(where[:, :1]), np.ascontiguousarray(where[:, 1:])
        warped = cv2.remap(image, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        x, y = where[:, 0], where[:, 1]
        seen = (x >= 0) & (y >= 0) & (x <= image.shape[1] - 1) & (y <= image.shape[0] - 1)
        return np.asarray(warped[:, 0], dtype=np.float32), seen

    def _conclude(self, level: _Level, image: Array32, fit: "_Fit") -> Registration:
        warped, seen = self._sample(level, image, fit)
        correlation = _correlation(level.intensity[seen], warped[seen])
        H = fit.H if fit.H is not None else np.eye(5) * 1e-6
        variance = max(fit.sigma, 0.5) ** 2 * _SAMPLES_PER_SPECKLE
        covariance = np.asarray(np.linalg.pinv(H)[:3, :3] * variance, dtype=np.float64)
        gain, bias = float(1 + fit.photometric[0]), float(fit.photometric[1])
        return Registration(fit.u, fit.alpha, gain, bias, covariance, correlation, float(seen.mean()), fit.converged)


@dataclass(slots=True, eq=False)
class _Fit:
    """State of the descent: warp, (gain − 1, bias), normal matrix and residual scale in grey levels."""

    u: Array
    alpha: float
    photometric: Array = field(default_factory=lambda: np.zeros(2))
    H: Array | None = None
    sigma: float = 1.0
    converged: bool = False


def _robust_normal(
    design: Array32, error: Array32, seen: NDArray[np.bool_], photometric: Array
) -> tuple[Array, Array, float]:
    """Tukey-weighted normal matrix (5, 5), right side (5,) and residual scale; the scale comes from the median."""
    residual = error - design[:, 3:] @ photometric.astype(np.float32)
    sigma = max(1.4826 * float(np.median(np.abs(residual[seen][::7]))), 0.5)
    ratio = residual * np.float32(1 / (_TUKEY * sigma))
    weight = np.square(np.maximum(1 - ratio * ratio, 0)) * seen
    weighted = design * weight[:, None]
    H = (weighted.T @ design).astype(np.float64)
    return H, (weighted.T @ error).astype(np.float64), sigma


def _strongest(strength: Array32, most: int, floor: float) -> NDArray[np.intp]:
    """Flat indices of the pixels with the strongest gradient, at most `most`, all above `floor`."""
    flat = strength.ravel()
    candidates = np.flatnonzero(flat > floor)
    if candidates.size <= most:
        return candidates
    keep = np.argpartition(flat[candidates], candidates.size - most)[-most:]
    return np.sort(candidates[keep])


def _mask_at(mask: NDArray[np.bool_], shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Mask at a coarser level; a coarse pixel counts only when all of its finer ones do."""
    if mask.shape == shape:
        return mask
    share = cv2.resize(mask.astype(np.float32), (shape[1], shape[0]), interpolation=cv2.INTER_AREA)
    return np.asarray(share > 0.99)


def _correlation(a: Array32, b: Array32) -> float:
    if a.size < 16:
        return 0.0
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.linalg.norm(a)) * float(np.linalg.norm(b))
    return float(a @ b) / scale if scale > 1e-6 else 0.0
