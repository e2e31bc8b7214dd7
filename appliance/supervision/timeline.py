"""Runs the supervisor over a recording: the states that a room would have seen. Pure: time is that of the samples."""

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np

from probewatch.appliance.core.quality.report import Change, LineReport
from probewatch.appliance.limits import Limits
from probewatch.appliance.supervision.device_health import DeviceHealth, Timeouts
from probewatch.appliance.supervision.device_watchers import watch_devices
from probewatch.appliance.supervision.recorded_gaps import RecordedGaps
from probewatch.appliance.supervision.supervisor import TICK_NS, Durations, Inputs, Supervisor
from probewatch.appliance.supervision.turns import Turns
from probewatch.appliance.types import Check, Fault, Verdict, VerdictKind
from probewatch.drivers.samples import Frame, Sample

_LONGEST_GAP, _SHORT_GAP = 900_000_000_000 // TICK_NS, 10_000_000_000 // TICK_NS
"""Ticks without a sample. Beyond the first number nothing changes any more, as no duration that a configuration may
name is longer: the rest is skipped. Up to the second, each gap is ticked through, whatever _MOST_IDLE is.
"""

_MOST_IDLE = 86_400_000_000_000 // TICK_NS
"""Ticks without a sample in a recording beyond short gaps, a day, which take a minute or two: stamps may leap by years
with every sample. Fewer show less exactly when a state changed in long gaps, more take longer for a hostile file.
"""

NEAREST_MM = 5.0
"""mm, how close a marker body may come to the origin of the tracker, or of another body, in the whole of a recording:
both are larger than that. More asks about healthy recordings whether they are in mm; less misses a large volume in
metres, whose poses of 2 m look like 2 mm.
"""
_NO_POSE = "no picture has a pose"
_NO_PICTURE = "there are no pictures, without which motion shows nothing"
_MOST_REASONS = 8
"""Number of the most frequent reasons for unusable poses. More are not read: some contain a number each."""


@dataclass(frozen=True, slots=True)
class Judging:
    """Holds how strictly and how soon a cart's configuration judges; the default is that of the shipped one."""

    limits: Limits = field(default_factory=Limits)
    durations: Durations = field(default_factory=Durations)
    timeouts: Timeouts = field(default_factory=Timeouts)


