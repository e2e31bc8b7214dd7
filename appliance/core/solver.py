"""AX=XB solver: the calibration that explains the path of the picture by the path of the sensor.

Measured is the path of the image centre through the tissue, integrated along the keyframe chain: with p_j = R(α_j) p_0
+ Λ u_j the centre of picture j lies at −R(−α_j) Λ u_j in the axes of the chain's first picture. Predicted is the same
path from A = X B X⁻¹ (Eq. 1), step by step: t_a = R_x t_b + t_x − R_a t_x, turned back by the measured α. Their
difference is white tracker noise, a slow drift and one offset per chain; whitening by that model and regressing the
noisy side on the clean one gives maximum-likelihood estimates without the bias of the norm constraint (mathematics,
section 3).
"""

from dataclasses import astuple, dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from appliance.core.geometry import Array, rotation_from_vector, skew
from appliance.types import Calibration

_ITERATIONS = 6
_NOISE_ROUNDS = 5
_SAME_NOISE = 0.1
_HUBER = 2.0
_OFFSET_VARIANCE = 1e6
_LONG_LAG_S = 0.7
_CHANCE = 2.5
_LEAST_SPREAD = 0.7
_POSITION_FLOOR_MM, _ANGLE_FLOOR_RAD = 0.02, np.deg2rad(0.01)
_POSITION_DRIFT_FLOOR, _ANGLE_DRIFT_FLOOR = 0.01, np.deg2rad(0.02)
TAU = 8
"""Index of the latency, s, behind the eight parameters of X."""


@dataclass(frozen=True, slots=True, eq=False)
class PathSamples:
    """n pictures of one or more chains, in time order.

    t_s: (n,). chain: (n,) int. u_px: (n, 2), alpha_rad: (n,) path within the chain. poses: (n, 4, 4) sensor → tracker
    at t_s + latency; earlier_poses, later_poses: the same, half of `apart_s` before and after, for the derivative by
    latency. apart_s spans several pose periods, or tracker noise would drown the velocity.
    """

    t_s: Array
    chain: NDArray[np.int64]
    u_px: Array
    alpha_rad: Array
    poses: Array
    earlier_poses: Array
    later_poses: Array
    apart_s: float


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
    theta, noise = np.zeros(9), problem.noise(np.zeros(9))
    for _ in range(_NOISE_ROUNDS):
        whiten = problem.whitener(noise)
        theta, covariance, cost = problem.minimise(theta, whiten)
        settled, noise = noise, problem.noise(theta)
        if noise.like(settled):
            break
    return problem.conclude(theta, covariance, cost + whiten.log_volume, noise)


def path_misfit(samples: PathSamples, reference: Calibration) -> float:
    """−2 log likelihood per picture of the reference itself, only the noise estimated. ValueError as in solve."""
    problem = _Problem(samples, reference, Prior())
    residual = problem.residual(np.zeros(9))
    whiten = problem.whitener(problem.noise(np.zeros(9)))
    return (_huber_cost(whiten(residual)) + whiten.log_volume) / len(residual)


def path_agreement(samples: PathSamples, reference: Calibration) -> float:
    """Correlation of measured and predicted in-plane motion under the reference itself, as Solution.correlation."""
    return _Problem(samples, reference, Prior()).agreement(np.zeros(9))


def predicted_path(poses: Array, reference: Calibration) -> Array:
    """(m, 4, 4) successive poses → (m, 3) mm: way of the image centre in its own turning axes: lateral, axial,
    elevational.

    The in-plane part is what a perfect registration would integrate, whatever the probe tilts on its way.
    """
    step = _picture_steps(reference.rotation, reference.offset_mm, _sensor_steps(poses))
    unturn = _turn(-np.cumsum(step[:, 2]))
    in_plane = np.einsum("nij,nj->ni", unturn, step[:, :2])
    return -np.cumsum(np.column_stack([in_plane, step[:, 3]]), axis=0)


@dataclass(frozen=True, slots=True)
class _Noise:
    """White sd and random-walk sd per √s, of positions (mm) and angles (rad)."""

    position_mm: float
    position_drift: float
    angle_rad: float
    angle_drift: float

    def like(self, other: "_Noise") -> bool:
        """Whether another round with this noise would give the same answer."""
        own, others = np.array(astuple(self)), np.array(astuple(other))
        return bool(np.all(np.abs(own - others) <= _SAME_NOISE * others))


