"""Real-time Tracker: direct registration of a picture against a keyframe.

Inverse-compositional Gauss–Newton (Hager and Belhumeur 1998, the paper's ref. 12) over translation u, in-plane rotation
α, gain and bias. The rotation acts in millimetres, W(x) = Λ⁻¹ R(α) Λ x + u, because pixels are not square. Everything
that depends on the keyframe alone is computed once per keyframe. Coordinates are px relative to the image centre.

A few points of three sizes of the picture find the way, many of the finest measure. Where the gradient of the keyframe
is not all there any more, the speckle has changed: then the last steps look at the speckle alone.
"""

from dataclasses import dataclass
from functools import cached_property
from math import cos, hypot, inf, sin

import cv2
import numpy as np

from appliance.core.fit import Fit, inside, interpolated, looked_up
from appliance.core.geometry import Array
from appliance.core.pyramid import Array32, Bits, Picture, Pyramid, centre_px
from appliance.core.speckle import Speckle, coarse_speckle
from appliance.core.template import Template, template

_STEERING = {3: (1_500, 0.5), 1: (2_000, 0.2), 0: (3_000, 0.1)}
"""For each level that is used how many points steer, and the step in px after which the next level goes on."""
_STEPS = 15
_FINE, _DENSE = 20_000, 28_000
_FINE_ACCURATE, _DENSE_ACCURATE = 80_000, 120_000
_UNCHANGED = 0.935
_POLISHED_PX, _POLISHING_STEPS = 0.05, 3
_MOST_GAIN = 5.0
_LEAST_MIDDLE = 6
_JUDGED = 1_000
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

    mask: (h, w) bool, True where tissue may be seen; None for everywhere. accurate: several times the points, for
    those who have the time.
    """

    def __init__(self, levels: Pyramid, aspect: float, mask: Bits | None = None, accurate: bool = False) -> None:
        self.aspect = aspect
        self._levels, self._mask, self._accurate = levels, mask, accurate
        self._speckle = Speckle(mask, levels.finest.shape)
        self._centre = centre_px(levels.shape[1], levels.shape[0])
        self._fine = self._template(0, _FINE_ACCURATE if accurate else _FINE)
        coarsest = levels.level(levels.coarsest)
        self._middle = coarse_speckle(coarsest)[_inner(coarsest.shape)]

    @property
    def textured(self) -> bool:
        """False where the picture holds too little structure to be registered at all."""
        return self._fine is not None

    @cached_property
    def _dense(self) -> Template | None:
        """Many points of the speckle, for pictures that have changed; worked out when the first one asks for it."""
        most = _DENSE_ACCURATE if self._accurate else _DENSE
        return template(
            self._speckle.of(self._levels), self._levels.factor, self._centre, self.aspect, most, self._mask
        )

    @cached_property
    def _steering(self) -> tuple[tuple[int, Template], ...]:
        """Level and its few points, coarse to fine."""
        found = [(k, self._template(k, _STEERING[k][0])) for k in (3, 1) if k <= self._levels.coarsest]
        found.append((0, None if self._fine is None else self._fine.thinned(_STEERING[0][0])))
        return tuple((k, level) for k, level in found if level is not None)

    def _template(self, index: int, most: int) -> Template | None:
        factor = self._levels.factor * 2.0**index
        return template(self._levels.level(index), factor, self._centre, self.aspect, most, self._mask)

    def register(self, levels: Pyramid, start: tuple[Array, float] | None = None) -> Registration:
        """Register a picture of the same size, coarse to fine from `start`, or from `guess`. Needs `textured`."""
        u, alpha = (self.guess(levels), 0.0) if start is None else start
        fit = Fit((float(u[0]), float(u[1])), float(alpha))
        for k, level in self._steering:
            fit = self._descend(level, levels.level(k), fit, _STEERING[k][1])
        assert self._fine is not None
        return self._polished(self._fine, levels, fit)

    def guess(self, levels: Pyramid) -> Array:
        """(2,) px: where the middle of the keyframe is seen, found on the coarsest level by trying every place."""
        if min(self._middle.shape) < _LEAST_MIDDLE:
            return np.zeros(2)
        coarsest = levels.level(levels.coarsest)
        likeness = cv2.matchTemplate(coarse_speckle(coarsest), self._middle, cv2.TM_CCOEFF_NORMED)
        row, column = np.unravel_index(int(np.argmax(likeness)), likeness.shape)
        rows, columns = _inner(coarsest.shape)
        return np.array([column - columns.start, row - rows.start]) * levels.factor * 2.0**levels.coarsest

    def _descend(self, level: Template, image: Picture, start: Fit, enough_px: float) -> Fit:
        fit = Fit(start.u, start.alpha, start.gain, start.bias)
        for _ in range(_STEPS):
            fit.converged = self._improve(level, image, fit) < enough_px
            if fit.converged or fit.lost:
                break
        return fit

    def _polished(self, level: Template, levels: Pyramid, fit: Fit) -> Registration:
        """One step with all points; where the speckle has changed, which tells less, several with more of them."""
        self._improve(level, levels.finest, fit)
        if fit.lost:
            return _lost(fit)
        fit.respond(level, levels.finest)
        if fit.response[2] > _UNCHANGED or self._dense is None:
            return self._concluded(level, levels.finest, fit, fit.covariance(level))
        speckle = self._speckle.of(levels)
        close = Fit(fit.u, fit.alpha, fit.gain * fit.response[2])
        for _ in range(_POLISHING_STEPS):
            length_px = self._improve(self._dense, speckle, close)
            if close.lost:
                return _lost(close)
            close.respond(self._dense, speckle)
            if length_px < _POLISHED_PX:
                break
        fit.u, fit.alpha = close.u, close.alpha
        return self._concluded(level, levels.finest, fit, close.covariance(self._dense))

    def _improve(self, level: Template, image: Picture, fit: Fit) -> float:
        """Look, weigh, and go one step of so many px."""
        self._look(level, image, fit)
        fit.lost = not fit.weigh()
        if fit.lost:
            return inf
        x, y, turn, gain, bias = fit.step(level)
        fit.gain = min(max(fit.gain + gain, 1 / _MOST_GAIN), _MOST_GAIN)
        fit.bias += bias
        fit.alpha -= turn
        c, s = cos(fit.alpha), sin(fit.alpha)
        fit.u = fit.u[0] - c * x + s * self.aspect * y, fit.u[1] - s / self.aspect * x - c * y
        return hypot(x, y) + abs(turn) * float(self._centre[0])

    def _look(self, level: Template, image: Picture, fit: Fit) -> None:
        """Where the points are seen in the level, and what gain and bias leave unexplained."""
        fit.where = self._warp(level.factor, fit) @ level.places
        fit.seen = inside(fit.where, image)
        expected = level.grey * np.float32(fit.gain)
        expected += np.float32(fit.bias)
        fit.residual = np.subtract(looked_up(image, fit.where), expected, out=expected)

    def _warp(self, factor: float, fit: Fit) -> Array32:
        """(2, 3) places of a template → columns and rows of a level."""
        c, s = cos(fit.alpha) / factor, sin(fit.alpha) / factor
        x, y = ((u + middle + 0.5) / factor - 0.5 for u, middle in zip(fit.u, self._centre.tolist(), strict=True))
        return np.array([[c, -s * self.aspect, x], [s / self.aspect, c, y]], np.float32)

    def _concluded(self, level: Template, image: Picture, fit: Fit, covariance: Array) -> Registration:
        thin = np.s_[:: max(level.grey.size // _JUDGED, 1)]
        where = self._warp(level.factor, fit) @ level.places[:, thin]
        seen = inside(where, image)
        correlation = _correlations(level.grey[thin], _looks(image, where), seen)
        return Registration(
            np.array(fit.u),
            fit.alpha,
            fit.gain,
            fit.bias,
            covariance,
            float(correlation[0]),
            float(np.count_nonzero(seen)) / seen.size,
            fit.converged,
            float(correlation[0] - correlation[1:].max()),
        )


def _lost(fit: Fit) -> Registration:
    return Registration(np.array(fit.u), fit.alpha, 1.0, 0.0, _UNKNOWN, 0.0, 0.0, False)


def _inner(shape: tuple[int, ...]) -> tuple[slice, slice]:
    """The middle half of a picture in each direction."""
    rows, columns = shape[0] // 4, shape[1] // 4
    return np.s_[rows : shape[0] - rows, columns : shape[1] - columns]


def _looks(image: Picture, where: Array32) -> Array32:
    """(5, n) the picture at (2, n) places, and a little to the right, left, below and above them."""
    reach = max(_ASIDE_PX, _ASIDE_SHARE * image.shape[1])
    aside = np.array([[0, reach, -reach, 0, 0], [0, 0, 0, reach, -reach]], np.float32)
    return interpolated(image, where[:, None] + aside[..., None])


def _correlations(grey: Array32, looks: Array32, seen: Bits) -> Array32:
    """(k,) correlation of (n,) values with each of (k, n) over the points that are seen; 0 where one is constant."""
    share = seen.astype(np.float32) / max(int(np.count_nonzero(seen)), 1)
    apart = grey - share @ grey
    mean = looks @ share
    looks = np.subtract(looks, mean[:, None], dtype=np.float32)
    scale = np.sqrt(np.square(looks) @ share * float(np.square(apart) @ share))
    return np.asarray((looks @ (apart * share)) / np.maximum(scale, 1e-3), dtype=np.float32)
