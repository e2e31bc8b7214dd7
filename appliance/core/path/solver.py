"""AX=XB solver: the calibration that explains the path of the picture by the path of the sensor.

Measured is the path of the image centre through the tissue, integrated along the keyframe chain: with p_j = R(α_j) p_0
+ Λ u_j the centre of picture j lies at −R(−α_j) Λ u_j in the axes of the chain's first picture. Predicted is the same
path from A = X B X⁻¹ (Eq. 1), step by step: t_a = R_x t_b + t_x − R_a t_x, turned back by the measured α. Their
difference is noise of several parts; learning their sizes from it and regressing the noisy side on the clean one gives
maximum-likelihood estimates without the bias of the norm constraint (docs/method.md, section 7).
"""

from dataclasses import dataclass, replace
from math import isnan, nan

import numpy as np
from numpy.typing import NDArray

from appliance.core.path.noise import AXIAL, LATERAL, PARTS, POSITIONS, TURN, WHITE, LearnedNoise, Noise
from appliance.core.path.residual import ROTATION, SCALE, TAU, VALUE, PathResidual
from appliance.core.path.samples import PathSamples
from appliance.types import Calibration
from drivers.rigid import Array, rotation_from_vector

_ROUNDS, _ROUNDS_ON = 12, 3
"""Of estimate and noise by turns: from nothing, and from the noise of a window that shares most of the motion."""
_ITERATIONS = 4
"""Most Gauss–Newton steps of the last round; near the reference a step of less than 1e-6 mostly ends it sooner."""
_HUBER = 2.0
"""Standard deviations from which an innovation counts less. More lets outliers draw X, less wastes good pictures; heavy
tails break the promised false alarms without it (mathematics, section 5; tests/appliance/core/path/test_solver.py).
"""
_HUBER_SHARE = 0.954
"""What the weights leave of the mean square of unit normal innovations: the probability of one within `_HUBER`."""
_RISES = 2.0
"""How far the information on an offset must exceed what noise pretends before that is taken off: nearer to it, the
difference of the two is noise itself. Not measured.
"""
_USEFUL_SD = np.array([np.deg2rad(2.0)] * 3 + [0.03] * 2 + [4.0] * 3)
"""rad, relative, mm: sigma from which on a parameter says nothing to a check, about the limits' own size. More reports
numbers that mean nothing; less calls a parameter unobserved that could still show a gross fault.
"""
_FIRST_MM, _FIRST_RAD = 0.3, np.deg2rad(0.3)
"""Noise of a block with which the first estimate weighs the rows; the noise is learned from what that leaves."""
_FOLLOWED = 30.0
"""Information on a scale ÷ what the tissue's own motion pretends of it, below which the scale is not observed. With
breathing it is 2 to 7, without 40 and more (seed 1 of every session of `probewatch study`).
"""


@dataclass(frozen=True, slots=True)
class Prior:
    """Standard deviations of what is believed before any motion is seen, about the reference calibration.

    Wide: they only keep unobserved parameters finite. tilt_rad is that of the rotations about lateral and axial,
    rotation_rad about elevational. planar: the motion is known to be planar, so elevational path and
    tilt are zero up to tracker noise (Eq. 5–6); otherwise the freehand two-row form is used.
    """

    tilt_rad: float = 0.35
    rotation_rad: float = 0.35
    scale: float = 0.3
    offset_mm: float = 100.0
    latency_s: float = 0.03
    planar: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """calibration: estimate with covariance and observed flags. change: (9,) estimate minus reference, PARAMETERS then
    latency s.

    covariance: (9, 9). correlation: of measured and predicted in-plane motion without the tissue's own, the worse of
    the two axes that moved; NaN where none did. motions: pictures used. noise: as learned. misfit: −2 log
    likelihood per picture. travel_mm: (2,) way that the probe covered laterally and axially, but for its widest 5 %.

    shown_ns: (9,) for each of θ the stamp on either side of which half of the information on it lies. An estimate that
    mixes motion from before and after a change of twice its limit stays within the limit only while less than half of
    it is from after: so this is the newest time at which an estimate within its limit is known to have held, and motion
    that says little, or nothing at all, makes it no younger.
    """

    calibration: Calibration
    change: Array
    covariance: Array
    correlation: float
    motions: int
    shown_ns: NDArray[np.int64]
    noise: Noise
    misfit: float
    travel_mm: Array


def solve(
    samples: PathSamples,
    reference: Calibration,
    prior: Prior = Prior(),
    start: Noise | None = None,
    *,
    learn: bool = True,
) -> Solution:
    """Maximum-likelihood X near the reference. Needs at least 8 samples in one chain; raises ValueError below that.

    start: noise of a window that shares most of its motion with this one, which is then learned sooner. learn: False
    where the noise is known to be `start`.
    """
    return _Problem(samples, reference, prior, start, learn).solved()


def changed(reference: Calibration, change: Array) -> Calibration:
    """The reference with a change of its parameters, in the order and units of PARAMETERS (rad, relative, mm)."""
    return replace(
        reference,
        rotation=rotation_from_vector(change[:3]) @ reference.rotation,
        scale_mm_per_px=reference.scale_mm_per_px * (1 + change[3:5]),
        offset_mm=reference.offset_mm + change[5:8],
    )