class _Problem:
    def __init__(self, samples: PathSamples, reference: Calibration, prior: Prior) -> None:
        keep = _long_chains(samples.chain)
        if keep.sum() < 8:
            raise ValueError(f"{int(keep.sum())} registered pictures are too few to solve; 8 are needed")
        self._reference = reference
        self._prior = prior
        self._t_s = samples.t_s[keep]
        self._chain = samples.chain[keep]
        self._first = np.r_[True, np.diff(self._chain) != 0]
        self._alpha = samples.alpha_rad[keep]
        self._u_mm = samples.u_px[keep] * reference.scale_mm_per_px * np.array(reference.polarity)
        self._alpha_sign = float(np.prod(reference.polarity))
        self._steps = _sensor_steps(samples.poses[keep])
        self._earlier = _sensor_steps(samples.earlier_poses[keep])
        self._later = _sensor_steps(samples.later_poses[keep])
        self._apart_s = samples.apart_s
        self._rows = 6 if prior.planar else 3
        self._unturn = _turn(-self._alpha_sign * self._alpha)

    def residual(self, theta: Array) -> Array:
        """Measured minus predicted path (n, 3 or 6): in-plane mm (2), α rad[, elevational mm, tilt rad (2)]."""
        R, offset = self._moved(theta)
        step = _picture_steps(R, offset, self._steps)
        if theta[TAU]:
            step = step + self._by_latency(R, offset) * theta[TAU]
        step[:, :2] = np.einsum("nij,nj->ni", self._unturn, step[:, :2])
        step[self._first] = 0.0
        path = -np.cumsum(step, axis=0)
        path[:, :2] += np.einsum("nij,nj->ni", self._unturn, self._u_mm * (1 + theta[3:5]))
        path[:, 2] += self._alpha_sign * self._alpha
        return path[:, : self._rows]

    def gradient(self, theta: Array) -> Array:
        """Derivative (n, 3 or 6, 9) of the residual path."""
        R, offset = self._moved(theta)
        slope = _picture_slopes(R, offset, self._steps)
        slope[..., TAU] = self._by_latency(R, offset)
        slope[:, :2] = np.einsum("nij,njk->nik", self._unturn, slope[:, :2])
        slope[self._first] = 0.0
        path = -np.cumsum(slope, axis=0)
        path[:, :2, 3:5] += self._unturn * self._u_mm[:, None, :]
        return path[:, : self._rows]

    def _moved(self, theta: Array) -> tuple[Array, Array]:
        rotation = rotation_from_vector(theta[:3]) @ self._reference.rotation
        return rotation, self._reference.offset_mm + theta[5:8]

    def _by_latency(self, R: Array, offset: Array) -> Array:
        before = _picture_steps(R, offset, self._earlier)
        return (_picture_steps(R, offset, self._later) - before) / self._apart_s

    def noise(self, theta: Array) -> "_Noise":
        """White noise and drift of the residual path from its structure function at one frame and at `_LONG_LAG_S`."""
        residual = self.residual(theta)
        position = self._structure(residual[:, :2], _POSITION_FLOOR_MM, _POSITION_DRIFT_FLOOR)
        angle = self._structure(residual[:, 2:3], _ANGLE_FLOOR_RAD, _ANGLE_DRIFT_FLOOR)
        return _Noise(*position, *angle)

    def _structure(self, path: Array, floor: float, drift_floor: float) -> tuple[float, float]:
        period_s = float(np.median(np.diff(self._t_s)))
        long_lag = max(2, min(round(_LONG_LAG_S / max(period_s, 1e-3)), path.shape[0] // 3))
        short, long = (self._lagged_variance(path, lag) for lag in (1, long_lag))
        chance = 1 + _CHANCE * np.sqrt(3 / max((path.shape[0] - long_lag) * path.shape[1], 1))
        drift_variance = max((long - short * chance) / ((long_lag - 1) * period_s), drift_floor**2)
        white = max((short - drift_variance * period_s) / 2, floor**2)
        return float(np.sqrt(white)), float(np.sqrt(drift_variance))

    def _lagged_variance(self, path: Array, lag: int) -> float:
        same = self._chain[lag:] == self._chain[:-lag]
        change = np.abs((path[lag:] - path[:-lag])[same])
        return float((1.4826 * np.median(change)) ** 2) if change.size else 0.0

    def whitener(self, noise: _Noise) -> "_Whitener":
        return _Whitener(self._t_s, self._chain, noise, self._prior.planar)

    def minimise(self, theta: Array, whiten: "_Whitener") -> tuple[Array, Array, float]:
        """Gauss–Newton with Huber weights on the innovations; covariance grows where they are wider than the model."""
        prior = np.diag(1 / self._prior_sd() ** 2)
        spread, cost = 1.0, 0.0
        for _ in range(_ITERATIONS):
            r = whiten(self.residual(theta)).reshape(-1)
            J = whiten(self.gradient(theta)).reshape(-1, 9)
            weight = 1 / np.maximum(np.abs(r) / _HUBER, 1)
            weighted = J * weight[:, None]
            step = np.linalg.solve(weighted.T @ J + prior, weighted.T @ r + prior @ theta)
            theta = theta - step
            spread = float((weight * r * r).sum() / max(r.size - 9, 1))
            cost = _huber_cost(r)
            if np.all(np.abs(step) < 1e-6):
                break
        return theta, self._honest_covariance(whiten, prior) * max(_LEAST_SPREAD, spread), cost

    def _honest_covariance(self, whiten: "_Whitener", prior: Array) -> Array:
        """I_c⁻¹ I I_c⁻¹ at the reference, where I_c is the information I less what tracker noise in it pretends.

        Each picture adds one such unit in each of the two rows that a rotation enters. Without this, motion that has no
        elevational part would seem to show the rotations about lateral and axial; and at the solution the fit has
        already bent towards the noise, so the reference is where information is counted.
        """
        gradient = whiten(self.gradient(np.zeros(9)))
        J = gradient.reshape(-1, 9)
        information = J.T @ J + prior
        pretended = np.diag([2.0 * len(gradient)] * 3 + [0.0] * 6)
        values, axes = np.linalg.eigh(information - prior - pretended)
        told = (axes * np.maximum(values, 0.0)) @ axes.T
        corrected = np.linalg.inv(told + prior)
        return np.asarray(corrected @ information @ corrected)

    def _prior_sd(self) -> Array:
        p = self._prior
        return np.array([p.tilt_rad] * 2 + [p.rotation_rad] + [p.scale] * 2 + [p.offset_mm] * 3 + [p.latency_s])

    def conclude(self, theta: Array, covariance: Array, cost: float, noise: _Noise) -> Solution:
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
            cost / self._t_s.size,
            self._t_s.size,
        )

    def _observed(self, covariance: Array) -> tuple[bool, ...]:
        """Where the motion, not the prior, tells: within half the prior's sd and what a check could still use."""
        useful = np.array([np.deg2rad(2.0)] * 3 + [0.03] * 2 + [4.0] * 3)
        enough = np.minimum(useful, 0.5 * self._prior_sd()[:TAU])
        return tuple(bool(flag) for flag in np.sqrt(np.diag(covariance)[:TAU]) < enough)

    def agreement(self, theta: Array) -> float:
        """Correlation of the measured with the predicted in-plane path over about half a second, worse moving axis."""
        residual = self.residual(theta)
        measured = np.einsum("nij,nj->ni", self._unturn, self._u_mm * (1 + theta[3:5]))
        lag = max(1, min(round(0.5 / max(float(np.median(np.diff(self._t_s))), 1e-3)), self._t_s.size // 3))
        same = self._chain[lag:] == self._chain[:-lag]
        moved = (measured[lag:] - measured[:-lag])[same]
        missed = (residual[lag:, :2] - residual[:-lag, :2])[same]
        axes = [k for k in (0, 1) if len(moved) > 2 and moved[:, k].std() > 0.2]
        agreed = [_correlation(moved[:, k], moved[:, k] - missed[:, k]) for k in axes]
        return min(agreed, default=float("nan"))


class _Whitener:
    """Applies L⁻¹, where L Lᵀ is the covariance of white noise + random walk + one free offset per chain."""

    def __init__(self, t_s: Array, chain: NDArray[np.int64], noise: _Noise, planar: bool) -> None:
        self._blocks = []
        self.log_volume = 0.0
        position = (noise.position_mm, noise.position_drift)
        angle = (noise.angle_rad, noise.angle_drift)
        kinds = [(position, slice(0, 2)), (angle, slice(2, 3))]
        if planar:
            kinds += [(position, slice(3, 4)), (angle, slice(4, 6))]
        for name in np.unique(chain):
            rows = np.flatnonzero(chain == name)
            factors = {kind: _factor(t_s[rows], *kind) for kind in (position, angle)}
            self._blocks += [(rows, columns, factors[kind]) for kind, columns in kinds]
            self.log_volume += sum(
                2 * float(np.log(np.diag(factors[kind])).sum()) * (columns.stop - columns.start)
                for kind, columns in kinds
            )

    def __call__(self, path: Array) -> Array:
        """(n, k, …) → the same shape, innovations of unit variance; the offset's own row becomes ≈ 0."""
        out = np.empty_like(path)
        for rows, columns, factor in self._blocks:
            block = path[rows][:, columns]
            flat = solve_triangular(factor, block.reshape(rows.size, -1), lower=True, check_finite=False)
            out[rows[:, None], np.arange(path.shape[1])[columns]] = flat.reshape(block.shape)
        return out


def _factor(t_s: Array, white: float, drift: float) -> Array:
    since = t_s - t_s[0]
    covariance = np.minimum(since[:, None], since[None, :]) * drift**2
    covariance += white**2 * np.eye(t_s.size) + _OFFSET_VARIANCE * white**2
    return np.asarray(cholesky(covariance, lower=True, check_finite=False))


def _sensor_steps(poses: Array) -> tuple[Array, Array]:
    """(n, 4, 4) → B_j⁻¹ B_{j−1} as R_b (n, 3, 3), t_b (n, 3); the first is the identity."""
    R, t = poses[:, :3, :3], poses[:, :3, 3]
    R_b = np.tile(np.eye(3), (len(R), 1, 1))
    t_b = np.zeros((len(R), 3))
    back = np.swapaxes(R[1:], -1, -2)
    R_b[1:] = back @ R[:-1]
    t_b[1:] = np.einsum("nij,nj->ni", back, t[:-1] - t[1:])
    return R_b, t_b


def _picture_turns(R: Array, R_b: Array) -> tuple[Array, Array]:
    """R_a = R R_b Rᵀ (n, 3, 3) and its small rotation vector (n, 3)."""
    R_a = R @ R_b @ R.T
    turn = 0.5 * np.stack(
        [R_a[:, 2, 1] - R_a[:, 1, 2], R_a[:, 0, 2] - R_a[:, 2, 0], R_a[:, 1, 0] - R_a[:, 0, 1]], axis=1
    )
    return R_a, turn


def _picture_steps(R: Array, offset: Array, steps: tuple[Array, Array]) -> Array:
    """Steps of A = X B X⁻¹ (n, 6): t_x, t_y mm, α, t_z, tilt x, tilt y."""
    R_b, t_b = steps
    R_a, turn = _picture_turns(R, R_b)
    t_a = t_b @ R.T + offset - R_a @ offset
    return np.column_stack([t_a[:, :2], turn[:, 2], t_a[:, 2], turn[:, :2]])


def _picture_slopes(R: Array, offset: Array, steps: tuple[Array, Array]) -> Array:
    """Derivative (n, 6, 9) of _picture_steps by rotation and offset; the columns of scale and latency stay zero."""
    R_b, t_b = steps
    R_a, turn = _picture_turns(R, R_b)
    by_rotation = skew(R_a @ offset - t_b @ R.T) - R_a @ skew(offset)
    turn_by_rotation = -skew(turn)
    slopes = np.zeros((len(t_b), 6, 9))
    slopes[:, [0, 1, 3], :3] = by_rotation
    slopes[:, [4, 5, 2], :3] = turn_by_rotation
    slopes[:, [0, 1, 3], 5:8] = np.eye(3) - R_a
    return slopes


def _turn(angle_rad: Array) -> Array:
    """(n,) → (n, 2, 2) plane rotations."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)


def _long_chains(chain: NDArray[np.int64], least: int = 4) -> NDArray[np.bool_]:
    _, index, count = np.unique(chain, return_inverse=True, return_counts=True)
    return np.asarray(count[index] >= least)


def _huber_cost(residual: Array) -> float:
    size = np.abs(residual)
    return float(np.where(size <= _HUBER, size**2, 2 * _HUBER * size - _HUBER**2).sum())


def _correlation(a: Array, b: Array) -> float:
    a, b = a - a.mean(), b - b.mean()
    scale = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / scale if scale > 0 else float("nan")
