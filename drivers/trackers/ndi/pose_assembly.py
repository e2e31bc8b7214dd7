"""Turns replies into poses: what is new, when it was measured, whether it may be trusted, and to what it is
relative.
"""

import math
from dataclasses import dataclass

from probewatch.drivers.clock.monotonic_stamps import MonotonicStamps
from probewatch.drivers.rigid import seen_from
from probewatch.drivers.samples import Matrix4, Pose, PoseStatus, Stamp
from probewatch.drivers.trackers.ndi.exchange import Answer
from probewatch.drivers.trackers.ndi.freshness import Freshness
from probewatch.drivers.trackers.ndi.negotiation import Agreed
from probewatch.drivers.trackers.ndi.outlier_gate import OutlierGate
from probewatch.drivers.trackers.ndi.pose_status import StatusReason
from probewatch.drivers.trackers.ndi.readings import Reading, Snapshot
from probewatch.drivers.trackers.ndi.tools import Tool
from probewatch.drivers.trackers.reference_place import ReferencePlace
from probewatch.drivers.trackers.witness import WitnessSight

_FROZEN = "many poses in a row are equal to the last bit"

_REFERENCE_PERIODS = 3
"""Periods of the probe by which the reference may be older: devices measure up to three kinds of tools in turn. More
sets poses against a reference that has moved; fewer refuses mixed tools.
"""


@dataclass(frozen=True, slots=True)
class Bodies:
    """Holds the tools in use. reference: poses are relative to it where there is one. witness: a second tool on the
    probe. sight: tracks whether the witness is seen.
    """

    probe: Tool
    reference: Tool | None = None
    witness: Tool | None = None
    sight: WitnessSight | None = None


class PoseAssembly:
    """Assembles the poses of one device.

    readings, detailed: the last reading of each tool, and the last with marker details, by handle. freshness: that of
    the probe. device_clock: converts device times to host times. doubted: count of poses that had to be confirmed.
    reference_place: that of the reference tool in the tracker's frame.
    """

    def __init__(self, bodies: Bodies, agreed: Agreed, latency_ms: float) -> None:
        self.readings: dict[int, Reading] = {}
        self.detailed: dict[int, Reading] = {}
        self.freshness = Freshness(agreed.tick_ns, agreed.dialect.repeats)
        self.device_clock = agreed.device_clock
        self.doubted = 0
        self.reference_place = ReferencePlace()
        self._leapt_ns: int | None = None
        self._probe, self._reference, self._latency_ns = bodies.probe, bodies.reference, round(latency_ms * 1e6)
        self._witness, self._sight = bodies.witness, bodies.sight
        gated = (bodies.probe, bodies.reference)
        self._outlier_gates = {tool.handle: OutlierGate() for tool in gated if tool is not None}
        self._monotonic = MonotonicStamps()
        self._absent_ns: int | None = None

    def take(self, answer: Answer) -> bool:
        """Records a reply, and returns whether it is trusted: no pose of the probe or the reference in it leapt and is
        still to be confirmed.
        """
        tools = answer.snapshot.tools
        if answer.detailed and self._probe.handle in tools:
            self.detailed |= tools
        if not self._believes(answer.snapshot):
            self.doubted += 1
            return False
        self.readings |= tools
        return True

    def measured(self, answer: Answer) -> Stamp | None:
        """Returns when the probe's pose in a reply that was taken was measured; None where it is not a new one."""
        probe = answer.snapshot.tools.get(self._probe.handle)
        absent_ns, self._absent_ns = self._absent_ns, answer.sent_ns
        if probe is None or not self.freshness.is_new(probe, answer.arrival_ns):
            return None
        self.freshness.take(probe, answer.arrival_ns)
        assert probe.tick is not None
        return self.device_clock.stamp(probe.tick, answer.arrival_ns, absent_ns, answer.sent_ns)

    def new_pose(self, measured: Stamp, system: StatusReason) -> Pose:
        """Returns the pose that measured() has found. system: what the device reports about itself."""
        probe = self.readings[self._probe.handle]
        stamp = self._monotonic.stamp(measured.t_ns - self._latency_ns, measured.err_ns)
        status_reason = self._pose_status(probe, system)
        rms_mm = probe.transform.error if probe.transform is not None else math.nan
        if status_reason[0] is not PoseStatus.OK:
            return self._without_number(status_reason, stamp, rms_mm)
        assert probe.transform is not None
        matrix = probe.transform.matrix()
        witness = self._witnessed(probe, matrix, stamp.t_ns)
        if self._reference is not None:
            reference = self.readings[self._reference.handle].transform
            assert reference is not None
            seen = reference.matrix()
            self.reference_place.take(stamp.t_ns, seen)
            matrix = seen_from(seen, matrix)
            witness = None if witness is None else seen_from(seen, witness)
        return Pose(stamp, self.freshness.frame, matrix, rms_mm, PoseStatus.OK, witness=witness)

    def remarks(self, now_ns: int) -> tuple[str, ...]:
        """Returns what a person should know about the reference and the second body, in words."""
        sight = () if self._sight is None else self._sight.remarks(now_ns)
        return (*self.reference_place.remarks(now_ns), *sight)

    def overdue_pose(self, answer: Answer) -> Pose | None:
        """Returns a pose that reports, once a period, that a new one is overdue; None while none is. It is for a reply
        without a new pose.
        """
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
        """Returns the first objection of device, probe and reference, in that order; (OK, "") if there is none."""
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
        """Returns the last status of the reference, which may be slightly older if tools are measured in turn."""
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

    def _witnessed(self, probe: Reading, matrix: Matrix4, t_ns: int) -> Matrix4 | None:
        """Returns (4, 4) second body → tracker; None where it was not seen, or was measured at another time than the
        probe, since a hand moves on meanwhile.
        """
        if self._witness is None or self._sight is None:
            return None
        reading = self.readings.get(self._witness.handle)
        together = reading is not None and reading.usable and reading.tick == probe.tick
        transform = reading.transform if reading is not None and together else None
        return self._sight.take(t_ns, matrix, None if transform is None else transform.matrix())

    def _without_number(self, status_reason: StatusReason, stamp: Stamp, rms_mm: float) -> Pose:
        return Pose(stamp, max(self.freshness.frame, 0), None, rms_mm, status_reason[0], status_reason[1])