class PathFit:
    """How well references explain samples by themselves, where noise has the given parts and, for the misfit, any size.

    reference: that whose way out of the plane counts; those that are weighed differ from it in polarity alone.
    """

    def __init__(self, samples: PathSamples, reference: Calibration, noise: Noise) -> None:
        self._samples, self._known = samples, dict[tuple[int, int], PathResidual]()
        residual = self._residual(reference)
        self._noise = LearnedNoise(residual.blocks, residual.elevation_mm, noise)

    def misfit(self, reference: Calibration) -> float:
        """−2 log likelihood per picture."""
        path = self._residual(reference).linear(np.zeros(9))[:, VALUE]
        cost = 0.0
        for row, one in zip(self._noise.rows, path, strict=True):
            cost += len(one) * np.log(_huber_cost(row.white(one)) / len(one)) + row.log_volume
        return cost / int(np.count_nonzero(self._samples.kept))

    def agreement(self, reference: Calibration) -> float:
        """As `Solution.correlation`, under the reference itself."""
        return _agreement(self._residual(reference), self._noise, np.zeros(9))

    def _residual(self, reference: Calibration) -> PathResidual:
        if reference.polarity not in self._known:
            self._known[reference.polarity] = PathResidual(self._samples, reference, planar=False)
        return self._known[reference.polarity]


