"""Examines what one window of motion shows of the calibration: latency first, then polarity, then each parameter."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from probewatch.appliance.core.detectors.calibration_change import (
    agreement_check,
    calibration_checks,
    latency_check,
    trusted,
)
from probewatch.appliance.core.detectors.polarity import UNWEIGHED, flipped, weigh_polarity
from probewatch.appliance.core.parameters import LEFT_OUT, limit_of_each
from probewatch.appliance.core.path.fit import PathFit
from probewatch.appliance.core.path.latency import Latency
from probewatch.appliance.core.path.noise import Noise
from probewatch.appliance.core.path.residual import TAU
from probewatch.appliance.core.path.solver import Prior, Solution, solving
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.spread_work import LATENCY, MISFIT, POLARITY, SAMPLES, Steps, run_to_end
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration, Check, Fault, VerdictKind
from probewatch.drivers.rigid import Array

_UNKNOWN_LATENCY_S = 0.05
"""Standard deviation, s, of a latency that the paths alone do not show. More lets scales hide in it, less lets it hide
in the scales; the limit is .06 s."""
_RELINEARISE_S = 0.008
"""Change of the latency, s, from which the poses are taken anew, at the new one: a quarter of a frame. The residual is
linear in the latency only while the velocity stays the same; less costs a second solution more often. Not measured."""
_LAGS_S = (-0.2, -0.15, -0.1, -0.05, 0.0, 0.05, 0.1, 0.15, 0.2)
"""Latencies, s, that are tried where the paths show none: as far apart as `_UNKNOWN_LATENCY_S` reaches. Each costs a
misfit; a tracker that is later still is named once the paths show it."""
_FAR_BETTER = 30.0
"""Gain in −2 log likelihood by which a far latency must beat none, because it excuses the calibration. Less excuses
scale faults as latency; more leaves a late tracker unnamed for longer. Not measured."""
_LEAST_FAR_NS = 3_000_000_000
"""Window length, ns, below which no far latency is sought: over so little motion chance finds one. Not measured."""
_FAR_SIGMA_S = 0.01
"""Sigma, s, of a lag that only the search for an explanation finds: over the study's sessions the lag is within 6 ms.
More names it later where it is near its limit, which the fine search covers."""
_SAME_X = np.array([np.deg2rad(2.0)] * 3 + [0.03] * 2)
"""rad, relative: difference from the reference within which X counts as that of the reference, so that the far latency
is all that is wrong. It lies within the limits; otherwise a wrong X would be excused."""
_SAME_SHARE = 0.7
"""Share of the limits that bounds `_SAME_X` where the limits are tighter than shipped. It is larger than the shares
that `_SAME_X` takes of the shipped limits, so that it changes nothing there."""
_SHARPER = 0.8
"""Ratio of the sigma of the solver's latency to that of the paths' latency, below which the solver's is used instead.
Where the two sigmas are similar, both are equally good, and the paths' latency does not need X. Less leaves sigma at
6.5 ms in gestures, too much for the profile `fine`, which then named no slide of 4 mm in 2 of 3 runs of 16 s; with this
value it named all three after 6.5 s."""
_UNSEEN_TILT_RAD = 0.02
"""Standard deviation, rad, that holds near the reference a tilt that no motion shows: left free, noise tilts it, and
its cosine shrinks the scales."""
_NEAR = Prior(tilt_rad=0.2, rotation_rad=0.2, scale=0.15, offset_mm=10.0)
"""Prior about the reference, at two to four times the limits: wide enough that a fault at twice its limit is not drawn
back by much, and narrow enough that what the window does not show stays where the model is linear. Not measured."""


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """Holds what one window showed."""

    checks: tuple[Check, ...]
    solution: Solution | None = None

    @property
    def failed(self) -> frozenset[str]:
        """Returns the names of the checks that are shown to be outside their limit."""
        return frozenset(check.name for check in self.checks if check.verdict is VerdictKind.FAULT)

    def shows(self, names: Iterable[str]) -> bool:
        """Returns whether every one of these checks is shown to be in order."""
        return {check.name for check in self.checks if check.verdict is VerdictKind.OK}.issuperset(names)

    @property
    def shown(self) -> int:
        """Returns the number of checks that are decided either way."""
        return sum(check.verdict is not VerdictKind.NOT_VERIFIED for check in self.checks)


def agreed(finding: Finding) -> bool:
    """Returns whether picture and tracker agree on the motion."""
    return any(check.fault is Fault.AGREEMENT and check.verdict is VerdictKind.OK for check in finding.checks)


def latency_of(finding: Finding) -> Check:
    return next(check for check in finding.checks if check.fault is Fault.LATENCY)


def without(finding: Finding, names: frozenset[str]) -> Finding:
    """Returns the finding with the named checks left undecided."""
    checks = (
        replace(check, verdict=VerdictKind.NOT_VERIFIED) if check.name in names else check for check in finding.checks
    )
    return Finding(tuple(checks), finding.solution)


def examine(
    window: PathWindow, reference: Calibration, limits: Limits, start: Noise | None = None, about_s: float = 0.0
) -> Finding:
    """Determines the latency from the two paths, X by maximum likelihood on the in-plane motion, and polarity by
    likelihood.

    A late tracker looks like a wrong scale, so no parameter of X is at fault before the latency is known to be in
    order, or to be wrong and known so precisely that poses can be taken at its lag.

    start: as in `appliance.core.path.solver.solve`. about_s: latency around which the search is centred; where the fine
    search finds none there, the latency may be a FAULT, but not OK.
    """
    return run_to_end(examining(window, reference, limits, start, about_s))


def examining(
    window: PathWindow, reference: Calibration, limits: Limits, start: Noise | None, about_s: float
) -> Steps[Finding]:
    """Does the work of `examine`, in steps."""
    yield LATENCY.of(len(window))
    lag = window.latency(about_s)
    coarse = lag is None and about_s != 0.0
    if coarse:
        lag = Latency(about_s, _FAR_SIGMA_S)
    solution, solved_lag = yield from _solved(window, reference, limits, lag, start)
    if solution is None:
        return examine_nothing(limits)
    yield POLARITY.of(len(window))
    samples = window.samples(0.0 if lag is None else lag.value_s)
    polarity, polarity_check = weigh_polarity(samples, reference, solution.noise)
    if polarity != (1, 1):
        # Noise learned under a wrong polarity hides much of the evidence against it.
        mirrored, mirrored_lag = yield from _solved(window, flipped(reference, polarity), limits, lag, None)
        polarity_check = UNWEIGHED
        if mirrored is not None:
            yield POLARITY.of(len(window))
            again, check = weigh_polarity(samples, reference, mirrored.noise)
            if again == polarity and check.verdict is VerdictKind.FAULT:
                solution, solved_lag, polarity_check = mirrored, mirrored_lag, check
    lateness = latency_check(_sharper(lag, solved_lag), limits, window.stamps_err_s, samples.moved_ns)
    if coarse and lateness.verdict is VerdictKind.OK:
        lateness = replace(lateness, verdict=VerdictKind.NOT_VERIFIED)
    parameters = Finding(calibration_checks(solution, limits), solution)
    if not lag_known(lateness, limits):
        parameters = without(parameters, parameters.failed)
    return Finding((polarity_check, *parameters.checks, lateness, agreement_check(solution)), solution)


def lag_known(lateness: Check, limits: Limits) -> bool:
    """Returns whether X may be judged by poses at that lag: it is in order, or wrong and known to half its limit."""
    sharp = limits.confidence_sigma * lateness.sigma <= lateness.limit / 2
    return lateness.verdict is VerdictKind.OK or (lateness.verdict is VerdictKind.FAULT and sharp)


def examine_nothing(limits: Limits) -> Finding:
    """Returns the finding of a window without motion."""
    checks = (UNWEIGHED, *calibration_checks(None, limits), latency_check(None, limits, 0.0), agreement_check(None))
    return Finding(checks)


def _solved(
    window: PathWindow, reference: Calibration, limits: Limits, lag: Latency | None, start: Noise | None
) -> Steps[tuple[Solution | None, Latency | None]]:
    """Returns the solution and the latency that it found; None for each that could not be found."""
    try:
        if lag is not None:
            doubt_s = max(lag.sigma_s, LEFT_OUT[TAU])
            solution, lag_s = yield from _solved_near(window, reference, lag.value_s, doubt_s, start)
            return solution, _solved_latency(solution, lag_s)
        return (yield from _solved_far(window, reference, limits, start))
    except ValueError:
        return None, None


def _solved_far(
    window: PathWindow, reference: Calibration, limits: Limits, start: Noise | None
) -> Steps[tuple[Solution, Latency | None]]:
    """Solves where the paths show no latency: from zero, and from where the reference fits best if that is not zero."""
    solution, _ = yield from _solved_near(window, reference, 0.0, _UNKNOWN_LATENCY_S, start)
    if window.span_ns < _LEAST_FAR_NS:
        return solution, None
    misfits = []
    for lag_s in _LAGS_S:
        yield MISFIT.of(len(window))
        misfits.append(PathFit(window.samples(lag_s), reference, solution.noise).misfit(reference))
    best_s = _LAGS_S[int(np.argmin(misfits))]
    if best_s == 0.0:
        return solution, None
    other, other_s = yield from _solved_near(window, reference, best_s, _UNKNOWN_LATENCY_S, None)
    gain = (solution.misfit - other.misfit) * other.motions
    if gain < _FAR_BETTER or not unchanged(other.change, limits):
        return solution, None
    return other, _solved_latency(other, other_s)


def unchanged(change: Array, limits: Limits) -> bool:
    """Returns whether X is the reference's: then a far latency alone is wrong. change: (n,) θ, of which five count."""
    most = np.minimum(_SAME_X, _SAME_SHARE * limit_of_each(limits)[:5])
    return bool(np.all(np.abs(change[:5]) < most))


