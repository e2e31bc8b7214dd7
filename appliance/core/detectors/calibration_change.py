"""Checks each parameter of the solved calibration against the reference: inside its limit, outside it, or not shown."""

from dataclasses import replace
from math import hypot, nan, sqrt

from probewatch.appliance.core.parameters import CLASSES, QUANTITIES, named_from
from probewatch.appliance.core.path.latency import Latency
from probewatch.appliance.core.path.residual import LEAST_TRAVEL_MM, SCALE
from probewatch.appliance.core.path.solver import Solution
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import PARAMETERS, Check, Fault, VerdictKind
from probewatch.drivers.rigid import Array

REPORTS_FAULTS = (Fault.ROTATION, Fault.SCALE, Fault.OFFSET, Fault.LATENCY)

_LEAST_AGREEMENT = 0.9
"""Least correlation of measured and predicted motion. A lower value trusts X where a tracker is late or a picture is
followed badly; a higher one concludes nothing from short or noisy motion. Not measured.
"""
_AXIAL_SCALE = SCALE.stop - 1
"""Index in PARAMETERS of the parameter that a press shows."""
_OF_HIDDEN = 0.5
"""Standard deviation of what tissue hides of the axial scale, as a share of `Solution.hides`, the share by which the
tissue may still follow a press: the error may be all of it. A lower value closed the contact on an axial scale wrong by
8 % over foam that follows by .05 (limit 5 %); a higher one verifies less over rigid tissue, where a gesture leaves .005
to .01.
"""


def calibration_checks(solution: Solution | None, limits: Limits) -> tuple[Check, ...]:
    """Returns one check for each of PARAMETERS, in deg, % and mm.

    Where picture and tracker do not agree on the motion (correlation below 0.9) the model does not hold, and nothing is
    concluded from it.
    """
    return tuple(_parameter(index, solution, limits) for index in range(len(PARAMETERS)))


def dragged(travel_mm: Array) -> frozenset[str]:
    """Returns the names of the scales along whose axes the probe covered too little. travel_mm: (2,) of `Solution`."""
    ways = zip(PARAMETERS[SCALE], travel_mm, strict=True)
    return frozenset(name for name, way_mm in ways if way_mm < LEAST_TRAVEL_MM)


def trusted(solution: Solution) -> bool:
    """Returns whether picture and tracker agree on the in-plane motion well enough for the model to hold."""
    return solution.correlation >= _LEAST_AGREEMENT


def latency_check(latency: Latency | None, limits: Limits, stamps_err_s: float, shown_ns: int | None = None) -> Check:
    """Returns the check of the tracker's lag, ms, which is positive when the tracker is late.

    stamps_err_s: bound of the error that the stamps of pictures and poses share. It is not noise: motion cannot average
    it out, so it reduces the margin on either side of the limit. shown_ns: stamp of the motion that showed the latency.
    """
    if latency is None:
        return Check("latency", Fault.LATENCY, nan, nan, "ms", limits.latency_ms, VerdictKind.NOT_VERIFIED)
    check = Check(
        "latency", Fault.LATENCY, latency.value_s * 1e3, latency.sigma_s * 1e3, "ms", limits.latency_ms,
        VerdictKind.NOT_VERIFIED, shown_ns,
    )  # fmt: skip
    return _judged(check, limits.confidence_sigma, check.limit, stamps_err_s * 1e3)


def agreement_check(solution: Solution | None) -> Check:
    """Returns the check of how far predicted and measured in-plane motion are from perfect correlation.

    It states a fact and never names a fault.
    """
    value = nan if solution is None else 1 - solution.correlation
    verdict = VerdictKind.OK if value <= 1 - _LEAST_AGREEMENT else VerdictKind.NOT_VERIFIED
    return Check("motion-agreement", Fault.AGREEMENT, value, 0.0, "1 − r", 1 - _LEAST_AGREEMENT, verdict)


def _parameter(index: int, solution: Solution | None, limits: Limits) -> Check:
    name, fault = PARAMETERS[index], CLASSES[index]
    quantity = QUANTITIES[fault]
    unit, factor, limit = quantity.unit, quantity.per_unit, quantity.limit(limits)
    if solution is None or not trusted(solution):
        return Check(name, fault, nan, nan, unit, limit, VerdictKind.NOT_VERIFIED)
    value = float(solution.change[index]) * factor
    left_out = quantity.left_out_rigid if solution.rigid else quantity.left_out
    hides = solution.hides * factor * _OF_HIDDEN if index == _AXIAL_SCALE else 0.0
    sigma = hypot(sqrt(float(solution.covariance[index, index])) * factor, left_out, hides)
    if name in dragged(solution.travel_mm) or not solution.calibration.observed[index]:
        return Check(name, fault, nan, sigma, unit, limit, VerdictKind.NOT_VERIFIED)
    shown_ns = int(solution.shown_ns[index])
    check = Check(name, fault, value, sigma, unit, limit, VerdictKind.NOT_VERIFIED, shown_ns)
    return _judged(check, limits.confidence_sigma, named_from(fault, limits, solution.rigid))


def _judged(check: Check, confidence: float, fault_from: float, bound: float = 0.0) -> Check:
    """Returns the check with its verdict: OK below the limit, FAULT beyond `fault_from`, unchanged in between.

    Both OK and FAULT need a margin of `confidence` sigmas and the bound.
    """
    room = confidence * check.sigma + bound
    if abs(check.value) + room <= check.limit:
        return replace(check, verdict=VerdictKind.OK)
    return replace(check, verdict=VerdictKind.FAULT) if abs(check.value) - room > fault_from else check