class _Problem:
    def __init__(
        self, samples: PathSamples, reference: Calibration, prior: Prior, start: Noise | None, learn: bool
    ) -> None:
        self._reference, self._prior, self._samples = reference, prior, samples
        residual = self.residual = PathResidual(samples, reference, prior.planar)
        residual.linearise_latency(np.zeros(9))
        self._at_reference = residual.linear(np.zeros(9))
        self._known = np.diag(1 / self._prior_sd() ** 2)
        self._rounds = 0 if not learn else _ROUNDS_ON if start else _ROUNDS
        self._first, left = self._first_estimate()
        self._noise = LearnedNoise(residual.blocks, residual.elevation_mm, start or self._first_noise(left))

    def _first_estimate(self) -> tuple[Array, Array]:
        """θ by least squares, and (rows, m) what it leaves, each chain with an offset of its own."""
        linear = self.residual.blocks.without_offsets(self._at_reference)
        size = np.where(np.isin(np.arange(len(linear)), POSITIONS), _FIRST_MM, _FIRST_RAD)
        J, r = linear[:, :VALUE] / size[:, None, None], linear[:, VALUE] / size[:, None]
        H = np.einsum("kim,kjm->ij", J, J) + self._known
        theta = -np.linalg.solve(H, np.einsum("kim,km->i", J, r))
        return theta, linear[:, VALUE] + np.einsum("i,kim->km", theta, linear[:, :VALUE])

    def _first_noise(self, left: Array) -> Noise:
        """Each part as large as all that the first estimate leaves."""
        span_s = max(float(np.ptp(self.residual.blocks.t_s)), 1.0)
        way_mm = max(float(np.ptp(self.residual.elevation_mm)), 1.0)
        per = np.array([1.0, 1 / span_s, 1 / way_mm, 1 / way_mm**2, 1.0, 1.0])
        return Noise(np.outer(np.mean(np.square(left), axis=1), per) / PARTS)

    def solved(self) -> Solution:
        """Noise and estimate by turns."""
        theta = self._first
        for _ in range(self._rounds):
            theta, _, J = self._minimised(theta, 1)
            linear = self.residual.linear(theta)
            clean = [
                row.coloured(np.clip(row.white(one), -_HUBER, _HUBER))
                for row, one in zip(self._noise.rows, linear[:, VALUE], strict=True)
            ]
            self._noise.learn(np.array(clean), linear[:, :VALUE], np.asarray(np.linalg.inv(J @ J.T + self._known)))
        return self._concluded(*self._minimised(theta, _ITERATIONS))

    def _whitened(self, linear: Array) -> Array:
        """(rows, 10, m) → (10, rows · m) innovations."""
        rows = [row.white(one) for row, one in zip(self._noise.rows, linear, strict=True)]
        return np.concatenate(rows, axis=1)

    def _minimised(self, theta: Array, iterations: int) -> tuple[Array, Array, Array]:
        """Gauss–Newton with Huber weights on the innovations: θ, its covariance, and J (9, rows · m)."""
        J = self._whitened(self._at_reference)[:VALUE]
        covariance, excess = self._honest_covariance(J)
        known = self._known - np.diag(excess)
        drawn = excess * np.concatenate([np.zeros(3), np.ones(2), self._reference.offset_mm, [0.0]])
        for _ in range(iterations):
            linear = self._whitened(self.residual.linear(theta))
            r = linear[VALUE]
            weight = 1 / np.maximum(np.abs(r) / _HUBER, 1)
            sums = (linear * weight) @ linear.T
            slope = sums[:VALUE, VALUE] + known @ theta - drawn
            step = np.linalg.solve(sums[:VALUE, :VALUE] + known, slope)
            theta = theta - step
            if np.all(np.abs(step) < 1e-6):
                break
        spread = float(sums[VALUE, VALUE]) / max(r.size - 9, 1) / _HUBER_SHARE
        return theta, covariance * max(1.0, spread), J

    def _honest_covariance(self, J: Array) -> tuple[Array, Array]:
        """I_c⁻¹ I I_c⁻¹ at the reference, where I_c is the information I less what tracker noise in it pretends; and
        the excess (3,) of the offsets, zero where the motion does not rise well above it.

        Noise of the poses is in the derivatives as in the path. Without this, motion that has no elevational part
        would seem to show the rotations about lateral and axial; and at the solution the fit has already bent towards
        the noise, so the reference is where information is counted.

        A turn error δ of one pose moves the residual by δ × t_x and its derivative by t_x with it: the offset would
        shrink by the ratio of excess to information, so `_minimised` takes the excess off (errors in variables).
        """
        known = self._known
        information = J @ J.T + known
        counted = np.array([row.counted for row in self._noise.rows])
        variances = self._noise.noise.variances[:, WHITE]
        position = float(np.mean(variances[[LATERAL, AXIAL]]))
        lateral, axial = counted[[LATERAL, AXIAL]]
        turn = counted[TURN] * variances[TURN]
        rotations = position * np.array([axial, lateral, lateral + axial]) + turn * np.array([1.0, 1.0, 0.0])
        offsets = variances[TURN] * np.array([axial, lateral, lateral + axial])
        scales = np.array([self._noise.rows[LATERAL].pretended, self._noise.rows[AXIAL].pretended])
        pretended = np.concatenate([rotations, scales, offsets, [0.0]])
        values, axes = np.linalg.eigh(information - known - np.diag(pretended))
        told = (axes * np.maximum(values, 0.0)) @ axes.T
        corrected = np.linalg.inv(told + known)
        alone = 1 / np.diag(np.linalg.inv(information)) - np.diag(known)
        excess = np.where(alone > _RISES * pretended, pretended, 0.0)
        excess[ROTATION] = 0.0
        self._followed = alone[SCALE] >= _FOLLOWED * scales
        return corrected @ information @ corrected, excess

    def _prior_sd(self) -> Array:
        p = self._prior
        return np.array([p.tilt_rad] * 2 + [p.rotation_rad] + [p.scale] * 2 + [p.offset_mm] * 3 + [p.latency_s])

    def _shown_ns(self, influence: Array) -> NDArray[np.int64]:
        """influence: (9, rows · m) of each innovation on θ; its squares add up to the variance of θ."""
        t_s = self.residual.blocks.t_s
        shares = np.square(influence).reshape(9, -1, t_s.size).sum(axis=1).cumsum(axis=1)
        half = [min(int(np.searchsorted(share, share[-1] / 2)), t_s.size - 1) for share in shares]
        return np.array([self._samples.stamp_ns(float(t_s[k])) for k in half], dtype=np.int64)

    def _concluded(self, theta: Array, covariance: Array, J: Array) -> Solution:
        reference, volume = self._reference, sum(row.log_volume for row in self._noise.rows)
        observed = self._observed(covariance)
        estimate = replace(changed(reference, theta), covariance=covariance[:8, :8], observed=observed)
        return Solution(
            estimate,
            theta,
            covariance,
            _agreement(self.residual, self._noise, theta),
            len(self.residual),
            self._shown_ns(covariance @ J),
            self._noise.noise,
            (_huber_cost(self._whitened(self.residual.linear(theta))[VALUE]) + volume) / len(self.residual),
            self._travel_mm(),
        )

    def _travel_mm(self) -> Array:
        predicted = self.residual.seen(np.zeros(9)) - self._at_reference[[LATERAL, AXIAL], VALUE]
        places = self.residual.blocks.without_offsets(predicted)
        return np.asarray(np.diff(np.quantile(places, [0.025, 0.975], axis=1), axis=0)[0])

    def _observed(self, covariance: Array) -> tuple[bool, ...]:
        """Where the motion, not the prior, tells: within half the prior's sd and what a check could still use."""
        enough = np.minimum(_USEFUL_SD, 0.5 * self._prior_sd()[:TAU])
        observed = np.sqrt(np.diag(covariance)[:TAU]) < enough
        observed[SCALE] &= self._followed
        return tuple(bool(flag) for flag in observed)


def _agreement(residual: PathResidual, noise: LearnedNoise, theta: Array) -> float:
    """Correlation of the measured with the predicted path, worse moving axis, once breathing and pulse are out."""
    path, seen = residual.linear(theta)[:, VALUE], residual.seen(theta)
    clean = (noise.without_tissue(k, path[k]) for k in (LATERAL, AXIAL))
    agreed = [residual.blocks.agreement(*both) for both in zip(seen, clean, strict=True)]
    return min((r for r in agreed if not isnan(r)), default=nan)


def _huber_cost(residual: Array) -> float:
    size = np.abs(residual)
    inner = np.minimum(size, _HUBER)
    return float(inner @ (2 * size - inner))
