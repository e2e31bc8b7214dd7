"""Averages the estimates of one parameter over many windows; the sigma of the mean falls with all motion, to a floor
that the scatter of the estimates gives. Pure.

Windows of one examination share the patient and the place before the tracker, and so most of what the model leaves
out, f; examinations do not. With x the values, v = σ² − f² and τ²(x, v) the variance by which they scatter beyond v
(random effects: DerSimonian and Laird, Controlled Clinical Trials 7, 1986):

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
"""Between two estimates of different examinations. Less takes a pause for another patient, and so what both leave out
for independent; more takes patients for one, and tells a larger sigma than there is. Not measured."""
_STATED_COUNTS = 2
"""Examinations as which the stated left-out standard deviation counts beside their own scatter. More believes the
stated one for longer: of five examinations that leave out three times as much the sigma is too small by 1.47 with 4, by
1.37 with 2 (test_accumulation.py). Fewer believes the scatter of a few, which chance makes small."""


@dataclass(frozen=True, slots=True)
class Accumulated:
    """The average of one parameter over all motion, in its unit. between: standard deviation of what each examination
    leaves out, as learned. estimates, examinations: how many there were.
    """

    value: float
    sigma: float
    between: float
    estimates: int
    examinations: int


def pooled(values: Sequence[float], sigmas: Sequence[float], left_out: float) -> tuple[float, float]:
    """(mean, its sigma) of windows of one examination; each sigma includes left_out, which they share.

    Raises ValueError without any window.
    """
    if not values:
        raise ValueError("there is no window")
    mean, variance = _averaged(np.asarray(values), _own(np.asarray(sigmas), left_out))
    return mean, sqrt(variance + left_out**2)


def accumulated(estimates: Sequence[Estimate], left_out: float) -> Accumulated | None:
    """Estimates in time order, each of windows of its own, with sigmas that include left_out; None without any."""
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
    """(mean, its variance without what all of them leave out)."""
    values, sigmas = (np.array([getattr(one, name) for one in estimates]) for name in ("value", "sigma"))
    return _averaged(values, _own(sigmas, left_out))


def _own(sigmas: Array, left_out: float) -> Array:
    """(n,) variances without what is left out; a share of it stays where nothing else is stated, lest one window weigh
    for all.
    """
    return np.asarray(np.maximum(sigmas**2 - left_out**2, (left_out / 10) ** 2))


def _averaged(values: Array, variances: Array) -> tuple[float, float]:
    """(mean, its variance), with the scatter beyond the stated variances."""
    weights = 1 / (variances + _excess(values, variances))
    return float(weights @ values / weights.sum()), float(1 / weights.sum())


def _excess(values: Array, variances: Array) -> float:
    """The variance by which values scatter beyond these, at least 0."""
    weights = 1 / variances
    total = float(weights.sum())
    misfit = float(weights @ (values - weights @ values / total) ** 2)
    share = total - float(weights @ weights) / total
    return max(0.0, (misfit - (values.size - 1)) / share) if values.size > 1 else 0.0


def _between(means: Array, variances: Array, left_out: float) -> float:
    """The variance of what each examination leaves out: as stated, and more and more as their scatter says."""
    seen = means.size - 1
    return (_STATED_COUNTS * left_out**2 + seen * _excess(means, variances)) / (_STATED_COUNTS + seen)
