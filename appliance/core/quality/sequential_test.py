"""One sequential test of everything that the calibration may have become, from any time of the last seconds on.

For each of a few starts: how much better than the best calibration within its limits does one beyond them explain what
picture and tracker said since then? The log of that ratio is held against a promised mean time between two false
alarms. It only ever accuses: that all is well is shown elsewhere (docs/method.md, section 10).

The rows are whitened from the newest block backwards. So what is whitened of the last seconds does not depend on what
came before, and one factorisation serves every start.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import log

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtri

from appliance.core.parameters import LEFT_OUT, MEASURED, PER_UNIT, QUANTITIES, limit_of_each
from appliance.core.path.noise import AXIAL, BREATHING, LATERAL, Noise, covariances
from appliance.core.path.residual import OFFSET, ROTATION, SCALE, TAU, VALUE, PathResidual
from appliance.core.path.window import PathWindow
from appliance.limits import Limits
from appliance.types import Calibration, Check, Fault, Rival, VerdictKind
from drivers.rigid import Array

FINDS = (Fault.ROTATION, Fault.SCALE, Fault.OFFSET, Fault.LATENCY)

WINDOW_NS = 10_000_000_000
"""Of the oldest start: as long as the window that measures. Longer finds smaller changes later, and costs time."""
_STARTS = (10, 14, 19, 26, 36, 45, 58, 76, 100)
"""Lengths that are tested, in blocks of a tenth of a second: each about 1.3 times the one before. A change between two
of them is found by the shorter one, later by less than that."""
_FALSE_ALARM_H = 1000.0
"""Mean time between two false FAULTs that is promised: a cart's year of scanning or so. Twice as much names everything
.7 nats later. Not measured: docs/evidence.md has the hours of healthy scanning that were run.
"""
NAMED_NATS = log(_FALSE_ALARM_H * 3600 * 30)
"""18.5: log likelihood ratio of a FAULT. By Ville's inequality a true likelihood ratio passes it once in so many
pictures; the sup over sizes costs a few nats of that and a look at each tenth picture gives two back."""
WITHDRAWN_NATS = 10.0
"""The same of a sign, which withdraws the OK and names nothing: once in hours of motion at the limit itself. Less opens
the contact for nothing, more keeps it closed for longer over what will be named."""
_AHEAD_NATS = 5.0
"""By how much the class that is named must explain the motion better than any other: odds of 150. Less names the wrong
one more often, more tells two for longer. Not measured."""
_INFLATED = 1.3**2
"""Of every variance: tails that are heavier than the model's. In simulations t₅ tails ended a promise of 1e5 looks
after 623 without it. More is later, less trusts the learned noise more than its own scatter allows."""
_MOST_SPREAD = 4.0
"""Mean square of what a class leaves, in that of the noise, from which it explains nothing: something else is wrong,
and it must not be named. A window that holds the leap of a marker body has 3 to 12 (gesture, 6°)."""
_HUBER = 2.0
"""Standard deviations from which an innovation counts less, as in the solver."""
_LEFT_OUT = 3 * LEFT_OUT
"""rad, relative, mm, s: beyond the limits before anything is accused: three standard deviations of what the model of
the motion leaves out, as the checks have it."""
_PRIOR = np.array([0.2] * 3 + [0.15] * 2 + [10.0] * 3 + [0.1])
"""Of what is beyond: it keeps what the motion does not show near the reference."""
_FREE = 1e-9
"""Share of that prior that is left within the limits: just enough to divide by."""
_UNKNOWN_BREATHING_MM2 = np.array([[LATERAL, 0.7**2], [AXIAL, 2.0**2]])
"""Row, and variance of breathing that is reckoned with until the noise of a breath was learned: quiet breathing beside
the liver, 4 to 6 mm from peak to peak."""
_CLASSES: Mapping[Fault, slice] = {
    Fault.ROTATION: ROTATION, Fault.SCALE: SCALE, Fault.OFFSET: OFFSET, Fault.LATENCY: slice(TAU, TAU + 1),
}  # fmt: skip
_DRIFT = np.array([2.0, 2.0, np.deg2rad(2.0)])
"""mm/s and rad/s: of each row, for as long as a window: tissue that gives way, a body that creeps. It belongs to
neither side, or a creep of 1 mm/s would be called a scale while its offset is still within the limit."""
_ANYTHING = np.diag(np.append(_PRIOR, _DRIFT) ** -2.0)
"""(12, 12): information before any motion is seen."""
_VALUE = TAU + 1 + _DRIFT.size
"""Of the rows of innovations: θ, the drifts, and the value."""
_ROUNDS, _TURNS, _SEARCH = 6, 3, 30
"""Reweighted fits of one linear model, models about the fit before, and bounds that are taken or left: most."""
_WORTH_NATS = 6.0
"""From which a linear fit is worth a second, exact one: below WITHDRAWN_NATS by more than the second order."""


@dataclass(frozen=True, slots=True, eq=False)
class Accusation:
    """since_ns: from when on. nats: by how much what is accused explains the motion better than anything within its
    limits. checks: FAULTs of the parameters that are surely beyond, where one class explains it; else the parameter
    that is farthest beyond, NOT_VERIFIED, of each class that is as likely, the likeliest first. rivals: those classes,
    where there are two or more and the likeliest explains it.
    """

    since_ns: int
    nats: float
    checks: tuple[Check, ...]
    rivals: tuple[Rival, ...] = ()

    @property
    def named(self) -> frozenset[str]:
        """Of the checks that are FAULTs."""
        return frozenset(check.name for check in self.checks if check.verdict is VerdictKind.FAULT)


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """theta: (12,) θ and the drifts. cost: −2 log likelihood. information: (12, 12)."""

    theta: Array
    cost: float
    information: Array


def accuse(
    window: PathWindow, reference: Calibration, limits: Limits, noise: Noise, lag_s: float, breathing_known: bool
) -> Accusation | None:
    """None where a calibration within its limits explains the motion as well, from whatever start.

    noise: learned from motion before the change, or under the calibration that the motion itself asks for. lag_s: of
    the tracker, near which it is looked for. breathing_known: whether `noise` has seen a breath.
    """
    try:
        rows = _Rows(window, reference, noise if breathing_known else _with_breathing(noise), lag_s)
        starts = [n for n in sorted({min(n, len(rows)) for n in _STARTS}) if n >= _STARTS[0]]
        worth = [n for n in starts if rows.score(n) >= _WORTH_NATS]
        best = max((_Trial(rows, n, _bounds(limits, lag_s)) for n in worth), key=lambda trial: trial.nats, default=None)
        if best is None or best.nats < WITHDRAWN_NATS:
            return None
        return best.accusation(rows.start_ns(best.n), limits, lag_s)
    except ValueError:
        # Too few pictures, or a matrix that motion without content leaves singular (LinAlgError).
        return None


def _with_breathing(noise: Noise) -> Noise:
    variances = noise.variances.copy()
    for row, least in _UNKNOWN_BREATHING_MM2:
        variances[int(row), BREATHING] = max(variances[int(row), BREATHING], least)
    return replace(noise, variances=variances)


def _bounds(limits: Limits, lag_s: float) -> tuple[Array, Array]:
    """(12,) least and most of what is within its limit; the latency counts from lag_s, any drift is."""
    most = limit_of_each(limits) + _LEFT_OUT
    about = np.append(np.zeros(TAU), lag_s)
    drift = np.full(_DRIFT.size, np.inf)
    return np.append(-most - about, -drift), np.append(most - about, drift)


class _Rows:
    """Innovations of the rows and of their derivatives, the newest first."""

    def __init__(self, window: PathWindow, reference: Calibration, noise: Noise, lag_s: float) -> None:
        self._samples = window.samples(lag_s)
        self._residual = PathResidual(self._samples, reference, planar=False)
        self._residual.linearise_latency(np.zeros(9))
        backwards = covariances(self._residual.blocks, self._residual.elevation_mm, noise)[:, ::-1, ::-1]
        self._whitening = [_whitening(C) for C in backwards]
        t_s = self._residual.blocks.t_s
        self._drift = [(W @ (t_s - t_s[-1])[::-1])[None] for W in self._whitening]
        self._at_reference = self._white(np.zeros(_VALUE), len(self))

    def __len__(self) -> int:
        """Blocks."""
        return len(self._residual.blocks)

    def start_ns(self, n: int) -> int:
        """Stamp of the first of the last n blocks."""
        return self._samples.stamp_ns(float(self._residual.blocks.t_s[-n]))

    def score(self, n: int) -> float:
        """By how much the last n blocks would rather have another calibration than the reference, to first order."""
        white = self.at_reference(n)
        slope = white[:_VALUE] @ np.clip(white[_VALUE], -_HUBER, _HUBER)
        information = white[:_VALUE] @ white[:_VALUE].T + _ANYTHING
        return 0.5 * float(slope @ np.linalg.solve(information, slope)) / _INFLATED

    def at_reference(self, n: int) -> Array:
        """(13, 3 n): of the last n blocks."""
        return self._at_reference[:, :, :n].reshape(_VALUE + 1, -1)

    def at(self, theta: Array, n: int) -> Array:
        return self._white(theta, n).reshape(_VALUE + 1, -1)

    def _white(self, theta: Array, n: int) -> Array:
        """(13, 3, n). The scales are regressed on the predicted path: the measured one holds the tissue's motion."""
        linear = self._residual.linear(theta[: TAU + 1])
        seen = self._residual.seen(theta[: TAU + 1])
        linear[[LATERAL, AXIAL], [3, 4]] = seen - linear[[LATERAL, AXIAL], VALUE]
        newest = linear[:, :, ::-1][:, :, :n]
        white = np.zeros((_VALUE + 1, len(newest), n))
        for k, (row, W) in enumerate(zip(newest, self._whitening, strict=True)):
            rows = row @ W[:n, :n].T
            white[: TAU + 1, k], white[_VALUE, k] = rows[:VALUE], rows[VALUE]
            white[TAU + 1 + k, k] = self._drift[k][0, :n]
            white[_VALUE, k] += theta[TAU + 1 + k] * white[TAU + 1 + k, k]
        return white


