"""Replies → poses: what is new, when it was measured, whether it may be believed, and relative to what."""

import math

from drivers.clock.monotonic_stamps import MonotonicStamps
from drivers.rigid import seen_from
from drivers.samples import Matrix4, Pose, PoseStatus, Stamp
from drivers.trackers.ndi.exchange import Answer
from drivers.trackers.ndi.freshness import Freshness
from drivers.trackers.ndi.negotiation import Agreed
from drivers.trackers.ndi.outlier_gate import OutlierGate
from drivers.trackers.ndi.pose_status import StatusReason
from drivers.trackers.ndi.readings import Reading, Snapshot
from drivers.trackers.ndi.tools import Tool
from drivers.trackers.reference_place import ReferencePlace

_FROZEN = "many poses in a row are equal to the last bit"

_REFERENCE_PERIODS = 3
"""Of the probe's, by which the reference may be older: devices measure up to three kinds of tools in turn. More sets
poses against a reference that has moved, fewer refuses mixed tools."""


class PoseAssembly:
    """reference: poses are relative to it where there is one.

    readings, detailed: the last of each tool, and the last with marker details, by handle. freshness: of the probe.
    device_clock: turns its times into the host's. doubted: poses that had to be confirmed. reference_place: of the
    reference tool in the tracker's frame.
    """

    def __init__(self, probe: Tool, reference: Tool | None, agreed: Agreed, latency_ms: float) -> None:
        self.readings: dict[int, Reading] = {}
        self.detailed: dict[int, Reading] = {}
        self.freshness = Freshness(agreed.tick_ns, agreed.dialect.repeats)
        self.device_clock = agreed.device_clock
        self.doubted = 0
        self.reference_place = ReferencePlace()
        self._leapt_ns: int | None = None
        self._probe, self._reference, self._latency_ns = probe, reference, round(latency_ms * 1e6)
        self._outlier_gates = {tool.handle: OutlierGate() for tool in (probe, reference) if tool is not None}
        self._monotonic = MonotonicStamps()
        self._absent_ns: int | None = None

    def take(self, answer: Answer) -> bool:
        """Whether the reply is believed: no pose that the next one counts on has leapt without being confirmed."""
        tools = answer.snapshot.tools
        if answer.detailed and self._probe.handle in tools:
            self.detailed |= tools
        if not self._believes(answer.snapshot):
            self.doubted += 1
            return False
        self.readings |= tools
        return True

    def measured(self, answer: Answer) -> Stamp | None:
        """When the probe's pose in a reply that was taken was measured; None where it is not a new one."""
        probe = answer.snapshot.tools.get(self._probe.handle)
        absent_ns, self._absent_ns = self._absent_ns, answer.sent_ns
        if probe is None or not self.freshness.is_new(probe, answer.arrival_ns):
            return None
        self.freshness.take(probe, answer.arrival_ns)
        assert probe.tick is not None
        return self.device_clock.stamp(probe.tick, answer.arrival_ns, absent_ns, answer.sent_ns)

    def new_pose(self, measured: Stamp, system: StatusReason) -> Pose:
        """The pose that measured() has found. system: what the device says of itself."""
        probe = self.readings[self._probe.handle]
        stamp = self._monotonic.stamp(measured.t_ns - self._latency_ns, measured.err_ns)
        status_reason = self._pose_status(probe, system)
        rms_mm = probe.transform.error if probe.transform is not None else math.nan
        if status_reason[0] is not PoseStatus.OK:
            return self._without_number(status_reason, stamp, rms_mm)
        return Pose(stamp, self.freshness.frame, self._relative(stamp.t_ns), rms_mm, PoseStatus.OK)

    def overdue_pose(self, answer: Answer) -> Pose | None:
        """Word that a new pose is overdue, once a period; None while it is not. For a reply without a new one."""
        probe = answer.snapshot.tools.get(self._probe.handle)
        self.freshness.is_new(None, answer.arrival_ns)
        reason = self.freshness.overdue(answer.arrival_ns)
        if not reason:
            return None
        absent = probe is not None and probe.tick is None
        status_reason = probe.status_reason if probe is not None and absent else (PoseStatus.STALE, reason)
        return self._without_number(status_reason, self._monotonic.stamp(answer.arrival_ns, 0), math.nan)

    def _believes(self, snapshot: Snapshot) -> bool:
        believed = True
        for handle, watch in self._outlier_gates.items():
            reading, before = snapshot.tools.get(handle), self.readings.get(handle)
            if reading is None or reading.tick is None or reading.transform is None or not reading.usable:
                continue
            if before is None or before.tick != reading.tick:
                t_ns = self.freshness.time_ns(reading)
                if not watch.believes(t_ns, reading.transform):
                    believed = False
                    self._leapt_ns = t_ns if handle == self._probe.handle else self._leapt_ns
        return believed

    def _pose_status(self, probe: Reading, system: StatusReason) -> StatusReason:
        """The worst word of device, probe and reference; the first that objects speaks."""
        if system[0] is not PoseStatus.OK:
            return system
        if probe.status_reason[0] is not PoseStatus.OK:
            return probe.status_reason
        if self.freshness.frozen:
            return PoseStatus.STALE, _FROZEN
        details = self.detailed.get(self._probe.handle)
        if details is not None and details.markers is not None and details.markers.outside:
            return PoseStatus.PARTIAL, f"markers outside the measurement volume: {details.markers.outside}"
        return self._reference_status()

    def _reference_status(self) -> StatusReason:
        """The last word on the reference, which may be a little older where the device measures the tools in turn."""
        if self._reference is None:
            return PoseStatus.OK, ""
        reading = self.readings.get(self._reference.handle)
        if reading is None:
            return PoseStatus.MISSING, "reference tool: nothing heard of it yet"
        apart_ns = _REFERENCE_PERIODS * self.freshness.period_ns
        if reading.tick is not None and abs(self.freshness.time_ns(reading) - self.freshness.device_ns) > apart_ns:
            return PoseStatus.STALE, "the reference tool was measured at another time than the probe"
        if self._leapt_ns is not None and reading.tick is not None:
            since_ns = self._leapt_ns - self.freshness.time_ns(reading)
            if 0 < since_ns <= apart_ns:
                return PoseStatus.STALE, "the reference tool was not measured since the probe leapt"
        status, reason = reading.status_reason
        return status, f"reference tool: {reason}" if reason else ""

    def _relative(self, t_ns: int) -> Matrix4:
        """(4, 4) probe → reference where there is one, else → tracker. t_ns: when the probe was measured."""
        probe = self.readings[self._probe.handle].transform
        assert probe is not None
        if self._reference is None:
            return probe.matrix()
        reference = self.readings[self._reference.handle].transform
        assert reference is not None
        seen = reference.matrix()
        self.reference_place.take(t_ns, seen)
        return seen_from(seen, probe.matrix())

    def _without_number(self, status_reason: StatusReason, stamp: Stamp, rms_mm: float) -> Pose:
        return Pose(stamp, max(self.freshness.frame, 0), None, rms_mm, status_reason[0], status_reason[1])
