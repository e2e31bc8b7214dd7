"""Solves AX = XB for the calibration that explains the path of the picture by the path of the sensor.

The measured path is that of the image centre through the tissue, integrated along the keyframe chain: with p_j = R(α_j)
p_0 + Λ u_j the centre of picture j lies at −R(−α_j) Λ u_j in the axes of the chain's first picture. The same path is
predicted from A = X B X⁻¹ (Eq. 1), step by step: t_a = R_x t_b + t_x − R_a t_x, turned back by the measured α. Their
difference is noise of several parts; learning their sizes from it and regressing the noisy side on the clean one gives
maximum-likelihood estimates without the bias of the norm constraint (docs/method.md, section 7)."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from probewatch.appliance.core.path.blocks import AXIAL, LATERAL, PARTS, POSITIONS
from probewatch.appliance.core.path.breaths import Breaths
from probewatch.appliance.core.path.fit import agreement
from probewatch.appliance.core.path.huber import HUBER, HUBER_SHARE, huber_cost
from probewatch.appliance.core.path.noise import Habit, LearnedNoise, Noise
from probewatch.appliance.core.path.pretended import Pretended
from probewatch.appliance.core.path.residual import (
    FOLLOW,
    LEAST_TRAVEL_MM,
    NOTHING,
    SCALE,
    TAU,
    TILT,
    VALUE,
    Lack,
    PathResidual,
)
from probewatch.appliance.core.path.samples import PathSamples
from probewatch.appliance.core.spread_work import RESIDUAL, ROUND, Steps, run_to_end
from probewatch.appliance.core.times import QUIET_BREATH_S
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array

_ROUNDS, _ROUNDS_ON = 12, 3
"""Rounds that alternately estimate θ and learn the noise: from nothing, and from the noise of a window that shares most
of the motion."""
_ITERATIONS = 4
"""Largest number of Gauss–Newton steps of the last round; near the reference a step of less than 1e-6 mostly ends it
sooner."""
_GIVES_WAY = 0.1
"""Share above which tissue counts as giving way. For a phantom it came to .03 at most (simulated gesture, 10 s)."""
_LONGEST_STEP = np.array([0.3] * 3 + [0.3] * 2 + [30.0] * 3 + [0.3] + [0.5] * 3)
"""Largest Gauss–Newton step: rad, relative, mm, s, and that of the tissue. Where a held probe shows next to nothing, a
longer one leaves the region in which the rows are linear, and rotations ran away to several turns. Not varied."""
_USEFUL_SD = np.array([np.deg2rad(2.0)] * 3 + [0.03] * 2 + [4.0] * 3)
"""Sigma, rad, relative and mm, from which a parameter is of no use to a check: about the size of the limits themselves.
More reports numbers that mean nothing; less calls a parameter unobserved that could still show a gross fault."""
_FIRST_MM, _FIRST_RAD = 0.3, np.deg2rad(0.3)
"""Noise of a block, mm and rad, by which the first estimate weights the rows; the noise is learned from its
residual."""
_BREATHS_S = 3 * QUIET_BREATH_S
"""Length of a window, s, from which breaths are followed. In windows of 10 s, the scale was observed in one of 16; in
those of 12 and 14 s in 44 and 94 %, with sigmas of 1.5 and 1.0 % and z-scores of .8 and .9 (in-plane, eight seeds)."""
_BREATHS_AGAIN_S = 2 * QUIET_BREATH_S
"""The same where the shape of the breaths is known from before. In windows of 8, 10, 12 and 14 s, the scale was
observed in 2, 9, 9 and 12 of 12, with sigmas of 2.7 to 1.4 % (mixed, paths without pictures). In 7 s a patient whose
breathing had turned upside down since biased it by six sigmas once in eight."""
_BREATH_ROUNDS, _BREATH_ROUNDS_ON, _MOST_BREATH_ROUNDS = 10, 3, 16
"""Rounds that alternately estimate θ, learn the noise and fit the breaths: at least, in the two cases of `_ROUNDS`, and
at most. After 5, sigma of a sweep was 1.4 times that after 10, which 20 did not lessen much (in-plane, one seed)."""
_HELD_SCALE = 0.01
"""Relative standard deviation of a scale along an axis on which the probe covered less than `LEAST_TRAVEL_MM`. Nothing
is concluded about it; left free, breathing drives it to −90 %, so that the noise is learned too small and everything
else is reported with too small a sigma: a held probe was named `rotation` by 9° (gesture-hold, breathing, seed 5). At
.1 it is biased as well, .03 to .001 give the same (a probe held over breaths, eight seeds of
tests/appliance/core/path/test_breaths.py)."""
_SETTLED = 0.001
"""Change of the scales in one round, relative, below which they have settled: a fifth of their sigma in a lively sweep.
Breaths that do not settle are not followed: without this, as the end of a breath entered the window, the axial scale
was off by 5 % with a sigma of 1 % at one look in fifty (in-plane, one seed)."""


@dataclass(frozen=True, slots=True)
class Prior:
    """Holds the standard deviations of what is believed before any motion is seen, about the reference calibration.

    They are wide: they only keep unobserved parameters finite. tilt_rad is that of the rotations about lateral and
    axial, rotation_rad that about elevational. planar: the motion is known to be planar, so elevational path and tilt
    are zero up to tracker noise (Eq. 5–6); otherwise the freehand two-row form is used."""

    tilt_rad: float = 0.35
    rotation_rad: float = 0.35
    scale: float = 0.3
    offset_mm: float = 100.0
    latency_s: float = 0.03
    planar: bool = False


@dataclass(frozen=True, slots=True)
class Follow:
    """Represents the share by which the tissue in the middle of the picture follows the face that presses it, and its
    sigma."""

    share: float
    sigma: float

    @property
    def gives_way(self) -> bool:
        """Returns whether the motion shows that it does: by three sigmas, and by more than a phantom on a table
        might."""
        return self.share > max(_GIVES_WAY, 3 * self.sigma)


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Holds X and the latency as estimated from the samples, and what they rest on. calibration: estimate with
    covariance and observed flags. change: (9,) estimate minus reference, PARAMETERS then latency s.

    covariance: (9, 9). correlation: that of measured and predicted in-plane motion without the tissue's own, for the
    worse of the two axes that moved; NaN where none did. motions: number of pictures used. noise: as learned. misfit:
    −2 log likelihood per picture. travel_mm: (2,) as of `PathResidual`. way_mm: the farthest that the probe went along
    any axis. follow: that of the tissue. rigid: whether the tissue was shown not to give way. hides: share by which it
    may follow a press all the same. lack: what the pictures lack for anything to be concluded.

    shown_ns: (9,) for each of θ the stamp on either side of which half of the information on it lies. An estimate that
    mixes motion from before and after a change of twice its limit stays within the limit only while less than half of
    it is from after. So this is the newest time at which an estimate within its limit is known to have held, and motion
    that shows little, or nothing at all, does not advance it."""

    calibration: Calibration
    change: Array
    covariance: Array
    correlation: float
    motions: int
    shown_ns: NDArray[np.int64]
    noise: Noise
    misfit: float
    travel_mm: Array
    way_mm: float
    follow: Follow
    rigid: bool
    hides: float
    lack: Lack | None = None