def _solved_near(
    window: PathWindow, reference: Calibration, lag_s: float, doubt_s: float, start: Noise | None
) -> Steps[tuple[Solution, float]]:
    """Returns the solution about one latency, and the latency about which it is linear. Solves again where the latency
    was too far off, or a tilt was not observed.
    """
    prior = replace(_NEAR, latency_s=doubt_s)
    yield SAMPLES.of(len(window))
    solution = yield from solving(window.samples(lag_s), reference, prior, start)
    tilted = all(solution.calibration.observed[:2])
    late = abs(float(solution.change[TAU])) > _RELINEARISE_S
    if late or not tilted:
        lag_s += float(solution.change[TAU]) if late else 0.0
        prior = prior if tilted else replace(prior, tilt_rad=_UNSEEN_TILT_RAD)
        solution = yield from solving(window.samples(lag_s), reference, prior, solution.noise)
    return solution, lag_s


def _solved_latency(solution: Solution, lag_s: float) -> Latency | None:
    if not trusted(solution):
        return None
    sigma_s = max(sqrt(float(solution.covariance[TAU, TAU])), LEFT_OUT[TAU])
    return Latency(lag_s + float(solution.change[TAU]), sigma_s)


def _sharper(paths: Latency | None, solved: Latency | None) -> Latency | None:
    """Returns the joint estimate where the paths alone showed nothing, or where it only sharpens what they showed."""
    if solved is None or paths is None:
        return paths or solved
    near = abs(solved.value_s - paths.value_s) < paths.sigma_s
    return solved if near and solved.sigma_s < _SHARPER * paths.sigma_s else paths
