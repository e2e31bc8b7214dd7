"""Examines all motion of a session that is kept, for the report at its end. Pure."""

from dataclasses import dataclass
from math import isnan

from probewatch.appliance.core.detectors.calibration_change import latency_check
from probewatch.appliance.core.handeye.second_opinion import SecondOpinion, second_opinion
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.examination import Finding, examine, latency_of
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration, Check


@dataclass(frozen=True, slots=True, eq=False)
class WholeSession:
    """Holds a session to be examined. window: all motion that is kept. valid_ns: time of the last change. about_s:
    latency around which the search is centred.
    """

    window: PathWindow
    reference: Calibration
    limits: Limits
    valid_ns: int
    about_s: float

    def finding(self) -> Finding:
        """Examines the motion since the last change."""
        return examine(self.window.since(self.valid_ns), self.reference, self.limits, about_s=self.about_s)

    def constant_latency(self) -> Check:
        """Returns the tracker's latency from all motion, under the assumption that it has not changed."""
        return latency_of(examine(self.window, self.reference, self.limits, about_s=self.about_s))

    def with_sharper_latency(self, checks: tuple[Check, ...]) -> tuple[Check, ...]:
        """Returns the checks, with the latency of all motion where that has the smaller sigma."""
        latency = latency_check(self.window.latency(self.about_s), self.limits, self.window.stamps_err_s)
        return tuple(_sharper_check(check, latency) if check.name == latency.name else check for check in checks)

    def second_opinion(self) -> SecondOpinion | None:
        """Returns the closed-form estimate from the motion since the last change."""
        window = self.window.since(self.valid_ns)
        latency = window.latency(self.about_s)
        samples = window.samples(0.0 if latency is None else latency.value_s)
        return second_opinion(samples, self.reference)


def whole_session(
    window: PathWindow, reference: Calibration, limits: Limits, valid_ns: int, explained_s: float
) -> WholeSession:
    """Returns the session. Its latency is searched for around the one that explains its latest motion, or else around
    one beyond its limit that all of it shows. explained_s: the former, 0 where none is known.
    """
    far = None if explained_s else window.far_latency()
    within = far is not None and abs(far.value_s) * 1e3 <= limits.latency_ms
    about_s = explained_s if far is None or within else far.value_s
    return WholeSession(window, reference, limits, valid_ns, about_s)


def _sharper_check(check: Check, whole: Check) -> Check:
    """Returns the check with the smaller sigma of two checks of one quantity; a NaN sigma counts as the larger."""
    return whole if isnan(check.sigma) or whole.sigma < check.sigma else check
