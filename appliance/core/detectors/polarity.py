"""Decides which of the four picture orientations the motion supports.

Motion alone cannot distinguish a lateral flip from a sensor turned by 180° about image depth; the polarity is the
explanation that leaves the rotation nearest its reference (docs/method.md, equation 7).
"""

from dataclasses import replace
from math import nan

import numpy as np

from probewatch.appliance.core.path.fit import PathFit
from probewatch.appliance.core.path.noise import Noise
from probewatch.appliance.core.path.samples import PathSamples
from probewatch.appliance.types import Calibration, Check, Fault, VerdictKind

REPORTS_FAULTS = (Fault.POLARITY,)

POLARITIES = ((1, 1), (-1, 1), (1, -1), (-1, -1))
MOST_FLIPPED = 0.5
"""Limit of the check, flipped axes: between none and one."""
UNWEIGHED = Check("polarity", Fault.POLARITY, nan, 0.0, "axes", MOST_FLIPPED, VerdictKind.NOT_VERIFIED)
"""Check of a window that does not show the polarity."""
_WORSE = 40.0
"""Least difference, in −2 log likelihood, by which every other polarity must be worse. A lower one decides from motion
along one axis alone, which decides nothing (tests/appliance/core/detectors/test_detectors.py); a higher one decides
later. The figure was not measured.
"""
_LEAST_RESEMBLANCE = 0.7
"""Least correlation of picture and tracker under the reference itself, with its best polarity. It is lower than what is
asked of a solution, because a reference whose rotation is off by 45° still reaches it; a lower one decides where the
two have nothing in common.
"""

_GENEROUS = Noise(
    np.stack(
        [np.square([0.25, 0.3, 0.3, 0.1, 0.0, breathing_mm, 0.3]) for breathing_mm in (0.7, 2.0)]
        + [np.square(np.deg2rad([0.1, 0.3, 0.3, 0.3, 0.0, 0.1, 0.1]))]
    )
)
"""Variance of each part, in the order of `Noise.variances`, for lateral, axial and turn: 2.5 times the noise of an
optical tracker, and quiet breaths of 4 to 6 mm. A flip that stands out from this needs no learned noise. Larger
variances name flips later (twice as large: in-plane after 1 s instead of .8, median of 16); smaller ones take lags for
flips (.15 mm: one of 40 lags of -300 ms)."""
_FITS = 0.5
"""Largest mean square of the residuals of a flip, in `_GENEROUS`, at which it explains the motion: .02 to .1 where the
rest of the calibration is right, .6 where it is off by 20° (one second of a sweep, one seed). A higher one names a flip
where a lag or another convention is similar; a lower one requires a calibration that is right except for the flip."""


def obvious_flip(samples: PathSamples, reference: Calibration, ahead_nats: float) -> Check | None:
    """Returns a FAULT where one flip explains the motion and nothing else does, whatever the noise; otherwise None.

    It needs no solution, and less motion than `weigh_polarity`. Raises ValueError where the samples are too few.
    ahead_nats: log likelihood by which the flip must explain the motion better than every other polarity.
    """
    fit = PathFit(samples, reference, _GENEROUS)
    costs = {p: fit.cost(flipped(reference, p)) for p in POLARITIES}
    best, second = sorted(costs, key=lambda p: costs[p])[:2]
    margin = (costs[second] - costs[best]) * fit.innovations
    if best == (1, 1) or margin < 2 * ahead_nats or costs[best] > _FITS:
        return None
    return _check(float(best.count(-1)), VerdictKind.FAULT, samples.moved_ns)


def weigh_polarity(samples: PathSamples, reference: Calibration, noise: Noise) -> tuple[tuple[int, int], Check]:
    """Returns the best polarity, decided or not, and the check on it. Raises ValueError where the samples are too few.

    noise: that of a solution near the reference. The value of the check is the number of flipped axes. It is OK only if
    every flip is worse than the reference by `_WORSE` in −2 log likelihood, so that it remains not verified with motion
    along one axis alone; and nothing is decided where even the best explanation does not resemble the motion of the
    picture.
    """
    fit = PathFit(samples, reference, noise)
    misfits = {p: fit.misfit(flipped(reference, p)) for p in POLARITIES}
    best = min(misfits, key=lambda p: misfits[p])
    margin = (min(misfits[p] for p in POLARITIES if p != best) - misfits[best]) * samples.t_s.size
    agreement = fit.agreement(flipped(reference, best))
    if margin < _WORSE or not agreement > _LEAST_RESEMBLANCE:
        return best, UNWEIGHED
    axes = float(best.count(-1))
    return best, _check(axes, VerdictKind.FAULT if axes else VerdictKind.OK, samples.moved_ns)


def flipped(reference: Calibration, polarity: tuple[int, int]) -> Calibration:
    """Returns the reference with its polarity multiplied by (lateral, axial) ±1."""
    lateral, axial = reference.polarity
    return replace(reference, polarity=(lateral * polarity[0], axial * polarity[1]))


def _check(value: float, verdict: VerdictKind, shown_ns: int | None) -> Check:
    return Check("polarity", Fault.POLARITY, value, 0.0, "axes", MOST_FLIPPED, verdict, shown_ns)
