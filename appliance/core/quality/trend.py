"""Computes the trend of a parameter over days, as an exponentially weighted mean of its estimates with control limits.
Pure.

Each estimate is of a window of its own. As soon as there are enough of them, their scatter about one another says more
about how far to trust them than the sigmas that they state; the larger of the two counts (docs/method.md, section 10).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite, sqrt

import numpy as np

from probewatch.drivers.rigid import Array

_WEIGHT = 0.2
"""Weight of the newest estimate. Less sees a slower drift and reports a step later: with .2, a shift of one sigma is
seen after 24 estimates, one of two sigmas after 5 (medians; tests/appliance/core/quality/test_trend.py)."""
_CONTROL_SIGMAS = 3.0
"""Control limits, as a multiple of the mean's own standard deviation. Of 400 steady parameters, 86 left them within 400
estimates, which are four days (test_trend.py); fewer sigmas report earlier, more report falsely less often."""
_BASELINE = 12
"""The number of estimates that form the baseline with which the others are compared: an hour of scanning. Fewer make it
vague; more include in it a drift that was there from the start."""
_NEAR = 0.7
"""Share of its limit from which a parameter is near it, as in `probewatch fleet`."""
DAY_S = 86_400.0
"""The number of seconds in a day."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """Holds one measurement of a parameter against the reference in force, utc_s after 1970. value, sigma: in the unit
    of the parameter.
    """

    utc_s: float
    value: float
    sigma: float


@dataclass(frozen=True, slots=True)
class Trend:
    """Holds the trend of one parameter under one reference.

    mean: weighted mean after each estimate, (n,). low, high: (n,) control limits; infinite until there is a baseline.
    per_day, per_day_sigma: slope of the estimates. days_left: before which the mean does not reach ± limit, at the
    latest slope plus two sigmas; inf where it moves away from it, or there is no baseline.
    """

    estimates: tuple[Estimate, ...]
    limit: float
    mean: Array
    low: Array
    high: Array
    per_day: float
    per_day_sigma: float
    days_left: float

    @property
    def moving(self) -> bool:
        """Returns whether the mean has left its control limits: then the parameter is not what it was."""
        return bool(len(self.estimates) and not self.low[-1] <= self.mean[-1] <= self.high[-1])

    @property
    def near(self) -> bool:
        """Returns whether the mean is near the limit of the check."""
        return bool(len(self.estimates) and abs(self.mean[-1]) >= _NEAR * self.limit)


def trend(estimates: Sequence[Estimate], limit: float) -> Trend:
    """Returns the trend of estimates in time order; those without a value or a sigma are left out. limit: that of the
    check, in the unit of the estimates.
    """
    known = tuple(one for one in estimates if isfinite(one.value) and isfinite(one.sigma) and one.sigma > 0)
    values = np.array([one.value for one in known])
    base, scatter = _baseline(values, np.array([one.sigma for one in known]))
    mean = _weighted(values, base)
    room = _control(len(known), scatter) * (1.0 if len(known) > _BASELINE else inf)
    slope, slope_sigma = _slope(np.array([one.utc_s for one in known]) / DAY_S, values, scatter)
    left = _days_left(float(mean[-1]), slope, slope_sigma, limit) if len(known) > _BASELINE else inf
    return Trend(known, limit, mean, base - room, base + room, slope, slope_sigma, left)


def _baseline(values: Array, sigmas: Array) -> tuple[float, float]:
    """Returns the mean of the first estimates, and the standard deviation of a single one: the larger of the stated and
    the observed one. The latter comes from the differences of successive estimates, which a slow drift does not widen.
    """
    if not values.size:
        return 0.0, 1.0
    stated = sqrt(float(np.mean(sigmas**2)))
    seen = sqrt(float(np.mean(np.diff(values) ** 2)) / 2) if values.size > _BASELINE else 0.0
    return float(np.mean(values[:_BASELINE])), max(stated, seen)


def _weighted(values: Array, start: float) -> Array:
    mean, means = start, np.empty_like(values)
    for index, value in enumerate(values):
        mean += _WEIGHT * (value - mean)
        means[index] = mean
    return means


def _control(count: int, scatter: float) -> Array:
    """Returns half widths of the limits, (count,), from the mean's own variance and that of the baseline."""
    grown = 1 - (1 - _WEIGHT) ** (2 * np.arange(1, count + 1))
    variance = scatter**2 * (_WEIGHT / (2 - _WEIGHT) * grown + 1 / _BASELINE)
    return np.asarray(_CONTROL_SIGMAS * np.sqrt(variance))


def _slope(days: Array, values: Array, scatter: float) -> tuple[float, float]:
    spread = float(np.sum((days - days.mean()) ** 2)) if days.size > 2 else 0.0
    if spread <= 0:
        return 0.0, inf
    return float(np.sum((days - days.mean()) * values)) / spread, scatter / sqrt(spread)


def _days_left(mean: float, slope: float, sigma: float, limit: float) -> float:
    """Returns the days until the mean may reach the sooner of both limits, at a slope two sigmas steeper towards it."""
    if not isfinite(sigma):
        return inf
    up, down = slope + 2 * sigma, -slope + 2 * sigma
    ways = ((limit - mean, up), (limit + mean, down))
    return min((max(way, 0.0) / speed for way, speed in ways if speed > 0), default=inf)