def _whitening(covariance: Array) -> Array:
    factor, refused = dpotrf(covariance, lower=True, clean=True)
    if refused:
        raise ValueError("the noise of the path leaves its covariance not positive definite")
    return np.asarray(dtrtri(factor, lower=True)[0])


class _Trial:
    """Of the last n blocks. nats: by how much the best calibration, wherever it is, beats the best within bounds."""

    def __init__(self, rows: _Rows, n: int, bounds: tuple[Array, Array]) -> None:
        self.n, self._rows, self._bounds = n, rows, bounds
        self._prior = _ANYTHING
        self._within_prior = self._prior * np.append(np.full(9, _FREE), np.ones(_DRIFT.size))
        self.nats = self._linear_nats()
        if self.nats >= _WORTH_NATS:
            self._free = self._exact(*_anywhere(), self._prior)
            self._within = self._exact(*bounds, self._within_prior)
            self._spread = self._spread_of(self._free)
            self.nats = self._beyond(self._free)

    def _beyond(self, fit: _Fit) -> float:
        return 0.5 * (self._within.cost - fit.cost) / self._spread

    def _spread_of(self, fit: _Fit) -> float:
        """Mean square of what the fit leaves, not less than what every variance is inflated by."""
        return max(_INFLATED, fit.cost / max(3 * self.n - _VALUE, 1) / 0.954)

    def _linear_nats(self) -> float:
        rows = self._rows.at_reference(self.n)
        free = _fitted(rows, np.zeros(_VALUE), *_anywhere(), self._prior)
        self._spread = self._spread_of(free)
        if 0.5 * (_huber(rows[_VALUE]) - free.cost) / self._spread < _WORTH_NATS:
            return 0.0
        self._within = _fitted(rows, np.zeros(_VALUE), *self._bounds, self._within_prior)
        return self._beyond(free)

    def _exact(self, low: Array, high: Array, prior: Array) -> _Fit:
        """Fitted again about where the fit before ended."""
        theta, fit = np.zeros(_VALUE), None
        for _ in range(_TURNS):
            fit = _fitted(self._rows.at(theta, self.n), theta, low, high, prior)
            moved, theta = np.abs(fit.theta - theta), fit.theta
            if np.all(moved[: TAU + 1] < 0.05 * _LEFT_OUT):
                break
        left = self._rows.at(theta, self.n)[_VALUE]
        assert fit is not None
        return replace(fit, cost=_huber(left) + float(theta @ prior @ theta))

    def accusation(self, since_ns: int, limits: Limits, lag_s: float) -> Accusation:
        """The classes that explain it, each alone, and whether one of them may be named."""
        fits = {fault: self._alone(own) for fault, own in _CLASSES.items()}
        ahead = sorted(fits, key=lambda fault: fits[fault].cost)
        first = fits[ahead[0]]
        behind = {fault: 0.5 * (fits[fault].cost - first.cost) / self._spread for fault in ahead}
        rivals = [fault for fault in ahead if behind[fault] < _AHEAD_NATS]
        explains = self._spread_of(first) < _MOST_SPREAD
        named = explains and len(rivals) == 1 and self._beyond(first) >= NAMED_NATS
        own = _checks(first, ahead[0], limits, lag_s, self._spread) if named else []
        beyond = [replace(check, verdict=VerdictKind.FAULT) for check in own if _surely(check, limits)]
        if beyond:
            return Accusation(since_ns, self.nats, tuple(beyond))
        each = (_checks(fits[fault], fault, limits, lag_s, self._spread) for fault in rivals)
        worst = tuple(max(checks, key=lambda check: check.ratio) for checks in each)
        as_likely = tuple(Rival(check, behind[check.fault]) for check in worst) if explains and len(worst) > 1 else ()
        return Accusation(since_ns, self.nats, worst, as_likely)

    def _alone(self, own: slice) -> _Fit:
        """Where only one class may be beyond its limits."""
        low, high = (bound.copy() for bound in self._bounds)
        low[own], high[own] = -np.inf, np.inf
        prior = self._within_prior.copy()
        prior[own, own] = self._prior[own, own]
        return self._exact(low, high, prior)