def solve(
    samples: PathSamples,
    reference: Calibration,
    prior: Prior = Prior(),
    start: Noise | None = None,
    *,
    learn: bool = True,
) -> Solution:
    """Returns the maximum-likelihood X near the reference. Needs at least 8 samples in chains of at least 4; raises
    ValueError below that.

    start: noise of a window that shares most of its motion with this one, which is then learned in fewer rounds; its
    habits are of breaths that are not in this window. learn: False where the noise is known to be `start`."""
    return run_to_end(solving(samples, reference, prior, start, learn=learn))


def solving(
    samples: PathSamples, reference: Calibration, prior: Prior, start: Noise | None = None, *, learn: bool = True
) -> Steps[Solution]:
    """Solves as `solve` does, in steps."""
    yield RESIDUAL.of(len(samples.t_s))
    residual = PathResidual.of(samples, reference, prior.planar)
    yield ROUND.of(len(residual.blocks) ** 2)
    problem = _Problem(samples, residual, reference, prior, start, learn)
    return (yield from problem.solved())


class _Problem:
    def __init__(
        self,
        samples: PathSamples,
        residual: PathResidual,
        reference: Calibration,
        prior: Prior,
        start: Noise | None,
        learn: bool,
    ) -> None:
        self._reference, self._prior, self._samples, self.residual = reference, prior, samples, residual
        self._at_reference = residual.linear(NOTHING)
        self._travel_mm = residual.travel_mm(len(residual.blocks))
        self._known = np.diag(1 / self._prior_sd() ** 2)
        self._spread = 1.0
        self._tissue_out = np.zeros(2, dtype=np.bool_)
        self._breathing = np.zeros_like(self._at_reference[:, VALUE])
        self._rounds = 0 if not learn else _ROUNDS_ON if start else _ROUNDS
        self._first, left = self._first_estimate()
        self._noise = LearnedNoise(residual.blocks, residual.parts, start or self._first_noise(left), residual.sheared)
        self._pretended = Pretended(self._noise, residual.rigid, self._tissue_out, self._known)

    def _first_estimate(self) -> tuple[Array, Array]:
        """Returns θ by least squares, and its residual, (rows, m), each chain with an offset of its own."""
        linear = self.residual.blocks.without_offsets(self._at_reference)
        size = np.where(np.isin(np.arange(len(linear)), POSITIONS), _FIRST_MM, _FIRST_RAD)
        J, r = linear[:, :VALUE] / size[:, None, None], linear[:, VALUE] / size[:, None]
        H = np.einsum("kim,kjm->ij", J, J) + self._known
        theta = -np.linalg.solve(H, np.einsum("kim,km->i", J, r))
        return theta, linear[:, VALUE] + np.einsum("i,kim->km", theta, linear[:, :VALUE])

    def _first_noise(self, left: Array) -> Noise:
        """Returns noise in which each part but the memory has an equal share of the first estimate's residual."""
        span_s = max(float(np.ptp(self.residual.blocks.t_s)), 1.0)
        way_mm = max(float(np.ptp(self.residual.elevation_mm)), 1.0)
        per = np.array([1.0, 1 / span_s, 1 / way_mm, 1 / way_mm**2, 0.0, 1.0, 1.0])
        return Noise(np.outer(np.mean(np.square(left), axis=1), per) / PARTS)

    def solved(self) -> Steps[Solution]:
        """Estimates θ and learns the noise alternately; where breathing hides a scale, again with each breath
        followed."""
        theta, cost_us = self._first, ROUND.of(len(self.residual.blocks) ** 2)
        for _ in range(self._rounds):
            yield cost_us
            theta = self._learned(theta)
        yield cost_us
        theta, J = self._minimised(theta, _ITERATIONS)
        noise = replace(self._noise.noise, followed=None, habits={})
        followed = self._pretended.followed(J)
        hidden = [k for k in (LATERAL, AXIAL) if not followed[k]]
        if hidden and self._rounds:
            breaths = self._found(hidden, theta)
            if breaths:
                theta, J, habits = yield from self._with_breaths(breaths, theta)
                noise = replace(noise, followed=self._noise.left(list(habits)) if habits else None, habits=habits)
                hidden = [
                    k for k in (LATERAL, AXIAL) if not self._pretended.followed(J)[k] or k in set(hidden) - set(habits)
                ]
        yield cost_us
        return self._concluded(theta, J, noise, hidden)

    def _learned(self, theta: Array) -> Array:
        """Runs one round: estimates θ by the noise as it is, and learns the noise from the residual."""
        theta, J = self._minimised(theta, 1)
        linear = self._linear(theta)
        clean = [
            row.coloured(np.clip(row.white(one), -HUBER, HUBER))
            for row, one in zip(self._noise.rows, linear[:, VALUE], strict=True)
        ]
        covariance = np.asarray(np.linalg.inv(J @ J.T + self._known))
        self._noise.learn(np.array(clean), linear[:, :VALUE], covariance)
        return theta

    def _found(self, hidden: list[int], theta: Array) -> dict[int, Breaths]:
        """Returns the breaths of the hidden rows, where there are any."""
        path = self._linear(theta)[:, VALUE]
        found = {k: self._breaths(k, self._noise.breathing(k, path[k])) for k in hidden}
        return {k: breaths for k, breaths in found.items() if breaths is not None}

    def _breaths(self, k: int, breathing_mm: Array) -> Breaths | None:
        """Returns the breaths of row k: with a shape of their own where there are enough of them, otherwise with that
        of earlier ones."""
        blocks, habit = self.residual.blocks, self._noise.noise.habits.get(k)
        own = Breaths.found(blocks, breathing_mm) if np.ptp(blocks.t_s) >= _BREATHS_S else None
        if own is not None or habit is None or np.ptp(blocks.t_s) < _BREATHS_AGAIN_S:
            return own
        return Breaths.found(blocks, breathing_mm, habit)

    def _with_breaths(self, found: dict[int, Breaths], theta: Array) -> Steps[tuple[Array, Array, dict[int, Habit]]]:
        """Estimates θ, noise and breaths alternately; returns θ, J, and the habits of the breaths if they settled."""
        t_s = self.residual.blocks.t_s
        least = _BREATH_ROUNDS if self._noise.noise.followed is None else _BREATH_ROUNDS_ON
        self._tissue_out[list(found)] = True
        yield ROUND.of(len(t_s) ** 2)
        theta, _ = self._minimised(theta, 1)
        self._noise.expect_breaths({k: breaths.inside for k, breaths in found.items()}, self._linear(theta)[:, VALUE])
        states = {k: breaths.usual for k, breaths in found.items()}
        for done in range(1, _MOST_BREATH_ROUNDS + 1):
            yield ROUND.of(len(t_s) ** 2)
            path = self.residual.linear(theta)[:, VALUE]
            # The most likely breaths (22b), linear about their last state; then θ and noise without them.
            for k, breaths in found.items():
                breathing_mm, slopes = breaths.linear(t_s, states[k])
                self._breathing[k] = breathing_mm - (states[k] - breaths.usual) @ slopes
                row = self._noise.follow(k, (slopes.T * breaths.sd**2) @ slopes)
                states[k] = breaths.usual + breaths.sd**2 * row.weighed(slopes, path[k] - self._breathing[k])
            before, theta = theta, self._learned(theta)
            settled = bool(np.all(np.abs(theta - before)[SCALE] < _SETTLED))
            if settled and done >= least:
                break
        habits = {k: breaths.habit(states[k]) for k, breaths in found.items()} if settled else {}
        yield ROUND.of(len(t_s) ** 2)
        return *self._minimised(theta, _ITERATIONS), habits

    def _linear(self, theta: Array) -> Array:
        """Returns the residual's rows less the breaths that are followed. The measured path, on which the scales are
        regressed, is also without the tissue's own motion."""
        return self._less_tissue(self.residual.linear(theta))

    def _less_tissue(self, linear: Array) -> Array:
        if not self._tissue_out.any():
            return linear
        linear = linear.copy()
        linear[:, VALUE] -= self._breathing
        for k in np.flatnonzero(self._tissue_out):
            if k == LATERAL or self.residual.rigid:
                linear[k, SCALE][k] -= self._breathing[k] + self._noise.rows[k].tissue(linear[k, VALUE])
        return linear

    def _whitened(self, linear: Array) -> Array:
        """Returns the innovations, (13, rows · m), of rows (rows, 13, m)."""
        rows = [row.white(one) for row, one in zip(self._noise.rows, linear, strict=True)]
        return np.concatenate(rows, axis=1)

    def _minimised(self, theta: Array, iterations: int) -> tuple[Array, Array]:
        """Minimises (21) by Gauss–Newton with Huber weights on the innovations; returns θ, and J (12, rows · m) at the
        reference."""
        J = self._whitened(self._less_tissue(self._at_reference))[:VALUE]
        excess = self._pretended.excess(J)
        known = self._known - np.diag(excess)
        drawn = excess * np.array(
            [0.0] * 3 + [1.0] * 2 + [*self._reference.offset_mm, 0.0, self.residual.follow - 1, 0.0, 0.0]
        )
        for _ in range(iterations):
            linear = self._whitened(self._linear(theta))
            weight = 1 / np.maximum(np.abs(linear[VALUE]) / HUBER, 1)
            sums = (linear * weight) @ linear.T
            slope = sums[:VALUE, VALUE] + known @ theta - drawn
            step = np.linalg.solve(sums[:VALUE, :VALUE] + known, slope)
            step /= max(1.0, float(np.max(np.abs(step / _LONGEST_STEP))))
            theta = self.residual.possible(theta - step)
            if np.all(np.abs(step) < 1e-6):
                break
        self._spread = float(sums[VALUE, VALUE]) / max(J.shape[1] - VALUE, 1) / HUBER_SHARE
        return theta, J

    def _covariance(self, J: Array) -> Array:
        """Returns I_c⁻¹ I I_c⁻¹ at the reference (22), where I_c is the information I less its spurious part, times the
        spread of the innovations.

        Noise of the poses is in the derivatives as in the path. Without this, motion that has no elevational part would
        seem to show the rotations about lateral and axial; and at the solution the fit has already bent towards the
        noise, so the reference is where information is counted."""
        information = J @ J.T
        values, axes = np.linalg.eigh(information - np.diag(self._pretended.information()))
        told = (axes * np.maximum(values, 0.0)) @ axes.T
        corrected = np.linalg.inv(told + self._known)
        return np.asarray(corrected @ (information + self._known) @ corrected * max(1.0, self._spread))

    def _prior_sd(self) -> Array:
        p = self._prior
        held = (self._travel_mm < LEAST_TRAVEL_MM) & (True, self.residual.rigid)
        scales = np.where(held, min(_HELD_SCALE, p.scale), p.scale)
        of_X = [p.tilt_rad] * 2 + [p.rotation_rad, *scales] + [p.offset_mm] * 3
        return np.array([*of_X, p.latency_s, *self.residual.tissue_sd])

    def _shown_ns(self, influence: Array) -> NDArray[np.int64]:
        """Returns `Solution.shown_ns`. influence: (12, rows · m) of each innovation on θ; its squares add up to the
        variance of θ."""
        t_s = self.residual.blocks.t_s
        shares = np.square(influence).reshape(VALUE, -1, t_s.size).sum(axis=1).cumsum(axis=1)
        half = [min(int(np.searchsorted(share, share[-1] / 2)), t_s.size - 1) for share in shares]
        return np.array([self._samples.stamp_ns(float(t_s[k])) for k in half], dtype=np.int64)

    def _concluded(self, theta: Array, J: Array, noise: Noise, hidden: list[int]) -> Solution:
        covariance = self._covariance(J)
        reference, volume = self._reference, sum(row.log_volume for row in self._noise.rows)
        observed = self._observed(covariance, hidden)
        estimate = replace(reference.changed(theta), covariance=covariance[:8, :8], observed=observed)
        follow, tilt = self.residual.follow + float(theta[FOLLOW]), self.residual.tilt + theta[TILT]
        solution = Solution(
            estimate,
            theta[: TAU + 1],
            covariance[: TAU + 1, : TAU + 1],
            agreement(self.residual, self._noise, theta, self._breathing),
            len(self.residual),
            self._shown_ns(covariance @ J)[: TAU + 1],
            noise,
            (huber_cost(self._whitened(self._linear(theta))[VALUE]) + volume) / len(self.residual),
            self._travel_mm,
            max(float(self._travel_mm.max()), float(np.ptp(self.residual.elevation_mm))),
            Follow(follow, float(np.sqrt(covariance[FOLLOW, FOLLOW]))),
            self.residual.rigid,
            self.residual.hides,
            self.residual.lack,
        )
        self.residual.reckon(follow, tilt)
        return solution

    def _observed(self, covariance: Array, hidden: list[int]) -> tuple[bool, ...]:
        """Returns where the motion, not the prior, decides: where sigma is below half the prior's and below what a
        check could use."""
        if not self.residual.is_informative:
            return (False,) * TAU
        enough = np.minimum(_USEFUL_SD, 0.5 * self._prior_sd()[:TAU])
        observed = np.sqrt(np.diag(covariance)[:TAU]) < enough
        if self.residual.rigid:
            observed[SCALE][hidden] = False
        else:
            observed[SCALE] &= LATERAL not in hidden
        return tuple(bool(flag) for flag in observed)
