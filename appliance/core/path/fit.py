"""Measures how well a calibration explains the paths of picture and tracker by itself, without a solution."""

from dataclasses import replace
from math import isnan, nan

import numpy as np

from probewatch.appliance.core.path.blocks import AGREEMENT_LAG_S, AXIAL, BREATHING, LATERAL, TRACKER
from probewatch.appliance.core.path.huber import huber_cost
from probewatch.appliance.core.path.noise import LearnedNoise, Noise
from probewatch.appliance.core.path.residual import NOTHING, VALUE, PathResidual
from probewatch.appliance.core.path.samples import PathSamples
from probewatch.appliance.types import Calibration
from probewatch.drivers.rigid import Array

_SHORT_LAG_S = 0.2
"""Time, s, over which the steps of the paths are compared in motion too short for the usual half second: two blocks. A
longer one shows a polarity later; a shorter one drowns in tracker noise, so that the polarity stays unknown. Not
varied.
"""
_DEEPEST_MM2 = np.square([2.0, 6.0])
"""Largest variances of breathing, mm², lateral and axial, while polarities are weighed: breaths of 6 and 17 mm. The
residual of a wrong polarity is smooth and as large as the probe's displacement, and would be taken for deeper breaths.
Not varied.
"""


class PathFit:
    """Measures how well references explain samples by themselves, where noise has the given parts and, for the misfit,
    any size.

    reference: the one by which displacement out of the plane is computed; those that are weighed differ from it in
    polarity alone.
    """

    def __init__(self, samples: PathSamples, reference: Calibration, noise: Noise) -> None:
        self._samples = samples
        residual = PathResidual.of(samples, reference)
        self._known = {reference.polarity: residual}
        self._noise = LearnedNoise(residual.blocks, residual.parts, _alike(noise), residual.given)

    def misfit(self, reference: Calibration) -> float:
        """Returns −2 log likelihood per picture."""
        path = self._residual(reference).linear(NOTHING)[:, VALUE]
        cost = 0.0
        for row, one in zip(self._noise.rows, path, strict=True):
            cost += len(one) * np.log(huber_cost(row.white(one)) / len(one)) + row.log_volume
        return cost / int(np.count_nonzero(self._samples.kept))

    def cost(self, reference: Calibration) -> float:
        """Returns the mean of h of (21) over the innovations, given noise of the stated size: 1 where the noise is of
        that size, less where it is smaller.
        """
        path = self._residual(reference).linear(NOTHING)[:, VALUE]
        rows = zip(self._noise.rows, path, strict=True)
        return sum(huber_cost(row.white(one)) for row, one in rows) / path.size

    @property
    def innovations(self) -> int:
        """Returns the number of innovations, which is the same under any polarity."""
        return 3 * len(self._samples.blocks)

    def agreement(self, reference: Calibration) -> float:
        """Returns the correlation as of `Solution.correlation`, here under the reference itself, and by shorter steps
        where the motion is too short.
        """
        residual, nothing = self._residual(reference), (NOTHING, np.zeros(1))
        agreed = agreement(residual, self._noise, *nothing)
        return agreement(residual, self._noise, *nothing, _SHORT_LAG_S) if isnan(agreed) else agreed

    def _residual(self, reference: Calibration) -> PathResidual:
        if reference.polarity not in self._known:
            self._known[reference.polarity] = PathResidual(self._samples, reference, planar=False)
        return self._known[reference.polarity]


def agreement(
    residual: PathResidual, noise: LearnedNoise, theta: Array, breathing: Array, lag_s: float = AGREEMENT_LAG_S
) -> float:
    """Returns the correlation of the measured with the predicted path once breathing and pulse are removed, for the
    worse of the two axes that moved; NaN where none did.
    """
    path, seen = residual.linear(theta)[:, VALUE] - breathing, residual.seen(theta)
    clean = (path[k] - noise.rows[k].tissue(path[k]) for k in (LATERAL, AXIAL))
    agreed = [residual.blocks.agreement(*both, lag_s) for both in zip(seen, clean, strict=True)]
    return min((r for r in agreed if not isnan(r)), default=nan)


def _alike(noise: Noise) -> Noise:
    """Returns the noise with a tracker that is as noisy along both axes and with breathing up to `_DEEPEST_MM2`: under
    a wrong polarity, tissue that gives way takes the axial row's noise for its own.
    """
    variances = noise.variances.copy()
    variances[AXIAL, TRACKER] = np.maximum(variances[AXIAL, TRACKER], variances[LATERAL, TRACKER])
    rows = [LATERAL, AXIAL]
    variances[rows, BREATHING] = np.minimum(variances[rows, BREATHING], _DEEPEST_MM2)
    return replace(noise, variances=variances)
