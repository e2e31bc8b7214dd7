"""AX=XB solver: the calibration that explains the path of the picture by the path of the sensor.

Measured is the path of the image centre through the tissue, integrated along the keyframe chain: with p_j = R(α_j) p_0
+ Λ u_j the centre of picture j lies at −R(−α_j) Λ u_j in the axes of the chain's first picture. Predicted is the same
path from A = X B X⁻¹ (Eq. 1), step by step: t_a = R_x t_b + t_x − R_a t_x, turned back by the measured α. Their
difference is white tracker noise, a slow drift and one offset per chain; whitening by that model and regressing the
noisy side on the clean one gives maximum-likelihood estimates without the bias of the norm constraint (mathematics,
section 3).
"""

from dataclasses import dataclass, replace

import numpy as np

from appliance.core.geometry import Array, rotation_from_vector
from appliance.core.path_noise import Noise, Whitener, position_weight
from appliance.core.path_samples import PathSamples
from appliance.core.picture_steps import picture_slopes, picture_steps, plane_rotation
from appliance.types import Calibration

_ITERATIONS = 6
_NOISE_ROUNDS = 5
_HUBER = 2.0
_LEAST_SPREAD = 0.7
_HUBER_SHARE = 0.954
"""What the weights leave of the mean square of unit normal innovations."""
_RISES = 2.0
TAU = 8
"""Index of the latency, s, behind the eight parameters of X."""


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

    covariance: (9, 9). position_noise_mm, angle_noise_rad: white tracker noise found. correlation: of measured and
    predicted in-plane steps, the worse of the two axes that moved; NaN where none did. misfit: −2 log likelihood per
    picture. motions: pictures used.
    """

    calibration: Calibration
    change: Array
    covariance: Array
    position_noise_mm: float
    angle_noise_rad: float
    correlation: float
    misfit: float
    motions: int


def solve(samples: PathSamples, reference: Calibration, prior: Prior = Prior()) -> Solution:
    """Maximum-likelihood X near the reference. Needs at least 8 samples in one chain; raises ValueError below that."""
    problem = _Problem(samples, reference, prior)
    theta, noise, rounds = np.zeros(9), problem.noise(np.zeros(9)), []
    for _ in range(_NOISE_ROUNDS):
        whiten = problem.whitener(noise)
        theta, covariance, cost = problem.minimise(theta, whiten, noise)
        settled, noise = noise, problem.noise(theta)
        rounds.append((theta, covariance, cost + whiten.log_volume, noise))
        if noise.like(settled):
            break
    # A worse fit asks for more noise, and more noise lets it be worse still: the likeliest round counts.
    return problem.conclude(*min(rounds, key=lambda found: found[2]))


def path_misfit(samples: PathSamples, reference: Calibration) -> float:
    """−2 log likelihood per picture of the reference itself, only the noise estimated. ValueError as in solve."""
    problem = _Problem(samples, reference, Prior())
    steps = problem.steps(np.zeros(9))
    whiten = problem.whitener(samples.times.estimated_noise(np.cumsum(steps, axis=0)))
    return (_huber_cost(whiten(steps)) + whiten.log_volume) / len(steps)


def path_agreement(samples: PathSamples, reference: Calibration) -> float:
    """Correlation of measured and predicted in-plane motion under the reference itself, as Solution.correlation."""
    return _Problem(samples, reference, Prior()).agreement(np.zeros(9))


class _Problem:
    def __init__(self, samples: PathSamples, reference: Calibration, prior: Prior) -> None:
        kept = samples.kept
        self._samples = samples
        self._reference = reference
        self._prior = prior
        self._times = samples.times
        polarity = np.array(reference.polarity)
        u_mm = samples.u_px[kept] * reference.scale_mm_per_px * polarity
        self._alpha = samples.alpha_rad[kept] * float(np.prod(polarity))
        self._unturn = plane_rotation(-self._alpha)
        self._seen = self._unturn * u_mm[:, None, :]
        """(n, 2, 2): times the scales it is the path of the picture's centre, but for its sign."""
        self._seen_steps = np.diff(self._seen, axis=0, prepend=self._seen[:1])
        self._alpha_steps = np.diff(self._alpha, prepend=self._alpha[:1])
        self._by_tau = np.zeros((len(u_mm), 6))
        self._rows = 6 if prior.planar else 3
        self._moved_to: tuple[Array, Array, Array] | None = None

    def steps(self, theta: Array) -> Array:
        """Steps of measured minus predicted path (n, 3 or 6): in-plane mm (2), α rad[, elevational mm, tilt (2)]."""
        step = -picture_steps(*self._moved(theta), self._samples.steps) - self._by_tau * theta[TAU]
        step[:, :2] = np.einsum("nij,nj->ni", self._unturn, step[:, :2]) + self._seen_steps @ (1 + theta[3:5])
        step[:, 2] += self._alpha_steps
        return np.asarray(step[:, : self._rows])

    def slopes(self, theta: Array) -> Array:
        """Derivative (n, 3 or 6, 9) of the steps."""
        slope = -picture_slopes(*self._moved(theta), self._samples.steps)
        slope[..., TAU] = -self._by_tau
        slope[:, :2] = self._unturn @ slope[:, :2]
        slope[:, :2, 3:5] = self._seen_steps
        return np.asarray(slope[:, : self._rows])

    def linearise_latency(self, theta: Array) -> None:
        """Take the derivative of the steps by latency at theta; it changes little with X."""
        moved = self._moved(theta)
        before, after = (picture_steps(*moved, s) for s in (self._samples.earlier_steps, self._samples.later_steps))
        self._by_tau = (after - before) / self._samples.apart_s

    def _moved(self, theta: Array) -> tuple[Array, Array]:
        if self._moved_to is None or self._moved_to[0] is not theta:
            rotation = rotation_from_vector(theta[:3]) @ self._reference.rotation
            self._moved_to = theta, rotation, self._reference.offset_mm + theta[5:8]
        return self._moved_to[1:]

    def noise(self, theta: Array) -> Noise:
        """Of the residual path."""
        return self._times.estimated_noise(np.cumsum(self.steps(theta), axis=0))

    def whitener(self, noise: Noise) -> Whitener:
        """For paths of this problem."""
        return Whitener(self._times, noise, self._rows)

    def minimise(self, theta: Array, whiten: Whitener, noise: Noise) -> tuple[Array, Array, float]:
        """Gauss–Newton with Huber weights on the innovations; covariance grows where they are wider than the model."""
        self.linearise_latency(theta)
        prior = np.diag(1 / self._prior_sd() ** 2)
        covariance, excess = self._honest_covariance(whiten, noise, prior)
        spread, cost = 1.0, 0.0
        for _ in range(_ITERATIONS):
            r = whiten(self.steps(theta)).reshape(-1)
            J = whiten(self.slopes(theta)).reshape(-1, 9)
            weight = 1 / np.maximum(np.abs(r) / _HUBER, 1)
            weighted = J * weight[:, None]
            slope = weighted.T @ r + prior @ theta
            slope[5:8] -= excess * (self._reference.offset_mm + theta[5:8])
            information = weighted.T @ J + prior
            information[range(5, 8), range(5, 8)] -= excess
            step = np.linalg.solve(information, slope)
            theta = theta - step
            spread = float((weight * r * r).sum() / max(r.size - 9, 1)) / _HUBER_SHARE
            cost = _huber_cost(r)
            if np.all(np.abs(step) < 1e-6):
                break
        return theta, covariance * max(_LEAST_SPREAD, spread), cost

    def _honest_covariance(self, whiten: Whitener, noise: Noise, prior: Array) -> tuple[Array, Array]:
        """I_c⁻¹ I I_c⁻¹ at the reference, where I_c is the information I less what tracker noise in it pretends; and
        the excess (3,) of the offsets, zero where the motion does not rise well above it.

        Each picture adds one such unit in each of the two rows that a rotation enters. Without this, motion that has no
        elevational part would seem to show the rotations about lateral and axial; and at the solution the fit has
        already bent towards the noise, so the reference is where information is counted.

        A turn error δ of one pose moves the residual by δ × t_x and its derivative by t_x with it: the offset would
        shrink by the ratio of excess to information, so `minimise` takes the excess off (errors in variables).
        """
        gradient = whiten(self.slopes(np.zeros(9)))
        J = gradient.reshape(-1, 9)
        information = J.T @ J + prior
        entered = np.array([2.0, 2.0, 2.0] if self._prior.planar else [1.0, 1.0, 2.0])
        excess = entered * len(gradient) * noise.angle_rad**2 * position_weight(noise, self._times.period_s)
        pretended = np.concatenate([np.full(3, 2.0 * len(gradient)), np.zeros(2), excess, [0.0]])
        values, axes = np.linalg.eigh(information - prior - np.diag(pretended))
        told = (axes * np.maximum(values, 0.0)) @ axes.T
        corrected = np.linalg.inv(told + prior)
        alone = 1 / np.diag(np.linalg.inv(information))[5:8] - np.diag(prior)[5:8]
        return corrected @ information @ corrected, np.where(alone > _RISES * excess, excess, 0.0)

    def _prior_sd(self) -> Array:
        p = self._prior
        return np.array([p.tilt_rad] * 2 + [p.rotation_rad] + [p.scale] * 2 + [p.offset_mm] * 3 + [p.latency_s])

    def conclude(self, theta: Array, covariance: Array, cost: float, noise: Noise) -> Solution:
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
            noise.position_mm,
            noise.angle_rad,
            self.agreement(theta),
            cost / len(self._alpha),
            len(self._alpha),
        )

    def _observed(self, covariance: Array) -> tuple[bool, ...]:
        """Where the motion, not the prior, tells: within half the prior's sd and what a check could still use."""
        useful = np.array([np.deg2rad(2.0)] * 3 + [0.03] * 2 + [4.0] * 3)
        enough = np.minimum(useful, 0.5 * self._prior_sd()[:TAU])
        return tuple(bool(flag) for flag in np.sqrt(np.diag(covariance)[:TAU]) < enough)

    def agreement(self, theta: Array) -> float:
        """Correlation of the measured with the predicted in-plane path over about half a second, worse moving axis."""
        missed_path = np.cumsum(self.steps(theta)[:, :2], axis=0)
        measured = self._seen @ (1 + theta[3:5])
        lag = max(1, min(round(0.5 / self._times.period_s), len(self._alpha) // 3))
        same = self._times.quiet(lag)
        moved = (measured[lag:] - measured[:-lag])[same]
        missed = (missed_path[lag:] - missed_path[:-lag])[same]
        axes = [k for k in (0, 1) if len(moved) > 2 and moved[:, k].std() > 0.2]
        agreed = [_correlation(moved[:, k], moved[:, k] - missed[:, k]) for k in axes]
        return min(agreed, default=float("nan"))


def _huber_cost(residual: Array) -> float:
    size = np.abs(residual)
    return float(np.where(size <= _HUBER, size**2, 2 * _HUBER * size - _HUBER**2).sum())


def _correlation(a: Array, b: Array) -> float:
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / scale if scale > 0 else float("nan")
