"""What the last seconds of motion show of the calibration: latency first, then polarity, then every parameter of X."""

from dataclasses import dataclass, replace
from math import nan, sqrt

from appliance.latency import Latency
from appliance.limits import Limits
from appliance.path import PathWindow
from appliance.solver import TAU, Prior, Solution, solve
from appliance.types import Calibration, Check, VerdictKind
from appliance.watchers.calibration_change import agreement_check, calibration_checks, latency_check, trusted
from appliance.watchers.polarity import flipped, weigh_polarity

_SHORT_NS = 3_500_000_000
_LONG_NS = 10_000_000_000
_UNKNOWN_LATENCY_S = 0.05
_RELINEARISE_S = 0.008
_CONTRADICTION = 2.0
_LEAST_LATENCY_SIGMA_S = 0.005
_UNSEEN_TILT_RAD = 0.02
"""A tilt that no motion shows is held near the reference: left free, noise tilts it, and its cosine shrinks the scales.
"""
_NEAR = Prior(tilt_rad=0.2, rotation_rad=0.2, scale=0.15, offset_mm=10.0)
_REQUIRED_FOR = {
    "polarity": ("polarity",),
    "scale": ("scale-lateral", "scale-axial"),
    "rotation": ("rotation-lateral", "rotation-axial", "rotation-elevational"),
}
_SLOW = frozenset({"rotation-lateral", "rotation-axial", "offset-lateral", "offset-axial", "offset-elevational"})
"""Shown only by tilt and turn, of which a few seconds hold too little to decide."""
_UNWEIGHED = Check("polarity", "polarity", nan, 0.0, "axes", 0.5, VerdictKind.NOT_VERIFIED)


@dataclass(frozen=True, slots=True, eq=False)
class Finding:
    """What one window showed."""

    checks: tuple[Check, ...]
    solution: Solution | None = None

    @property
    def failed(self) -> frozenset[str]:
        """Names of the checks that are shown to be outside their limit."""
        return frozenset(check.name for check in self.checks if check.verdict is VerdictKind.FAULT)

    @property
    def shown(self) -> int:
        """Number of checks that are decided either way."""
        return sum(check.verdict is not VerdictKind.NOT_VERIFIED for check in self.checks)


class Evidence:
    """Solves the window anew whenever asked; between two solutions the last one stands.

    A short window sees a change soon, the long one measures well. Once the short one shows a fault, what came before it
    is dropped, so that old and new calibration are never mixed into one estimate. A fault counts when two solutions in
    a row show it.
    """

    def __init__(self, reference: Calibration, limits: Limits, window: PathWindow) -> None:
        self._reference = reference
        self._limits = limits
        self.window = window
        self._nothing = examine_nothing(limits)
        self._latest = self._best = self._nothing
        self._suspects: frozenset[str] = frozenset()
        self._trimmed = False

    @property
    def estimate(self) -> Calibration | None:
        """The solution that showed most, None where there was none."""
        return None if self._best.solution is None else self._best.solution.calibration

    @property
    def motions(self) -> int:
        """Pictures that went into the estimate."""
        return 0 if self._best.solution is None else self._best.solution.motions

    def restart(self) -> None:
        """The geometry has changed: what was measured before says nothing of what comes."""
        self.window.restart()
        self._latest = self._nothing
        self._suspects = frozenset()
        self._trimmed = False

    def checks(self) -> tuple[Check, ...]:
        """Checks of the latest solution."""
        return self._latest.checks

    def shows(self, fault: str) -> bool:
        """True where the latest solution verified every parameter of that class."""
        good = {check.name for check in self._latest.checks if check.verdict is VerdictKind.OK}
        return good.issuperset(_REQUIRED_FOR[fault])

    def final(self) -> tuple[Check, ...]:
        """Checks of the solution that showed most, the one over everything remembered among them."""
        whole = examine(self.window, self._reference, self._limits)
        if whole.shown >= self._best.shown and whole.failed <= self._latest.failed:
            self._best = whole
        return self._best.checks

    def solve(self) -> None:
        """Examine the short window for a change, drop what came before one, and examine what is left."""
        short = _without(examine(self.window.recent(_SHORT_NS), self._reference, self._limits), _SLOW)
        if short.failed & self._suspects and not self._trimmed:
            self.window.keep_last(_SHORT_NS)
            self._trimmed = True
        finding = examine(self.window.recent(_LONG_NS), self._reference, self._limits)
        self._trimmed = self._trimmed and bool(finding.failed)
        self._latest = _without(finding, finding.failed - self._suspects)
        self._suspects = finding.failed | short.failed
        if self._latest.shown >= self._best.shown:
            self._best = self._latest


def examine(window: PathWindow, reference: Calibration, limits: Limits) -> Finding:
    """Latency from the two paths, polarity by likelihood, X by maximum likelihood on the in-plane motion."""
    lag = window.latency()
    lag_s = 0.0 if lag is None else lag.value_s
    try:
        polarity, polarity_check = weigh_polarity(window.samples(lag_s, in_plane_only=False), reference)
    except ValueError:
        return examine_nothing(limits)
    solution, solved_lag = _solved(window, flipped(reference, polarity), lag)
    checks = (
        polarity_check,
        *calibration_checks(solution, limits),
        latency_check(_sharper(lag, solved_lag), limits),
        agreement_check(solution),
    )
    return Finding(checks, solution)


def _without(finding: Finding, names: frozenset[str]) -> Finding:
    """The finding with the named checks left undecided."""
    checks = (
        replace(check, verdict=VerdictKind.NOT_VERIFIED) if check.name in names else check for check in finding.checks
    )
    return Finding(tuple(checks), finding.solution)


def examine_nothing(limits: Limits) -> Finding:
    """The finding of a window without motion."""
    checks = (_UNWEIGHED, *calibration_checks(None, limits), latency_check(None, limits), agreement_check(None))
    return Finding(checks)


def _solved(window: PathWindow, reference: Calibration, lag: Latency | None) -> tuple[Solution | None, Latency | None]:
    """Solution and the latency it found, solved anew where the first solution asks for it."""
    lag_s = 0.0 if lag is None else lag.value_s
    prior = replace(_NEAR, latency_s=_UNKNOWN_LATENCY_S if lag is None else max(lag.sigma_s, 0.005))
    try:
        solution = solve(window.samples(lag_s, in_plane_only=True), reference, prior)
        tilted = all(solution.calibration.observed[:2])
        late = abs(float(solution.change[TAU])) > _RELINEARISE_S
        if late or not tilted:
            lag_s += float(solution.change[TAU]) if late else 0.0
            prior = prior if tilted else replace(prior, tilt_rad=_UNSEEN_TILT_RAD)
            solution = solve(window.samples(lag_s, in_plane_only=True), reference, prior)
    except ValueError:
        return None, None
    if not trusted(solution):
        return solution, None
    sigma_s = max(sqrt(float(solution.covariance[TAU, TAU])), _LEAST_LATENCY_SIGMA_S)
    return solution, Latency(lag_s + float(solution.change[TAU]), sigma_s)


def _sharper(paths: Latency | None, solved: Latency | None) -> Latency | None:
    """The joint estimate where it is sharper than what the paths alone told, and no contradiction to it."""
    if solved is None or paths is None:
        return paths or (solved if solved is not None and solved.sigma_s < _UNKNOWN_LATENCY_S / 4 else None)
    doubt_s = sqrt(solved.sigma_s**2 + paths.sigma_s**2)
    agree = abs(solved.value_s - paths.value_s) < _CONTRADICTION * doubt_s
    return solved if agree and solved.sigma_s < 0.5 * paths.sigma_s else paths
