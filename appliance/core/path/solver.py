"""AX=XB solver: the calibration that explains the path of the picture by the path of the sensor.

Measured is the path of the image centre through the tissue, integrated along the keyframe chain: with p_j = R(α_j) p_0
+ Λ u_j the centre of picture j lies at −R(−α_j) Λ u_j in the axes of the chain's first picture. Predicted is the same
path from A = X B X⁻¹ (Eq. 1), step by step: t_a = R_x t_b + t_x − R_a t_x, turned back by the measured α. Their
difference is white tracker noise, a slow drift and one offset per chain; whitening by that model and regressing the
noisy side on the clean one gives maximum-likelihood estimates without the bias of the norm constraint (docs/method.md,
section 7).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from appliance.core.path.noise import Noise, Whitener, position_weight
from appliance.core.path.residual import OFFSET, TAU, VALUE, PathResidual, side_by_side
from appliance.core.path.samples import PathSamples
from appliance.types import Calibration
from drivers.rigid import Array, rotation_from_vector

_ITERATIONS = 6
"""Most Gauss–Newton steps of one round; near the reference a step of less than 1e-6 mostly ends it sooner."""
_NOISE_ROUNDS = 5
"""Most rounds of noise and solution; each costs a whitening. Where they do not settle, the likeliest counts."""
_HUBER = 2.0
"""Standard deviations from which an innovation counts less. More lets outliers draw X, less wastes good pictures; heavy
tails break the promised false alarms without it (mathematics, section 5; tests/appliance/core/path/test_solver.py).
"""
_LEAST_SPREAD = 0.7
"""The covariance shrinks to no less where innovations are smaller than the noise says: a few pictures fit by chance.
With it the stated sigmas cover the truth (tests/appliance/core/path/test_solver.py).
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

    covariance: (9, 9). correlation: of measured and
    predicted in-plane steps, the worse of the two axes that moved; NaN where none did. misfit: −2 log likelihood per
    picture. motions: pictures used.

    shown_ns: (9,) for each of θ the stamp on either side of which half of the information on it lies. An estimate that
    mixes motion from before and after a change of twice its limit stays within the limit only while less than half of
    it is from after: so this is the newest time at which an estimate within its limit is known to have held, and motion
    that says little, or nothing at all, makes it no younger.
    """

    calibration: Calibration
    change: Array
    covariance: Array
    correlation: float
    misfit: float
    motions: int
    shown_ns: NDArray[np.int64]


def solve(samples: PathSamples, reference: Calibration, prior: Prior = Prior()) -> Solution:
    """Maximum-likelihood X near the reference. Needs at least 8 samples in one chain; raises ValueError below that."""
    problem = _Problem(samples, reference, prior)
    theta, noise, rounds = np.zeros(9), problem.noise(np.zeros(9)), []
    for _ in range(_NOISE_ROUNDS):
        whiten = Whitener(samples.times, noise)
        theta, covariance, cost, shown_ns = problem.minimise(theta, whiten, noise)
        settled, noise = noise, problem.noise(theta)
        rounds.append((theta, covariance, cost + problem.residual.log_volume(whiten), noise, shown_ns))
        if noise.like(settled):
            break
    # A worse fit asks for more noise, and more noise lets it be worse still: the likeliest round counts.
    return problem.conclude(*min(rounds, key=lambda found: found[2]))


def path_misfit(samples: PathSamples, reference: Calibration) -> float:
    """−2 log likelihood per picture of the reference itself, only the noise estimated. ValueError as in solve."""
    residual = PathResidual(samples, reference, planar=False)
    steps = residual.steps(np.zeros(9))
    whiten = Whitener(samples.times, residual.noise(steps))
    cost = _huber_cost(side_by_side(residual.innovations(steps, whiten)))
    return (cost + residual.log_volume(whiten)) / len(residual)


def path_agreement(samples: PathSamples, reference: Calibration) -> float:
    """Correlation of measured and predicted in-plane motion under the reference itself, as Solution.correlation."""
    return PathResidual(samples, reference, planar=False).agreement(np.zeros(9))


class _Problem:
    def __init__(self, samples: PathSamples, reference: Calibration, prior: Prior) -> None:
        self.residual = PathResidual(samples, reference, prior.planar)
        self._reference = reference
        self._prior = prior
        self._samples = samples
        self._period_s = samples.times.period_s

    def noise(self, theta: Array) -> Noise:
        """Of the residual path."""
        return self.residual.noise(self.residual.steps(theta))

    def minimise(self, theta: Array, whiten: Whitener, noise: Noise) -> tuple[Array, Array, float, NDArray[np.int64]]:
        """Gauss–Newton with Huber weights on the innovations; covariance grows where they are wider than the model.

        Last: `Solution.shown_ns`.
        """
        self.residual.linearise_latency(theta)
        whitened = self.residual.whitened(whiten)
        prior = np.diag(1 / self._prior_sd() ** 2)
        J = self.residual.linear(np.zeros(9), whitened)[:VALUE]
        covariance, excess = self._honest_covariance(J, whitened[0].shape[1], noise, prior)
        known = prior.copy()
        known[OFFSET, OFFSET] -= np.diag(excess)
        drawn = np.zeros(9)
        drawn[OFFSET] = excess * self._reference.offset_mm
        for _ in range(_ITERATIONS):
            linear = self.residual.linear(theta, whitened)
            r = linear[VALUE]
            weight = 1 / np.maximum(np.abs(r) / _HUBER, 1)
            sums = (linear * weight) @ linear.T
            slope = sums[:VALUE, VALUE] + known @ theta - drawn
            step = np.linalg.solve(sums[:VALUE, :VALUE] + known, slope)
            theta = theta - step
            if np.all(np.abs(step) < 1e-6):
                break
        spread = float(sums[VALUE, VALUE]) / max(r.size - 9, 1) / _HUBER_SHARE
        return theta, covariance * max(_LEAST_SPREAD, spread), _huber_cost(r), self._shown_ns(covariance @ J)

    def _shown_ns(self, influence: Array) -> NDArray[np.int64]:
        """influence: (9, rows · steps) of each innovation on θ; its squares add up to the variance of θ."""
        later, *_ = self._samples.times.walk
        shares = np.square(influence).reshape(9, -1, later.size).sum(axis=1).cumsum(axis=1)
        half = [min(int(np.searchsorted(share, share[-1] / 2)), later.size - 1) for share in shares]
        t_s = self._samples.times.t_s[later[half]]
        return np.array([self._samples.stamp_ns(float(t)) for t in t_s], dtype=np.int64)

    def _honest_covariance(self, J: Array, steps: int, noise: Noise, prior: Array) -> tuple[Array, Array]:
        """I_c⁻¹ I I_c⁻¹ at the reference, where I_c is the information I less what tracker noise in it pretends; and
        the excess (3,) of the offsets, zero where the motion does not rise well above it.

        J: (9, m) of all rows, each of `steps` innovations.

        Each picture adds one such unit in each of the two rows that a rotation enters. Without this, motion that has no
        elevational part would seem to show the rotations about lateral and axial; and at the solution the fit has
        already bent towards the noise, so the reference is where information is counted.

        A turn error δ of one pose moves the residual by δ × t_x and its derivative by t_x with it: the offset would
        shrink by the ratio of excess to information, so `minimise` takes the excess off (errors in variables).
        """
        information = J @ J.T + prior
        entered = np.array([2.0, 2.0, 2.0] if self._prior.planar else [1.0, 1.0, 2.0])
        excess = entered * steps * noise.angle_rad**2 * position_weight(noise, self._period_s)
        pretended = np.concatenate([np.full(3, 2.0 * steps), np.zeros(2), excess, [0.0]])
        values, axes = np.linalg.eigh(information - prior - np.diag(pretended))
        told = (axes * np.maximum(values, 0.0)) @ axes.T
        corrected = np.linalg.inv(told + prior)
        alone = 1 / np.diag(np.linalg.inv(information))[5:8] - np.diag(prior)[5:8]
        return corrected @ information @ corrected, np.where(alone > _RISES * excess, excess, 0.0)

    def _prior_sd(self) -> Array:
        p = self._prior
        return np.array([p.tilt_rad] * 2 + [p.rotation_rad] + [p.scale] * 2 + [p.offset_mm] * 3 + [p.latency_s])

    def conclude(
        self, theta: Array, covariance: Array, cost: float, noise: Noise, shown_ns: NDArray[np.int64]
    ) -> Solution:
        reference = self._reference
        estimate = replace(
            reference,
            rotation=rotation_from_vector(theta[:3]) @ reference.rotation,
            scale_mm_per_px=reference.scale_mm_per_px * (1 + theta[3:5]),
            offset_mm=reference.offset_mm + theta[5:8],
            covariance=covariance[:8, :8],
            observed=self._observed(covariance),
        )
        return Solution(
            estimate,
            theta,
            covariance,
            self.residual.agreement(theta),
            cost / len(self.residual),
            len(self.residual),
            shown_ns,
        )

    def _observed(self, covariance: Array) -> tuple[bool, ...]:
        """Where the motion, not the prior, tells: within half the prior's sd and what a check could still use."""
        enough = np.minimum(_USEFUL_SD, 0.5 * self._prior_sd()[:TAU])
        return tuple(bool(flag) for flag in np.sqrt(np.diag(covariance)[:TAU]) < enough)


def _huber_cost(residual: Array) -> float:
    size = np.abs(residual)
    inner = np.minimum(size, _HUBER)
    return float(inner @ (2 * size - inner))
