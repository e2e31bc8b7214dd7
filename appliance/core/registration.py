"""Real-time Tracker: direct registration of a picture against a keyframe.

Inverse-compositional Gauss–Newton (Hager and Belhumeur 1998, the paper's ref. 12) over translation u, in-plane rotation
α, gain and bias. The rotation acts in millimetres, W(x) = Λ⁻¹ R(α) Λ x + u, because pixels are not square. Everything
that depends on the keyframe alone is computed once per keyframe. Coordinates are px relative to the image centre.
"""

from dataclasses import dataclass
from math import cos, hypot, sin

import cv2
import numpy as np

from appliance.core.fit import Fit, inside, looked_up
from appliance.core.template import Array, Array32, Bits, Pyramid, Template, centre_px, template
from drivers.samples import GreyImage

_FAST = {3: 2_000, 2: 3_000, 1: 5_000, 0: 16_000}
_ACCURATE = _FAST | {0: 80_000}
_ITERATIONS = {3: 20, 2: 12, 1: 10, 0: 10}
_CONVERGED_PX = {3: 0.5, 2: 0.25, 1: 0.12, 0: 0.03}
_LEAST_MIDDLE = 6
_MOST_GAIN = 5.0
_JUDGED = 2_000
_ASIDE_PX, _ASIDE_SHARE = 12.0, 0.02
_UNKNOWN = np.diag([1e6, 1e6, 10.0])


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """A from the picture. u_px: (2,), alpha_rad, covariance (3, 3) of (u_x px, u_y px, α rad).

    correlation: of keyframe and warped picture over the points in view, −1 … 1. peak: how far that exceeds the best
    correlation a little way off in four directions. overlap: share of points in view.
    """

    u_px: Array
    alpha_rad: float
    gain: float
    bias: float
    covariance: Array
    correlation: float
    overlap: float
    converged: bool
    peak: float = 0.0


def warp_matrix(alpha_rad: float, aspect: float) -> Array:
    """(2, 2) Λ⁻¹ R(α) Λ; aspect = λ_axial ÷ λ_lateral."""
    c, s = cos(alpha_rad), sin(alpha_rad)
    return np.array([[c, -s * aspect], [s / aspect, c]])


def compose(first: tuple[Array, float], then: tuple[Array, float], aspect: float) -> tuple[Array, float]:
    """(u, α) of `then` after `first`, in px and rad."""
    return warp_matrix(then[1], aspect) @ first[0] + then[0], first[1] + then[1]


