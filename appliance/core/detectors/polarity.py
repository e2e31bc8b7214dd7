"""Which of the four picture orientations the motion supports.

Motion alone cannot tell a lateral flip from a sensor turned by 180° about image depth; the polarity is the explanation
that leaves the rotation nearest its reference (docs/method.md, equation 7).
"""

from dataclasses import replace
from math import nan

from appliance.core.path.noise import Noise
from appliance.core.path.samples import PathSamples
from appliance.core.path.solver import PathFit
from appliance.types import Calibration, Check, Fault, VerdictKind

FINDS = (Fault.POLARITY,)

POLARITIES = ((1, 1), (-1, 1), (1, -1), (-1, -1))
MOST_FLIPPED = 0.5
"""Axes: between none and one."""
UNWEIGHED = Check("polarity", Fault.POLARITY, nan, 0.0, "axes", MOST_FLIPPED, VerdictKind.NOT_VERIFIED)
"""Of a window that does not tell it."""
_WORSE = 40.0
"""By how much, in −2 log likelihood, every other polarity must be worse. Less decides from motion along one axis alone,
which cannot tell (tests/appliance/core/detectors/test_detectors.py); more decides later. The figure was not measured.
"""
_LEAST_RESEMBLANCE = 0.7
"""Correlation of picture and tracker under the reference itself, with its best polarity. Lower than what is asked of a
solution, as a reference whose rotation is off by 45° still has this; less decides where the two have nothing in common.
"""


def weigh_polarity(samples: PathSamples, reference: Calibration, noise: Noise) -> tuple[tuple[int, int], Check]:
    """Best polarity, decided or not, and the check on it. Raises ValueError where the samples are too few.

    noise: of a solution near the reference. The check's value is the number of flipped axes. It is OK only if every
    flip is worse than the reference by `_WORSE` in −2 log likelihood, so with motion along one axis alone it stays not
    verified; and nothing is decided where even the best explanation does not resemble what the picture did.
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
    """The reference with its polarity multiplied by (lateral, axial) ±1."""
    lateral, axial = reference.polarity
    return replace(reference, polarity=(lateral * polarity[0], axial * polarity[1]))


def _check(value: float, verdict: VerdictKind, shown_ns: int | None) -> Check:
    return Check("polarity", Fault.POLARITY, value, 0.0, "axes", MOST_FLIPPED, verdict, shown_ns)