class Timeline:
    """Ticks the supervisor at its usual rate between start_ns and end_ns, while both devices were recorded.

    origin_ns: time that t_s counts from. All times are ns of the recording's clock. judging: as the cart's
    configuration defines it. injected: faults of devices that were lost on purpose; other silences are gaps of the
    recording.
    """

    def __init__(
        self,
        origin_ns: int,
        start_ns: int,
        end_ns: int,
        judging: Judging | None = None,
        injected: Collection[Fault] = (),
    ) -> None:
        judging = judging or Judging()
        self._origin_ns, self._end_ns = origin_ns, end_ns
        self._next_ns, self._idle_left = start_ns, _MOST_IDLE
        self._health = DeviceHealth(started_ns=start_ns)
        self._verdicts: list[Verdict] = []
        self._supervisor = Supervisor(judging.durations)
        self._timeouts, self._limits = judging.timeouts, judging.limits
        self._gaps = RecordedGaps(origin_ns, judging.timeouts, injected)
        self._turns = Turns()
        self._unusable = Counter[str]()
        self._furthest_mm: float | None = None
        self.devices: tuple[Check, ...] = ()
        self.changes: list[Change] = []

    def step(self, sample: Sample, verdicts: tuple[Verdict, ...]) -> None:
        """Takes the next sample, in time order, and the line's verdicts on it."""
        self._tick_until(sample.stamp.t_ns)
        self._health = _noted(self._health, sample)
        self._gaps.note(sample)
        self._verdicts += verdicts
        if isinstance(sample, Frame):
            return
        if sample.matrix is None:
            self._unusable[sample.reason or sample.status.value] += 1
        else:
            self._furthest_mm = max(self._furthest_mm or 0.0, float(np.linalg.norm(sample.matrix[:3, 3])))

    def finish(self) -> None:
        """Ticks to the end, also where the samples stopped before it."""
        self._tick_until(self._end_ns + 1)
        self._gaps.finish(self._end_ns)
        self.changes = self._gaps.told(self.changes)

    def completed(self, report: LineReport) -> LineReport:
        """Returns the line's report after finish(), with what the line does not see: why poses could not be used,
        whether they seem to be in metres, and a device that was failing at the end. That device determines the verdict
        unless the line shows a fault of its own.
        """
        report = self._with_unit(self._with_reasons(report))
        failing = self.lasting_fault()
        if failing is None:
            return report
        verdict = report.verdict
        if verdict.kind is not VerdictKind.FAULT:
            reason = self.changes[-1].reason
            verdict = Verdict(verdict.t_ns, VerdictKind.FAULT, (*verdict.checks, failing), failing.fault, reason)
        return replace(report, checks=(*report.checks, failing), verdict=verdict)

    def lasting_fault(self) -> Check | None:
        """Returns the check of a device that was failing when the recording ended, None if all were well."""
        return next((check for check in self.devices if check.verdict is VerdictKind.FAULT), None)

    def _with_unit(self, report: LineReport) -> LineReport:
        """Adds the question whether poses that all lie near the origin are in mm. Poses that verified something are."""
        far = self._furthest_mm is None or self._furthest_mm > NEAREST_MM
        if far or report.verdict.kind is VerdictKind.OK:
            return report
        asked = f"all poses lie within {self._furthest_mm:.2g} mm of the origin: are they in mm?"
        return replace(report, verdict=replace(report.verdict, reason=f"{report.verdict.reason}; {asked}"))

    def _with_reasons(self, report: LineReport) -> LineReport:
        """Gives as the reason that most pictures have no pose, where that is so, and not which motion was missing."""
        report = replace(report, unusable=dict(self._unusable.most_common(_MOST_REASONS)))
        why = next(iter(report.unusable), "") or max(report.unpaired, key=report.unpaired.__getitem__, default="")
        if not report.frames and report.verdict.kind is VerdictKind.NOT_VERIFIED:
            return replace(report, verdict=replace(report.verdict, reason=_NO_PICTURE))
        few = 2 * report.paired < report.frames
        if not few or not why or report.verdict.kind is not VerdictKind.NOT_VERIFIED:
            return report
        have = f"only {report.paired} of {report.frames} pictures have a pose" if report.paired else _NO_POSE
        reason = f"{have}: {why}"
        return replace(report, verdict=replace(report.verdict, reason=reason))

    def _tick_until(self, t_ns: int) -> None:
        """Ticks up to t_ns; in a long gap, at its beginning and once at its end."""
        until_ns = min(t_ns, self._end_ns + 1)
        ticks = max(0, -((self._next_ns - until_ns) // TICK_NS))
        ticked = min(ticks, _LONGEST_GAP, _SHORT_GAP + self._idle_left)
        self._idle_left -= max(0, ticked - _SHORT_GAP)
        for _ in range(ticked - 1):
            self._tick(self._next_ns)
            self._next_ns += TICK_NS
        if ticks:
            self._next_ns += (ticks - ticked) * TICK_NS
            self._tick(self._next_ns)
            self._next_ns += TICK_NS

    def _tick(self, now_ns: int) -> None:
        """Performs one tick. A recording has no estimator process and no outputs to lose: both count as just seen."""
        health = replace(self._health, heartbeat_ns=now_ns, output_ns=now_ns)
        self.devices = watch_devices(now_ns, health, self._timeouts, self._limits)
        state = self._supervisor.step(now_ns, Inputs(tuple(self._verdicts), self.devices))
        self._verdicts.clear()
        if self._turns.begins(state.state, state.fault, state.reason):
            t_s = (now_ns - self._origin_ns) / 1e9
            self.changes.append(Change(t_s, state.state, state.fault, state.reason))


def _noted(health: DeviceHealth, sample: Sample) -> DeviceHealth:
    t_ns = sample.stamp.t_ns
    if isinstance(sample, Frame):
        return replace(health, frame_ns=t_ns)
    return replace(health, replies=health.replies.noted(sample.status, t_ns))
