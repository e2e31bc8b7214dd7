"""Real-time Tracker: direct registration of a picture against a keyframe.

Inverse-compositional Gauss–Newton (Hager and Belhumeur 1998, the paper's ref. 12) over translation u, in-plane rotation
α, gain and bias. The rotation acts in millimetres, W(x) = Λ⁻¹ R(α) Λ x + u, because pixels are not square. Everything
that depends on the keyframe alone is computed once per keyframe. Coordinates are px relative to the image centre.

A few points of three sizes of the picture find the way, many of the finest measure. Where the gradient of the keyframe
is not all there any more, the speckle has changed: then the last steps look at the speckle alone.
"""

from dataclasses import dataclass
from functools import cached_property
from math import cos, sin

import cv2
import numpy as np

from appliance.core.registration.points import Fit, Picture, Template
from appliance.core.registration.pyramid import Bits, Pyramid
from appliance.core.registration.speckle import Speckle, coarse_speckle
from appliance.core.registration.template import template
from drivers.rigid import Array

_STEERING = {3: (1_500, 0.5), 1: (2_000, 0.2), 0: (3_000, 0.1)}
"""For each level that is used how many points steer, and the step in px after which the next level goes on."""
_STEPS = 15
"""Most steps on a level; a step shorter than `_STEERING` says ends it sooner. More costs time, only where it goes
astray. Not measured.
"""
_FINE, _DENSE = 30_000, 80_000
_FINE_ACCURATE, _DENSE_ACCURATE = 80_000, 160_000
"""Points that measure: of the finest level, and of its speckle where that has changed. Time grows with them, the error
falls until noise sets it: `make bench` shows both, of either mode.
"""
_UNCHANGED = 0.92
"""Share of the keyframe's gradient that is left, above which the speckle has not changed. More spends the many points
on pictures that need none; less leaves the error of changed speckle. Not measured by itself.
"""
_POLISHED_PX, _POLISHING_STEPS = 0.03, 5
"""A step below which the last descent ends, and most steps of it. The first is below the .05 px that tests ask of a
registration (tests/appliance/core/registration/test_registration.py); each step costs a pass over all points.
"""
_LEAST_MIDDLE = 6
"""Side, px, of what is looked for in the coarsest level: a smaller one is alike everywhere."""
_ASIDE_PX, _ASIDE_SHARE = 12.0, 0.02
"""How far beside the likeness is compared, the more of px and share of the width. Speckle is alike over a hundredth of
the picture (`texture`), so nearer a good place has no peak; further, a descent that went astray by less keeps one.
"""
_UNKNOWN = np.diag([1e6, 1e6, 10.0])
"""px², px², rad²: 1000 px and 3 rad are any place and any turn."""


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
        self._speckle = Speckle(mask)
        self._centre = (levels.shape[1] - 1) / 2, (levels.shape[0] - 1) / 2
        self._fine = self._template(0, _FINE_ACCURATE if accurate else _FINE)
        coarsest = levels.levels[-1]
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
        return template(self._levels.levels[index], factor, self._centre, self.aspect, most, self._mask)

    def register(self, levels: Pyramid, start: tuple[Array, float] | None = None) -> Registration:
        """Register a picture of the same size, coarse to fine from `start`, or from `guess`. Needs `textured`.

        Raises ValueError where the size is another.
        """
        if levels.shape != self._levels.shape:
            raise ValueError(f"a picture of {levels.shape} px, but a keyframe of {self._levels.shape}: take another")
        u, alpha = (self.guess(levels), 0.0) if start is None else start
        fit = Fit(u[0], u[1], alpha)
        for k, level in self._steering:
            level.descend(Picture(levels.levels[k]), fit, _STEPS, _STEERING[k][1])
        return self._polished(levels, fit)

    def guess(self, levels: Pyramid) -> Array:
        """(2,) px: where the middle of the keyframe is seen, found on the coarsest level by trying every place."""
        if min(self._middle.shape) < _LEAST_MIDDLE:
            return np.zeros(2)
        coarsest = levels.levels[-1]
        likeness = cv2.matchTemplate(coarse_speckle(coarsest), self._middle, cv2.TM_CCOEFF_NORMED)
        row, column = np.unravel_index(int(np.argmax(likeness)), likeness.shape)
        rows, columns = _inner(coarsest.shape)
        return np.array([column - columns.start, row - rows.start]) * levels.factor * 2.0**levels.coarsest

    def _polished(self, levels: Pyramid, fit: Fit) -> Registration:
        """One step with all points; where the speckle has changed, which tells less, several with more of them."""
        assert self._fine is not None
        finest, converged = Picture(levels.finest), bool(fit.converged)
        self._fine.descend(finest, fit, 1, responding=True)
        if fit.lost or fit.response[2] > _UNCHANGED or self._dense is None:
            return self._concluded(finest, fit, converged, fit)
        close = Fit(fit.u_x, fit.u_y, fit.alpha, fit.gain * fit.response[2])
        speckle = Picture(self._speckle.of(levels))
        self._dense.descend(speckle, close, _POLISHING_STEPS, _POLISHED_PX, responding=True)
        fit.u_x, fit.u_y, fit.alpha = close.u_x, close.u_y, close.alpha
        return self._concluded(finest, fit, converged, close)

    def _concluded(self, finest: Picture, fit: Fit, converged: bool, last: Fit) -> Registration:
        """last: the descent that ended it."""
        assert self._fine is not None
        u_px, covariance = np.array([fit.u_x, fit.u_y]), last.covariance()
        if covariance is None:
            return Registration(u_px, fit.alpha, 1.0, 0.0, _UNKNOWN, 0.0, 0.0, False)
        reach_px = max(_ASIDE_PX, _ASIDE_SHARE * finest.shape[1])
        (correlation, *aside), overlap = self._fine.correlate(finest, fit, reach_px)
        peak = correlation - max(aside)
        return Registration(u_px, fit.alpha, fit.gain, fit.bias, covariance, correlation, overlap, converged, peak)


def _inner(shape: tuple[int, ...]) -> tuple[slice, slice]:
    """The middle half of a picture in each direction."""
    rows, columns = shape[0] // 4, shape[1] // 4
    return np.s_[rows : shape[0] - rows, columns : shape[1] - columns]
