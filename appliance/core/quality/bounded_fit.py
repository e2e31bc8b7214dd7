"""Fits, by bounded least squares with Huber's weights, θ of the sequential test and a steady drift of each row."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from probewatch.appliance.core.parameters import LEFT_OUT
from probewatch.appliance.core.path.huber import HUBER, HUBER_SHARE, huber_cost
from probewatch.appliance.core.path.residual import TAU
from probewatch.drivers.rigid import Array

INFLATED = 1.3**2
"""Factor on every variance, for tails that are heavier than the model's. In simulations with t₅ tails, a promise of 1e5
looks ended after 623 without it. More reports later; less trusts the learned noise more than its own scatter allows."""
BEYOND = 3 * LEFT_OUT
"""rad, relative, mm, s: margin beyond the limits within which nothing is accused. It is three standard deviations of
what the model of the motion leaves out, as in the checks."""
PRIOR = np.array([0.2] * 3 + [0.15] * 2 + [10.0] * 3 + [0.1])
"""rad, relative, mm, s: standard deviation of what lies beyond the limits. It keeps near the reference what the motion
does not show."""
DRIFT = np.array([2.0, 2.0, np.deg2rad(2.0)])
"""mm/s and rad/s: standard deviation of the drift of each row, which lasts for a whole window: tissue that gives way, a
body that creeps. It belongs to neither side of the comparison; otherwise a creep of 1 mm/s would be called a scale
while its offset is still within the limit."""
ANYTHING = np.diag(np.append(PRIOR, DRIFT) ** -2.0)
"""(12, 12): the information before any motion is seen."""
VALUE_ROW = TAU + 1 + DRIFT.size
"""Index of the value in the rows of innovations; it follows θ and the drifts."""
_TURNS = 3
"""The maximum number of linear models, each about the previous fit."""
_ROUNDS, _SEARCH = 6, 30
"""The maximum numbers of reweighted fits of one linear model, and of steps that take or leave bounds."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Holds the result of a fit. theta: (12,) θ and the drifts, and whatever else was fitted. cost: −2 log likelihood.
    information: that on theta.
    """

    theta: Array
    cost: float
    information: Array


def anywhere(count: int = VALUE_ROW) -> tuple[Array, Array]:
    """Returns a lower and an upper bound, (count,) each, that bound nothing."""
    return np.full(count, -np.inf), np.full(count, np.inf)


def fitted(rows: Array, about: Array, low: Array, high: Array, prior: Array) -> Fit:
    """Fits θ between low and high with Huber's weights. rows: (13, k) innovations, linear about `about`; there may be
    more rows, as whatever else is fitted comes after the drifts, and the value last.

    Far from the solution everything looks like an outlier, so the weights start from the scatter that is present.
    """
    J, theta = rows[:-1], about
    at_zero = rows[-1] - about @ J
    for _ in range(_ROUNDS):
        left = np.abs(at_zero + theta @ J)
        weighed = J / np.maximum(left / (HUBER * max(1.0, float(np.median(left)) / 0.6745)), 1.0)
        information = weighed @ J.T + prior
        before, theta = theta, minimum(information, -weighed @ at_zero, low, high)
        if np.all(np.abs(theta - before)[: TAU + 1] < 0.01 * BEYOND):
            break
    return Fit(theta, huber_cost(at_zero + theta @ J) + float(theta @ prior @ theta), information)


def exact(at: Callable[[Array], Array], low: Array, high: Array, prior: Array) -> Fit:
    """Fits repeatedly, each time about the result of the previous fit. at: returns rows, as for `fitted`, that are
    linear about the θ that it is given.
    """
    theta, fit = np.zeros(len(low)), None
    for _ in range(_TURNS):
        fit = fitted(at(theta), theta, low, high, prior)
        moved, theta = np.abs(fit.theta - theta), fit.theta
        if np.all(moved[: TAU + 1] < 0.05 * BEYOND):
            break
    assert fit is not None
    return replace(fit, cost=huber_cost(at(theta)[-1]) + float(theta @ prior @ theta))


def spread(fit: Fit, n: int) -> float:
    """Returns the mean square of the residuals of n blocks, at least the factor by which every variance is inflated."""
    return max(INFLATED, fit.cost / max(3 * n - fit.theta.size, 1) / HUBER_SHARE)


def minimum(H: Array, g: Array, low: Array, high: Array) -> Array:
    """Returns the minimum, (n,), of ½ xᵀ H x − gᵀ x between low and high. Bounds become active as they are met, and are
    released where that lowers the cost.
    """
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
        # Where the scaled slope at an active bound points inwards, leaving that bound lowers the cost.
        inwards = np.where(x <= low, -slope, slope) / np.sqrt(np.diag(H)) * at_bound
        if inwards.max() <= 0.0:
            break
        at_bound[int(np.argmax(inwards))] = False
    return np.asarray(x)
