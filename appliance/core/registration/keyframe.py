"""Registers a picture directly against a keyframe: the paper's Real-time Tracker.

The method is inverse-compositional Gauss–Newton (Hager and Belhumeur 1998, the paper's ref. 12) over translation u,
in-plane rotation α, six terms by which tissue gives way beside that, gain and bias. The rotation acts in millimetres,
W(x) = Λ⁻¹ R(α) Λ x + u, because pixels are not square. Everything that depends on the keyframe alone is computed once
per keyframe. Coordinates are px relative to the image centre.

A few points at three sizes of the picture steer the descent, and many of the finest size measure. Where part of the
keyframe's gradient is no longer there, the speckle has changed: then the last steps use the speckle alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import cos, sin

import cv2
import numpy as np

from probewatch.appliance.core.registration.points import Fit, Picture, Template
from probewatch.appliance.core.registration.pyramid import Bits, Level, Pyramid
from probewatch.appliance.core.registration.speckle import Speckle, coarse_speckle
from probewatch.appliance.core.registration.template import template
from probewatch.appliance.types import DRAGS, PRESSES
from probewatch.drivers.rigid import Array

_STEERING = {3: (1_500, 0.5), 1: (2_000, 0.2), 0: (3_000, 0.1)}
"""For each level that is used, the points that steer, and the step, px, after which the next level goes on."""
_STEPS = 15
"""Most steps on a level; a step shorter than in `_STEERING` ends it sooner. More cost time, but only where the descent
goes astray. Not measured.
"""
_FINE, _DENSE = 24_000, 70_000
_FINE_ACCURATE, _DENSE_ACCURATE = 80_000, 160_000
"""Points that measure: those of the finest level, and those of its speckle where that has changed. Time grows with
their number; the error falls until noise determines it: `make bench` shows both, for either mode. """
_UNCHANGED = 0.92
"""Remaining share of the keyframe's gradient above which the speckle has not changed. A higher one spends the many
points on pictures that need none; a lower one leaves the error of changed speckle. Not measured by itself.
"""
_POLISHED_PX, _POLISHING_STEPS = 0.03, 5
"""px, step below which the last descent ends, and its most steps. The first is below the .05 px that tests ask of a
registration (tests/appliance/core/registration/test_registration.py); each step costs a pass over all points.
"""
_NEAR_PX, _NEARER_STEPS = 0.1, 2
"""px, step with all points below which no other is taken, and most others: in rigid tissue there is hardly ever one. A
smaller value takes more of them; a larger one stops short of the place in soft tissue, because the drag of the skin is
similar to a turn and a shift."""
_GIVE = np.array([0.02, 0.08, 0.05, 0.05, 0.02, 0.02])
"""Standard deviations of the terms during the descent, as shares of half the width (x along x or y) or height. Larger
ones follow quicker presses, and noise where few points are in view; smaller ones lag at the skin, where 1 mm may be 10
px a picture."""
_DRAG_MM, _DRAG_SHARE = 12.0, 0.25
"""Depth over which the drag of the skin falls to 1/e, 10 to 15 mm in tissue; and the share of the picture's height that
replaces it where millimetres are unknown: 12 mm of a picture of 48 mm."""
_LOOSE_LEVELS = 2
"""Number of finest levels on which tissue may give way during the descent. The coarsest alone goes astray in rigid
tissue that has turned, but finds quick presses, so tissue may give way on it where `register` is asked for that."""
_LEAST_MIDDLE = 6
"""px, least side of what is looked for in the coarsest level: a smaller one is alike everywhere."""
_ASIDE_PX, _ASIDE_SHARE = 12.0, 0.02
"""How far beside the place the likeness is compared: px or share of the width, whichever is more. Speckle is alike over
a hundredth of the picture (`texture`), so nearer than that even a good place has no peak; further away, a descent that
went astray by less keeps one. """
_UNKNOWN = np.diag([1e6, 1e6, 10.0])
"""px², px², rad², the covariance of an unknown motion: 1000 px and 3 rad are any place and any turn."""
_GIVEN_IN = np.array([2, 3, 5, 6, 7, 8])
"""Indices in the field at which tissue that gives way differs from rigid tissue."""
_DRAG = 1
"""Index of the term of the skin's drag."""
_HELD_PX = 1e-4
"""px, standard deviation of a term that is taken as zero."""


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """Holds what a picture shows of the motion of deep tissue, under one assumption of what the tissue may do.

    u_px: (2,), alpha_rad, covariance (3, 3) of (u_x px, u_y px, α rad). drag_px: lateral drag of the skin against that.
    """

    u_px: Array
    alpha_rad: float
    covariance: Array
    drag_px: float


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """Holds A as determined from the picture. u_px: (2,), alpha_rad, covariance (3, 3) of (u_x px, u_y px, α rad).

    correlation: that of keyframe and warped picture over the points in view, −1 … 1. peak: how far it exceeds the best
    correlation a little way off in four directions. overlap: share of points in view.

    u and α are those of tissue that does not give way. readings: one for each of what tissue may do, `DRAGS` and
    `PRESSES`, of which the first repeats u and α; none where nothing can be concluded. field: (9,) px, displacement of
    all tissue: a₀ + a₁ y + a₂ x + a₃ φ(y) along x and b₀ + b₁ x + b₂ y + b₃ y² + b₄ x y along y; x and y are −1 … 1
    over the picture, φ is the share of the skin's drag at that depth. tilt_rad: turn by ∂u_y/∂x, which tissue that
    follows the face shows in part.
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
    field: Array = field(default_factory=lambda: np.zeros(9))
    readings: tuple[Reading, ...] = ()
    tilt_rad: float = 0.0


def warp_matrix(alpha_rad: float, aspect: float) -> Array:
    """Returns Λ⁻¹ R(α) Λ, (2, 2). aspect: λ_axial ÷ λ_lateral."""
    c, s = cos(alpha_rad), sin(alpha_rad)
    return np.array([[c, -s * aspect], [s / aspect, c]])


def compose(first: tuple[Array, float], then: tuple[Array, float], aspect: float) -> tuple[Array, float]:
    """Returns (u, α) of `then` after `first`, px and rad (equation 10). aspect: as in `warp_matrix`."""
    return warp_matrix(then[1], aspect) @ first[0] + then[0], first[1] + then[1]


class Keyframe:
    """Holds the picture to which others are registered, with its gradients and normal equations.

    mask: (h, w) bool, True where tissue may be seen; None for everywhere. accurate: whether to use several times the
    points, for callers that have the time. axial_mm_per_px: that of the picture as it came, None where it is unknown.
    """

    def __init__(
        self,
        levels: Pyramid,
        aspect: float,
        mask: Bits | None = None,
        accurate: bool = False,
        axial_mm_per_px: float | None = None,
    ) -> None:
        self.aspect = aspect
        self._levels, self._mask, self._accurate = levels, mask, accurate
        self._speckle = Speckle(mask)
        self._centre = (levels.shape[1] - 1) / 2, (levels.shape[0] - 1) / 2
        half_px = np.maximum(self._centre, 1)
        self._free = np.square(_GIVE * half_px[[0, 1, 0, 1, 1, 1]])
        self._fading_px = _DRAG_MM / axial_mm_per_px if axial_mm_per_px else _DRAG_SHARE * levels.shape[0]
        self._fine = self._template(0, _FINE_ACCURATE if accurate else _FINE)
        coarsest = levels.levels[-1]
        self._middle = coarse_speckle(coarsest)[_inner(coarsest.shape)]

    @property
    def textured(self) -> bool:
        """Returns whether the picture holds enough structure to be registered."""
        return self._fine is not None

    @cached_property
    def _dense(self) -> Template | None:
        """Returns many points of the speckle, for pictures that have changed; computed when one is first needed."""
        most = _DENSE_ACCURATE if self._accurate else _DENSE
        return self._points(self._speckle.of(self._levels), self._levels.factor, most)

    @cached_property
    def _steering(self) -> tuple[tuple[int, Template], ...]:
        """Returns each level that steers with its few points, coarse to fine."""
        found = [(k, self._template(k, _STEERING[k][0])) for k in (3, 1) if k <= self._levels.coarsest]
        found.append((0, None if self._fine is None else self._fine.thinned(_STEERING[0][0])))
        return tuple((k, level) for k, level in found if level is not None)

    def _template(self, index: int, most: int) -> Template | None:
        return self._points(self._levels.levels[index], self._levels.factor * 2.0**index, most)

    def _points(self, level: Level, factor: float, most: int) -> Template | None:
        return template(level, factor, self._centre, self.aspect, self._fading_px, most, self._mask)

    def register(
        self,
        levels: Pyramid,
        start: tuple[Array, float] | Array | None = None,
        may: int = DRAGS | PRESSES,
        loose: bool = False,
    ) -> Registration:
        """Registers a picture of the same size, coarse to fine from `start`, or else from `guess`. Needs `textured`.

        start: (u px, α rad), or the field of another registration to this keyframe. may: what tissue may do during the
        descent, as bits; from its end, readings are taken for everything that tissue may do. loose: whether it may do
        everything during the descent, on the coarsest level as well. Raises ValueError where the size is another.
        """
        if levels.shape != self._levels.shape:
            raise ValueError(f"a picture of {levels.shape} px, but a keyframe of {self._levels.shape}: take another")
        fit = self._begun((self.guess(levels), 0.0) if start is None else start)
        return self._concluded(levels, self._descended(levels, fit, may, loose))

    def _supposed(self, may: int) -> Array:
        """Returns the variance of the terms, (6,) px², where tissue may do what the bits say, and nothing else."""
        drag = np.arange(self._free.size) == _DRAG
        return np.where(np.where(drag, may & DRAGS, may & PRESSES), self._free, _HELD_PX**2)

    def _begun(self, start: tuple[Array, float] | Array) -> Fit:
        if isinstance(start, tuple):
            return Fit(start[0][0], start[0][1], start[1])
        turn = -start[1] / self._centre[1] / self.aspect
        alpha_rad = float(np.arcsin(np.clip(turn, -1, 1)))
        give = (start - self._field((start[[0, 4]], alpha_rad), np.zeros(6)))[_GIVEN_IN]
        return Fit(start[0], start[4], alpha_rad, give=give)

    def _field(self, warp: tuple[Array, float], give: Array) -> Array:
        (u_x, u_y), (x, y) = warp[0], self._centre
        M = warp_matrix(warp[1], self.aspect)
        found = np.array([u_x, M[0, 1] * y, (M[0, 0] - 1) * x, 0, u_y, M[1, 0] * x, (M[1, 1] - 1) * y, 0, 0])
        found[_GIVEN_IN] += give
        return found

    def guess(self, levels: Pyramid) -> Array:
        """Returns the shift, (2,) px, of the keyframe's middle, found by trying every place on the coarsest level."""
        if min(self._middle.shape) < _LEAST_MIDDLE:
            return np.zeros(2)
        coarsest = levels.levels[-1]
        likeness = cv2.matchTemplate(coarse_speckle(coarsest), self._middle, cv2.TM_CCOEFF_NORMED)
        row, column = np.unravel_index(int(np.argmax(likeness)), likeness.shape)
        rows, columns = _inner(coarsest.shape)
        return np.array([column - columns.start, row - rows.start]) * levels.factor * 2.0**levels.coarsest

    def _descended(self, levels: Pyramid, fit: Fit, may: int, loose: bool) -> "_Descended":
        """Descends with a few points, then takes one step with all points.

        Where the speckle has changed, which shows less, several steps with more points follow.
        """
        assert self._fine is not None
        for left, (k, level) in zip(range(len(self._steering), 0, -1), self._steering, strict=True):
            fit.stiff[:] = 1 / self._supposed(DRAGS | PRESSES if loose else may if left <= _LOOSE_LEVELS else 0)
            level.descend(Picture(levels.levels[k]), fit, _STEPS, _STEERING[k][1])
        converged, last = bool(fit.converged), fit
        self._fine.descend(Picture(levels.finest), fit, 1, _NEAR_PX, responding=True)
        if not fit.converged and fit.response[2] > _UNCHANGED:
            self._fine.descend(Picture(levels.finest), fit, _NEARER_STEPS, _NEAR_PX, responding=True)
        if not fit.lost and fit.response[2] <= _UNCHANGED and self._dense is not None:
            gain = fit.gain * fit.response[2]
            last = Fit(fit.u_x, fit.u_y, fit.alpha, gain, give=fit.give, stiff=fit.stiff)
            speckle = Picture(self._speckle.of(levels))
            self._dense.descend(speckle, last, _POLISHING_STEPS, _POLISHED_PX, responding=True)
        return _Descended(fit, converged, last, self.aspect)

    def _concluded(self, levels: Pyramid, found: "_Descended") -> Registration:
        assert self._fine is not None
        readings = found.readings([self._supposed(may) for may in range(1 + (DRAGS | PRESSES))])
        fit = found.fit
        u_px = np.array([fit.u_x, fit.u_y])
        if not readings:
            return Registration(u_px, fit.alpha, 1.0, 0.0, _UNKNOWN, 0.0, 0.0, False)
        reach_px = max(_ASIDE_PX, _ASIDE_SHARE * levels.finest.shape[1])
        (correlation, *aside), overlap = self._fine.correlate(Picture(levels.finest), fit, reach_px)
        field_px = self._field((u_px, fit.alpha), np.array(fit.give))
        return Registration(
            readings[0].u_px,
            readings[0].alpha_rad,
            fit.gain,
            fit.bias,
            readings[0].covariance,
            correlation,
            overlap,
            found.converged,
            correlation - max(aside),
            field_px,
            readings,
            float(field_px[5] / max(self._centre[0], 1.0) * self.aspect),
        )


