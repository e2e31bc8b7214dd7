"""What the last seconds of motion show of the calibration: latency first, then polarity, then every parameter of X."""

from appliance.latency import Latency
from appliance.limits import Limits
from appliance.path import PathWindow
from appliance.solver import Prior, Solution, solve
from appliance.types import Calibration, Check, VerdictKind
from appliance.watchers.calibration_change import agreement_check, calibration_checks, latency_check
from appliance.watchers.polarity import flipped, weigh_polarity

_UNKNOWN_LATENCY_S = 0.05
_NEAR = Prior(rotation_rad=0.2, scale=0.15, offset_mm=10.0)
_REQUIRED_FOR = {
    "polarity": ("polarity",),
    "scale": ("scale-lateral", "scale-axial"),
    "rotation": ("rotation-lateral", "rotation-axial", "rotation-elevational"),
}


class Evidence:
    """Solves the window anew whenever asked; between two solutions the last one stands."""

    def __init__(self, reference: Calibration, limits: Limits, window: PathWindow) -> None:
        self._reference = reference
        self._limits = limits
        self.window = window
        self._latency: Latency | None = None
        self._solution: Solution | None = None
        self._checks: tuple[Check, ...] = ()
        self._best: tuple[int, tuple[Check, ...], Solution | None] = (-1, (), None)
        self.restart()

    @property
    def estimate(self) -> Calibration | None:
        """The solution that showed most, None where there was none."""
        return None if self._best[2] is None else self._best[2].calibration

    @property
    def motions(self) -> int:
        """Pictures that went into the estimate."""
        return 0 if self._best[2] is None else self._best[2].motions

    def restart(self) -> None:
        """The geometry has changed: what was measured before says nothing of what comes."""
        self.window.restart()
        self._latency = self._solution = None
        self._checks = self._all_checks(
            Check("polarity", "polarity", float("nan"), 0.0, "axes", 0.5, VerdictKind.NOT_VERIFIED)
        )

    def checks(self) -> tuple[Check, ...]:
        """Checks of the latest solution."""
        return self._checks

    def shows(self, fault: str) -> bool:
        """True where the latest solution verified every parameter of that class."""
        good = {check.name for check in self._checks if check.verdict is VerdictKind.OK}
        return good.issuperset(_REQUIRED_FOR[fault])

    def final(self) -> tuple[Check, ...]:
        """Checks of the solution that showed most, after solving once more."""
        self.solve()
        return self._best[1] or self._checks

    def solve(self) -> None:
        """Latency from the two paths, polarity by likelihood, X by maximum likelihood on the in-plane part of the
        motion.
        """
        self._latency = self.window.latency()
        lag_s = 0.0 if self._latency is None else self._latency.value_s
        doubt_s = _UNKNOWN_LATENCY_S if self._latency is None else self._latency.sigma_s
        try:
            polarity, polarity_check = weigh_polarity(self.window.samples(lag_s, in_plane_only=False), self._reference)
        except ValueError:
            return
        self._solution = self._solved(lag_s, doubt_s, polarity)
        self._checks = self._all_checks(polarity_check)
        shown = sum(check.verdict is not VerdictKind.NOT_VERIFIED for check in self._checks)
        if shown >= self._best[0]:
            self._best = (shown, self._checks, self._solution)

    def _solved(self, lag_s: float, doubt_s: float, polarity: tuple[int, int]) -> Solution | None:
        prior = Prior(_NEAR.rotation_rad, _NEAR.scale, _NEAR.offset_mm, latency_s=max(doubt_s, 0.002))
        try:
            return solve(self.window.samples(lag_s, in_plane_only=True), flipped(self._reference, polarity), prior)
        except ValueError:
            return None

    def _all_checks(self, polarity: Check) -> tuple[Check, ...]:
        return (
            polarity,
            *calibration_checks(self._solution, self._limits),
            latency_check(self._latency, self._limits),
            agreement_check(self._solution),
        )