class Keyframe:
    """The picture others are registered to, with its gradients and normal equations.

    mask: (h, w) bool, True where tissue may be seen; None for everywhere. accurate: five times the points, for those
    who have the time.
    """

    def __init__(self, levels: Pyramid, aspect: float, mask: Bits | None = None, accurate: bool = False) -> None:
        self.aspect = aspect
        height, width = levels[0].shape
        self.centre = centre_px(width, height)
        points = _ACCURATE if accurate else _FAST
        found = {
            k: template(image, 2.0**k, self.centre, aspect, points[k], mask)
            for k, image in enumerate(levels)
            if k in points
        }
        rows, columns = levels[-1].shape[0] // 4, levels[-1].shape[1] // 4
        self._middle = levels[-1][rows : levels[-1].shape[0] - rows, columns : levels[-1].shape[1] - columns]
        self._templates = {k: level for k, level in found.items() if level is not None}

    @property
    def textured(self) -> bool:
        """False where the picture holds too little structure to be registered at all."""
        return 0 in self._templates

    def register(self, levels: Pyramid, start: tuple[Array, float] | None = None) -> Registration:
        """Register a picture of the same size, coarse to fine from `start`, or from `guess`. Needs `textured`."""
        u, alpha = (self.guess(levels), 0.0) if start is None else start
        fit = Fit(np.asarray(u, dtype=np.float64), float(alpha))
        for k in sorted(self._templates, reverse=True):
            fit = self._descend(self._templates[k], levels[k], fit, k)
        return self._conclude(self._templates[0], levels[0], fit)

    def guess(self, levels: Pyramid) -> Array:
        """(2,) px: where the middle of the keyframe is seen, found on the coarsest level by trying every place."""
        if min(self._middle.shape) < _LEAST_MIDDLE:
            return np.zeros(2)
        likeness = cv2.matchTemplate(levels[-1], self._middle, cv2.TM_CCOEFF_NORMED)
        row, column = np.unravel_index(int(np.argmax(likeness)), likeness.shape)
        margin = (levels[-1].shape[1] - self._middle.shape[1]) // 2, (levels[-1].shape[0] - self._middle.shape[0]) // 2
        return np.array([column - margin[0], row - margin[1]]) * 2.0 ** (len(levels) - 1)

    def _descend(self, level: Template, image: GreyImage, start: Fit, index: int) -> Fit:
        fit = Fit(start.u, start.alpha, start.gain, start.bias)
        for _ in range(_ITERATIONS[index]):
            self._look(level, image, fit)
            if not fit.weigh(level, inside(fit.where, image)):
                fit.lost = True
                return fit
            step = fit.solver @ (fit.weighted @ fit.residual)
            self._move(fit, step)
            length = hypot(step[0], step[1]) + abs(step[2]) * self.centre[0]
            if length < _CONVERGED_PX[index]:
                fit.converged = True
                break
        return fit

    def _move(self, fit: Fit, step: Array) -> None:
        fit.gain = min(max(fit.gain + float(step[3]), 1 / _MOST_GAIN), _MOST_GAIN)
        fit.bias += float(step[4])
        fit.alpha -= float(step[2])
        fit.u = fit.u - warp_matrix(fit.alpha, self.aspect) @ step[:2] / fit.gain

    def _look(self, level: Template, image: GreyImage, fit: Fit) -> None:
        """Where the points are seen, columns and rows of the level (2, n), and what gain and bias leave unexplained."""
        M = np.empty((2, 3), np.float32)
        M[:, :2] = warp_matrix(fit.alpha, self.aspect) / level.factor
        M[:, 2] = (fit.u + self.centre) / level.factor
        fit.where = M @ level.places
        expected = level.grey * np.float32(fit.gain)
        expected += np.float32(fit.bias)
        fit.residual = np.subtract(looked_up(image, fit.where), expected, out=expected)

    def _conclude(self, level: Template, image: GreyImage, fit: Fit) -> Registration:
        if fit.lost:
            return Registration(fit.u, fit.alpha, 1.0, 0.0, _UNKNOWN, 0.0, 0.0, False)
        if not fit.converged:
            self._look(level, image, fit)
        thin = np.s_[:: max(level.grey.size // _JUDGED, 1)]
        where, grey = fit.where[:, thin], level.grey[thin]
        seen = inside(where, image)
        looks = _looks(image, where)
        gain, bias = _photometric(grey, looks[0], fit.weights[thin] * seen)
        correlation = _correlations(grey, looks, seen)
        return Registration(
            fit.u,
            fit.alpha,
            gain,
            bias,
            fit.covariance(level),
            float(correlation[0]),
            float(np.count_nonzero(seen)) / seen.size,
            fit.converged,
            float(correlation[0] - correlation[1:].max()),
        )


def _photometric(before: Array32, now: Array32, weights: Array32) -> tuple[float, float]:
    """Gain and bias of the grey values, now = gain · before + bias."""
    total = float(weights.sum())
    if total < 1:
        return 1.0, 0.0
    mean, mean_now = float(weights @ before) / total, float(weights @ now) / total
    apart = before - np.float32(mean)
    spread = float((weights * apart) @ apart)
    gain = float((weights * apart) @ (now - np.float32(mean_now))) / spread if spread > 0 else 1.0
    return gain, mean_now - gain * mean


def _looks(image: GreyImage, where: Array32) -> Array32:
    """(5, n) the picture at (2, n) places, and a little to the right, left, below and above them."""
    reach = max(_ASIDE_PX, _ASIDE_SHARE * image.shape[1])
    aside = np.array([[0, reach, -reach, 0, 0], [0, 0, 0, reach, -reach]], np.float32)
    x, y = where[:, None] + aside[..., None]
    return np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), dtype=np.float32)


def _correlations(grey: Array32, looks: Array32, seen: Bits) -> Array32:
    """(k,) correlation of (n,) values with each of (k, n) over the points that are seen; 0 where one is constant."""
    share = seen.astype(np.float32) / max(int(np.count_nonzero(seen)), 1)
    apart = grey - share @ grey
    mean = looks @ share
    looks = np.subtract(looks, mean[:, None], dtype=np.float32)
    scale = np.sqrt(np.square(looks) @ share * float(np.square(apart) @ share))
    return np.asarray((looks @ (apart * share)) / np.maximum(scale, 1e-3), dtype=np.float32)