class _Descended:
    """Holds the end of a descent. fit: that with all points. last: that of the descent that came last."""

    def __init__(self, fit: Fit, converged: bool, last: Fit, aspect: float) -> None:
        self.fit, self.converged, self._last, self._aspect = fit, converged, last, aspect

    def readings(self, supposed: Sequence[Array]) -> tuple[Reading, ...]:
        """Returns the readings of the last look, one for each variance of the terms, (6,) px², or none.

        There are none where nothing can be concluded. The fit moves to where the last of them puts it.
        """
        fit, last = self.fit, self._last
        together = last.together()
        read = [self._reading(last.copied(), together, variance) for variance in supposed[:-1]]
        read.append(self._reading(last, together, supposed[-1]))
        fit.u_x, fit.u_y, fit.alpha, fit.give = last.u_x, last.u_y, last.alpha, last.give
        return tuple(reading for reading in read if reading) if all(read) else ()

    def _reading(self, fit: Fit, together: float, variance: Array) -> Reading | None:
        covariance = fit.drawn(self._aspect, together, variance)
        if covariance is None:
            return None
        return Reading(np.array([fit.u_x, fit.u_y]), fit.alpha, covariance, fit.give[_DRAG])


def _inner(shape: tuple[int, ...]) -> tuple[slice, slice]:
    """Returns the slices of the middle half of a picture in each direction."""
    rows, columns = shape[0] // 4, shape[1] // 4
    return np.s_[rows : shape[0] - rows, columns : shape[1] - columns]
