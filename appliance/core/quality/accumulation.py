"""Averages the estimates of one parameter over many windows; the sigma of the mean falls with the amount of motion,
down to a floor that the scatter of the estimates sets. Pure.

Windows of one examination share the patient and the place in front of the tracker, and so share most of what the model
leaves out, f; windows of different examinations do not. With x the values, v = σ² − f², and τ²(x, v) the variance by
which they scatter beyond v (random effects: DerSimonian and Laird, Controlled Clinical Trials 7, 1986):

    examination k:   X_k = Σ w x ÷ Σ w,   V_k = 1 ÷ Σ w,   w = 1 ÷ (v + τ²(x, v)),   σ² = V_k + f²
    all K of them:   F² = (n f² + (K − 1) τ²(X, V)) ÷ (n + K − 1),  w = 1 ÷ (V + F²),  σ² = 1 ÷ Σ w
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt

import numpy as np

from probewatch.appliance.core.quality.trend import Estimate
from probewatch.drivers.rigid import Array

_APART_S = 1800.0
"""Gap, s, beyond which two estimates belong to different examinations. A smaller value counts a pause as another
patient, and so treats as independent what both estimates leave out; a larger one counts several patients as one and
reports too large a sigma. Not measured."""
_STATED_COUNTS = 2
"""The number of examinations for which the stated left-out standard deviation counts, beside the examinations' own
scatter. A larger value trusts the stated one for longer: for five examinations that leave out three times as much, the
sigma is too small by a factor of 1.47 with 4 and of 1.37 with 2 (test_accumulation.py). A smaller one trusts the
scatter of a few examinations, which chance makes small."""


@dataclass(frozen=True, slots=True)
class Accumulated:
    """Holds the average of one parameter over all motion, in its unit. between: standard deviation of what each
    examination leaves out, as learned. estimates, examinations: how many there were.
    """

    value: float
    sigma: float
    between: float
    estimates: int
    examinations: int


def pooled(values: Sequence[float], sigmas: Sequence[float], left_out: float) -> tuple[float, float]:
    """Returns the mean and its sigma over windows of one examination; each sigma includes left_out, which the windows
    share.

    Raises ValueError without any window.
    """
    if not values:
        raise ValueError("there is no window")
    mean, variance = _averaged(np.asarray(values), _own(np.asarray(sigmas), left_out))
    return mean, sqrt(variance + left_out**2)


def accumulated(estimates: Sequence[Estimate], left_out: float) -> Accumulated | None:
    """Returns the average of estimates in time order, or None without any. Each estimate is of windows of its own, and
    its sigma includes left_out.
    """
    if not estimates:
        return None
    examinations = [_examined(one, left_out) for one in _examinations(estimates)]
    means, variances = np.array(examinations).T
    between = _between(means, variances, left_out)
    weights = 1 / (variances + between)
    return Accumulated(
        float(weights @ means / weights.sum()),
        float(1 / sqrt(weights.sum())),
        sqrt(between),
        len(estimates),
        len(examinations),
    )


def _examinations(estimates: Sequence[Estimate]) -> list[list[Estimate]]:
    found = [[estimates[0]]]
    for before, now in pairwise(estimates):
        if now.utc_s - before.utc_s > _APART_S:
            found.append([])
        found[-1].append(now)
    return found


def _examined(estimates: Sequence[Estimate], left_out: float) -> tuple[float, float]:
    """Returns the mean and its variance, without what all of the estimates leave out."""
    values, sigmas = (np.array([getattr(one, name) for one in estimates]) for name in ("value", "sigma"))
    return _averaged(values, _own(sigmas, left_out))


def _own(sigmas: Array, left_out: float) -> Array:
    """Returns the variances, (n,), without what is left out. A share of that stays where nothing else is stated, so
    that one window does not outweigh all others.
    """
    return np.asarray(np.maximum(sigmas**2 - left_out**2, (left_out / 10) ** 2))


def _averaged(values: Array, variances: Array) -> tuple[float, float]:
    """Returns the mean and its variance, with the scatter beyond the stated variances included."""
    weights = 1 / (variances + _excess(values, variances))
    return float(weights @ values / weights.sum()), float(1 / weights.sum())


def _excess(values: Array, variances: Array) -> float:
    """Returns the variance by which the values scatter beyond the given variances, at least 0."""
    weights = 1 / variances
    total = float(weights.sum())
    misfit = float(weights @ (values - weights @ values / total) ** 2)
    share = total - float(weights @ weights) / total
    return max(0.0, (misfit - (values.size - 1)) / share) if values.size > 1 else 0.0


def _between(means: Array, variances: Array, left_out: float) -> float:
    """Returns the variance of what each examination leaves out: as stated at first, and increasingly as the
    examinations scatter.
    """
    seen = means.size - 1
    return (_STATED_COUNTS * left_out**2 + seen * _excess(means, variances)) / (_STATED_COUNTS + seen)
