"""Examines windows in context: noise learned earlier, a latency far beyond its limit, and a drifting latency."""

from probewatch.appliance.core.detectors.calibration_change import latency_check
from probewatch.appliance.core.parameters import BREATHED
from probewatch.appliance.core.path.conventions import Convention
from probewatch.appliance.core.path.explanation import Explanation, explain, recent_lag
from probewatch.appliance.core.path.latency import Latency
from probewatch.appliance.core.path.latency_drift import LatencyDrift
from probewatch.appliance.core.path.noise import Noise
from probewatch.appliance.core.path.window import PathWindow
from probewatch.appliance.core.quality.examination import Finding, agreed, examining, latency_of, without
from probewatch.appliance.core.quality.noise_memory import NoiseMemory
from probewatch.appliance.core.spread_work import Steps
from probewatch.appliance.core.times import SELDOM_NS
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import Calibration, Fault, VerdictKind

_EXPLAINED_NS = 6_000_000_000
"""Length, ns, of the motion for which another explanation is searched where the reference does not explain it. Each
search takes 2 ms, or 7 ms where not even a lag explains the motion. A longer window names later what has just begun; a
shorter one leaves little motion to a lag whose poses are yet to come."""
_SURELY_LATE_S, _OTHER_LAG_S = 0.02, 0.05
"""s: how far beyond its limit a lag of the last second must be to count at once, and how far from the known lag. Less
takes a slow drift, which is followed elsewhere, for a new lag at each solution; more leaves it to windows of 3.5 s,
which name it two seconds later."""


class Examiner:
    """Examines windows of motion. `noises` holds the noise learned so far. `about_s` is the latency around which the
    search is centred; 0 where none beyond the limit is known. `explanation` is the latest one of motion that
    contradicts the reference; None where there was none since a change.
    """

    def __init__(self, reference: Calibration, limits: Limits) -> None:
        self._reference, self._limits = reference, limits
        self.noises = NoiseMemory()
        self.about_s = 0.0
        self.explanation: Explanation | None = None
        self._explained_ns = 0
        self._drift = LatencyDrift()
        self._drifted: Latency | None = None

    def forget_lag(self) -> None:
        """Discards the explanation by a far lag, because the geometry may have changed."""
        self.about_s, self.explanation = 0.0, None

    def forget_drift(self) -> None:
        """Discards the drift of the latency."""
        self._drift.clear()
        self._drifted = None

    def search_again(self) -> None:
        """Has the next unexplained motion searched for a lag at once, because some motion had wrong timestamps."""
        self._explained_ns = 0

    def examined(self, window: PathWindow, start: Noise | None) -> Steps[Finding]:
        """Returns the finding of the window; until breathing is learned, a wrong axial scale is a contradiction but is
        not named.
        """
        finding = yield from examining(window, self._reference, self._limits, start, self.about_s)
        finding = finding if self.noises.breathing_known else without(finding, BREATHED & finding.failed)
        return self._with_drift(finding, window)

    def look(
        self, remembered: PathWindow, recent: PathWindow, valid_ns: int, before_ns: int, now_ns: int
    ) -> Steps[Finding]:
        """Returns the finding of the recent window, with the noise learned before `before_ns`. Where the motion stays
        unexplained, searches for an explanation, and examines the window again if that moves the latency.

        `remembered` is all motion that is kept. `valid_ns` is the time of the last change; older motion explains
        nothing.
        """
        finding = yield from self.examined(recent, self.noises.for_window(recent, before_ns))
        # Motion shorter than the search window grows much with each solution, so each of them searches.
        every_ns = 0 if remembered.span_ns < _EXPLAINED_NS else SELDOM_NS
        if not _explained(finding) and not 0 <= now_ns - self._explained_ns < every_ns:
            about_s = self.about_s
            yield from self._explain(remembered.since(max(valid_ns, now_ns - _EXPLAINED_NS)), now_ns)
            if self.about_s != about_s:
                finding = yield from self.examined(recent, self.noises.for_window(recent, before_ns))
        return self._carried_on(finding, recent, now_ns)

    def new_lag(self, remembered: PathWindow, now_ns: int) -> Steps[int | None]:
        """Returns the time since which a latency explains the motion that has just begun; None where none does."""
        beyond_s = self._limits.latency_ms / 1e3 + _SURELY_LATE_S
        found = yield from recent_lag(remembered, self._reference, beyond_s)
        if found is None or abs(found[1].latency_s - self.about_s) <= _OTHER_LAG_S:
            return None
        since_ns, self.explanation = found
        self.about_s, self._explained_ns = self.explanation.latency_s, now_ns
        return since_ns

    def _explain(self, window: PathWindow, now_ns: int) -> Steps[None]:
        """Searches for another explanation; the fine search stays centred on a latency beyond its limit until a
        different one is found.
        """
        self._explained_ns = now_ns
        found = yield from explain(window, self._reference)
        if found is None:
            return
        self.explanation = found
        late = found.convention is Convention.AGREED and abs(found.latency_s) * 1e3 > self._limits.latency_ms
        self.about_s = found.latency_s if late else 0.0

    def _carried_on(self, finding: Finding, recent: PathWindow, now_ns: int) -> Finding:
        """Records the latency that the short window shows at its middle, and updates its drift."""
        check = latency_of(finding)
        if agreed(finding) and check.shown_ns is not None:
            middle_ns = (recent.start_ns + recent.now_ns) // 2
            self._drift.note(middle_ns, Latency(check.value / 1e3, check.sigma / 1e3))
        self._drifted = self._drift.carried_to(now_ns)
        return self._with_drift(finding, recent)

    def _with_drift(self, finding: Finding, window: PathWindow) -> Finding:
        """Withholds the OK of a latency that has, or may have, drifted beyond its limit by now."""
        check = latency_of(finding)
        if self._drifted is None or not agreed(finding) or check.verdict is VerdictKind.FAULT:
            return finding
        now = latency_check(self._drifted, self._limits, window.stamps_err_s, check.shown_ns)
        if now.verdict is VerdictKind.OK or abs(now.value) < abs(check.value):
            return finding
        checks = (
            now if one.name == now.name else one for one in without(finding, finding.failed - {"polarity"}).checks
        )
        return Finding(tuple(checks), finding.solution)


def _explained(finding: Finding) -> bool:
    """Returns whether the reference with a known latency explains the motion: a wrong polarity can look like a latency,
    and like swapped axes of the sensor.
    """
    needed = {Fault.AGREEMENT, Fault.POLARITY, Fault.LATENCY}
    return needed <= {check.fault for check in finding.checks if check.verdict is VerdictKind.OK}