def _checks(fit: _Fit, fault: Fault, limits: Limits, lag_s: float, spread: float) -> list[Check]:
    """Of each parameter of a class."""
    quantity = QUANTITIES[fault]
    unit, limit = quantity.unit, quantity.limit(limits)
    values = fit.theta[: TAU + 1] * PER_UNIT
    values[TAU] += lag_s * 1e3
    sigmas = np.sqrt(np.diag(np.linalg.inv(fit.information))[: TAU + 1] * spread) * PER_UNIT
    return [
        Check(MEASURED[k], fault, float(values[k]), float(sigmas[k]), unit, limit, VerdictKind.NOT_VERIFIED)
        for k in range(TAU + 1)[_CLASSES[fault]]
    ]


def _surely(check: Check, limits: Limits) -> bool:
    return abs(check.value) - limits.confidence_sigma * check.sigma > check.limit


def _anywhere() -> tuple[Array, Array]:
    return np.full(_VALUE, -np.inf), np.full(_VALUE, np.inf)


def _huber(innovations: Array) -> float:
    size = np.abs(innovations)
    return float(np.where(size <= _HUBER, size**2, 2 * _HUBER * size - _HUBER**2).sum())


def _fitted(rows: Array, about: Array, low: Array, high: Array, prior: Array) -> _Fit:
    """θ between low and high with Huber's weights. rows: (13, k) innovations, linear about `about`.

    Far from the solution everything looks like an outlier, so the weights begin with the scatter that is there.
    """
    J, theta = rows[:_VALUE], about
    at_zero = rows[_VALUE] - about @ J
    for _ in range(_ROUNDS):
        left = np.abs(at_zero + theta @ J)
        weighed = J / np.maximum(left / (_HUBER * max(1.0, float(np.median(left)) / 0.6745)), 1.0)
        information = weighed @ J.T + prior
        before, theta = theta, _minimum(information, -weighed @ at_zero, low, high)
        if np.all(np.abs(theta - before)[: TAU + 1] < 0.01 * _LEFT_OUT):
            break
    return _Fit(theta, _huber(at_zero + theta @ J) + float(theta @ prior @ theta), information)


def _minimum(H: Array, g: Array, low: Array, high: Array) -> Array:
    """(12,) of ½ xᵀ H x − gᵀ x between low and high: bounds are taken as they are met, and left where it pays."""
    x = np.linalg.solve(H, g)
    if np.all((x >= low) & (x <= high)):
        return np.asarray(x)
    x = np.clip(x, low, high)
    at_bound = (x <= low) | (x >= high)
    for _ in range(_SEARCH):
        free = ~at_bound
        wanted = np.linalg.solve(H[np.ix_(free, free)], g[free] - H[np.ix_(free, at_bound)] @ x[at_bound])
        x[free] = np.clip(wanted, low[free], high[free])
        met = x[free] != wanted
        if met.any():
            at_bound[np.flatnonzero(free)[met]] = True
            continue
        slope = H @ x - g
        inwards = np.where(x <= low, -slope, slope) / np.sqrt(np.diag(H)) * at_bound
        if inwards.max() <= 0.0:
            break
        at_bound[int(np.argmax(inwards))] = False
    return np.asarray(x)
