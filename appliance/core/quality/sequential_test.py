"""Tests whether the calibration has changed, to anything and since any time of the last seconds, in one sequential
test.

For each of a few starts it asks how much better the best calibration beyond the limits explains what picture and
tracker have reported since then than the best one within them. The log of that ratio is compared with a threshold that
corresponds to a promised mean time between two false alarms. The test only accuses: that all is well is shown elsewhere
(docs/method.md, section 10).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from probewatch.appliance.core.detectors.calibration_change import dragged
from probewatch.appliance.core.parameters import MEASURED, PER_UNIT, QUANTITIES, limit_of_each, named_from
from probewatch.appliance.core.path.blocks import AXIAL, BREATHING, LATERAL
from probewatch.appliance.core.path.huber import huber_cost
from probewatch.appliance.core.path.noise import Noise
from probewatch.appliance.core.path.residual import OFFSET, ROTATION, SCALE, TAU
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.bounded_fit import (
    ANYTHING,
    BEYOND,
    DRIFT,
    VALUE_ROW,
    Fit,
    anywhere,
    exact,
    fitted,
    spread,
)
from probewatch.appliance.core.quality.field_distortion import distortion_nats
from probewatch.appliance.core.quality.innovations import Innovations
from probewatch.appliance.core.spread_work import INNOVATIONS, TRIAL, Steps
from probewatch.appliance.core.times import PRESENT_NS
from probewatch.appliance.limits import NAMED_NATS, WITHDRAWN_NATS, Limits
from probewatch.appliance.types import Calibration, Check, Fault, Rival, VerdictKind
from probewatch.drivers.rigid import Array

REPORTS_FAULTS = (Fault.ROTATION, Fault.SCALE, Fault.OFFSET, Fault.LATENCY)

WINDOW_NS = PRESENT_NS
"""Age of the oldest start, ns: as long as the window that measures. Longer finds smaller changes later, and costs
processor time."""
_STARTS = (10, 14, 19, 26, 36, 45, 58, 76, 100)
"""Lengths that are tested, in blocks of a tenth of a second; each is about 1.3 times the one before. A change between
two of them is found by the shorter one, later by less than that."""
_AHEAD_NATS = 5.0
"""Evidence, nat, by which the class that is named must explain the motion better than any other: odds of 150. Less
names the wrong class more often, more reports two for longer. Not measured."""
_MOST_SPREAD = 4.0
"""Mean square of the residuals of a class, relative to the noise, from which the class explains nothing: something else
is wrong, and the class must not be named. A window that contains the jump of a marker body has 3 to 12 (gesture, 6°).
"""
_FREE = 1e-9
"""Share of the information of that prior that is left within the limits: just enough to divide by."""
_UNKNOWN_BREATHING_MM2 = np.array([[LATERAL, 0.7**2], [AXIAL, 2.0**2]])
"""Row, and the variance of breathing, mm², that is assumed until the noise of a breath has been learned: quiet
breathing beside the liver, 4 to 6 mm from peak to peak."""
_CLASSES: Mapping[Fault, slice] = {
    Fault.ROTATION: ROTATION, Fault.SCALE: SCALE, Fault.OFFSET: OFFSET, Fault.LATENCY: slice(TAU, TAU + 1),
}  # fmt: skip
_WORTH_NATS = 6.0
"""Evidence, nat, from which a linear fit is worth a second, exact one: it lies below WITHDRAWN_NATS by more than the
second order amounts to."""


@dataclass(frozen=True, slots=True, eq=False)
class Accusation:
    """Holds what the test concludes. since_ns: stamp of the start. nats: by how much what is accused explains the
    motion better than anything within its limits, below _WORTH_NATS to first order. checks: none below WITHDRAWN_NATS,
    which accuses nothing; FAULTs of the parameters that are surely beyond, where one class explains the motion; else
    the parameter that is farthest beyond, NOT_VERIFIED, of each class that is as likely, the likeliest first. rivals:
    those classes, where there are two or more and the likeliest explains the motion. A scale along an axis on which the
    probe has covered too little is a contradiction, but neither named nor a rival: skin drags along with the probe.
    bent_nats: `distortion_nats` of all that was tested; None where it was not requested.
    """

    since_ns: int
    nats: float
    checks: tuple[Check, ...]
    rivals: tuple[Rival, ...] = ()
    bent_nats: float | None = None

    @property
    def named(self) -> frozenset[str]:
        """Returns the names of the checks that are FAULTs."""
        return frozenset(check.name for check in self.checks if check.verdict is VerdictKind.FAULT)


def accuse(
    window: PathWindow,
    reference: Calibration,
    limits: Limits,
    noise: Noise,
    lag_s: float,
    breathing_known: bool,
    ask_bent: bool = False,
) -> Steps[Accusation]:
    """Returns the accusation by the start from which a calibration beyond its limits explains the motion best.

    noise: learned from motion before the change, or under the calibration that the motion itself calls for. lag_s: that
    of the tracker, around which the search is centred. breathing_known: whether `noise` has seen a breath. ask_bent:
    whether a distorted field is tested for as well.
    """
    found, bent_nats = Accusation(0, 0.0, ()), None
    try:
        yield INNOVATIONS.of(len(window))
        rows = Innovations(window, reference, noise if breathing_known else _with_breathing(noise), lag_s)
        if rows.is_informative:
            found = yield from _likeliest(rows, limits, lag_s)
        if ask_bent:
            bent_nats = yield from distortion_nats(rows)
    except ValueError:
        pass  # Too few pictures, or a matrix that motion without content leaves singular (LinAlgError).
    return replace(found, bent_nats=bent_nats)


def _likeliest(rows: Innovations, limits: Limits, lag_s: float) -> Steps[Accusation]:
    """Returns the likeliest accusation of all starts."""
    starts = [n for n in sorted({min(n, len(rows)) for n in _STARTS}) if n >= _STARTS[0]]
    best: _Trial | None = None
    for n in starts:
        if rows.score(n) < _WORTH_NATS:
            continue
        yield TRIAL.of()
        trial = _Trial(rows, n, _bounds(limits, lag_s))
        if best is None or trial.nats > best.nats:
            best = trial
    if best is None or best.nats < WITHDRAWN_NATS:
        return Accusation(0, 0.0 if best is None else best.nats, ())
    yield TRIAL.of()
    return best.accusation(rows.start_ns(best.n), limits, lag_s)


def _with_breathing(noise: Noise) -> Noise:
    variances = noise.variances.copy()
    for row, least in _UNKNOWN_BREATHING_MM2:
        variances[int(row), BREATHING] = max(variances[int(row), BREATHING], least)
    return replace(noise, variances=variances)


def _bounds(limits: Limits, lag_s: float) -> tuple[Array, Array]:
    """Returns the least and most, (12,) each, of what is within its limit; the latency counts from lag_s, and no drift
    is out of bounds.
    """
    most = limit_of_each(limits) + BEYOND
    about = np.append(np.zeros(TAU), lag_s)
    drift = np.full(DRIFT.size, np.inf)
    return np.append(-most - about, -drift), np.append(most - about, drift)


class _Trial:
    """Tries the last n blocks. nats: by how much the best calibration, wherever it is, beats the best within bounds."""

    def __init__(self, rows: Innovations, n: int, bounds: tuple[Array, Array]) -> None:
        self.n, self._rows, self._bounds = n, rows, bounds
        self._prior = ANYTHING
        self._within_prior = self._prior * np.append(np.full(9, _FREE), np.ones(DRIFT.size))
        self.nats = self._linear_nats()
        if self.nats >= _WORTH_NATS:
            self._free = self._exact(*anywhere(), self._prior)
            self._within = self._exact(*bounds, self._within_prior)
            self._spread = spread(self._free, self.n)
            self.nats = self._beyond(self._free)

    def _beyond(self, fit: Fit) -> float:
        return 0.5 * (self._within.cost - fit.cost) / self._spread

    def _linear_nats(self) -> float:
        rows = self._rows.at_reference(self.n)
        free = fitted(rows, np.zeros(VALUE_ROW), *anywhere(), self._prior)
        self._spread = spread(free, self.n)
        if 0.5 * (huber_cost(rows[VALUE_ROW]) - free.cost) / self._spread < _WORTH_NATS:
            return 0.0
        self._within = fitted(rows, np.zeros(VALUE_ROW), *self._bounds, self._within_prior)
        return self._beyond(free)

    def _exact(self, low: Array, high: Array, prior: Array) -> Fit:
        return exact(lambda theta: self._rows.at(theta, self.n), low, high, prior)

    def accusation(self, since_ns: int, limits: Limits, lag_s: float) -> Accusation:
        """Returns the accusation: the classes that alone explain the motion, or the one of them that may be named."""
        # A class is named where it alone explains the motion, and no other class does nearly as well.
        fits = {fault: self._alone(own) for fault, own in _CLASSES.items()}
        ahead = sorted(fits, key=lambda fault: fits[fault].cost)
        first = fits[ahead[0]]
        behind = {fault: 0.5 * (fits[fault].cost - first.cost) / self._spread for fault in ahead}
        rivals = [fault for fault in ahead if behind[fault] < _AHEAD_NATS]
        explains = spread(first, self.n) < _MOST_SPREAD
        named = explains and len(rivals) == 1 and self._beyond(first) >= NAMED_NATS
        own = _checks(first, ahead[0], limits, lag_s, self._spread) if named else []
        little = dragged(self._rows.travel_mm(self.n))
        beyond = [check for check in own if self._is_named(check, limits)]
        if any(check.name not in little for check in beyond):
            faults = (one if one.name in little else replace(one, verdict=VerdictKind.FAULT) for one in beyond)
            return Accusation(since_ns, self.nats, tuple(faults))
        each = (_checks(fits[fault], fault, limits, lag_s, self._spread) for fault in rivals)
        worst = tuple(max(checks, key=lambda check: check.ratio) for checks in each)
        rivalled = explains and len(worst) > 1 and not any(check.name in little for check in worst)
        as_likely = tuple(Rival(check, behind[check.fault]) for check in worst) if rivalled else ()
        return Accusation(since_ns, self.nats, worst, as_likely)

    def _is_named(self, check: Check, limits: Limits) -> bool:
        least = named_from(check.fault, limits, self._rows.rigid)
        return check.least_ratio(limits.confidence_sigma) * check.limit > least

    def _alone(self, own: slice) -> Fit:
        """Returns the fit in which only one class may be beyond its limits."""
        low, high = (bound.copy() for bound in self._bounds)
        low[own], high[own] = -np.inf, np.inf
        prior = self._within_prior.copy()
        prior[own, own] = self._prior[own, own]
        return self._exact(low, high, prior)


def _checks(fit: Fit, fault: Fault, limits: Limits, lag_s: float, spread: float) -> list[Check]:
    """Returns a check of each parameter of a class."""
    quantity = QUANTITIES[fault]
    unit, limit = quantity.unit, quantity.limit(limits)
    values = fit.theta[: TAU + 1] * PER_UNIT
    values[TAU] += lag_s * 1e3
    sigmas = np.sqrt(np.diag(np.linalg.inv(fit.information))[: TAU + 1] * spread) * PER_UNIT
    return [
        Check(MEASURED[k], fault, float(values[k]), float(sigmas[k]), unit, limit, VerdictKind.NOT_VERIFIED)
        for k in range(TAU + 1)[_CLASSES[fault]]
    ]
