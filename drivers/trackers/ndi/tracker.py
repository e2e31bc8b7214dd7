"""`ndi:/dev/ttyUSB0?probe=FILE.rom&reference=FILE.rom`: poses of a Polaris, Vega or Aurora; `ndi+tcp://` likewise.

Options of the URL:
    probe, reference: the tools, each as FILE.rom (wireless, loaded from its definition), @2 (on plug 2), @2b (second
        sensor on plug 2), or FILE.rom@2 (on plug 2, without a memory of its own). Without probe the first wired tool
        of six degrees of freedom. With reference all poses are relative to it.
    tools: further tools, separated by commas; their poses are in `telemetry`.
    baud: line speed, 115200 unless given. reply: bx2, bx or tx, if the firmware's own choice shall not hold.
    counter_hz: rate of the frame counter, if the device's own shall not hold.
    deadline_ms: silence after which the tracker counts as lost, 200. latency_ms: exposure to first byte of the reply,
        as measured on this unit, 0. log: file for a byte log.
"""

import math
import random
from types import TracebackType
from typing import Self

from drivers.clock.counter_clock import CounterClock, DeviceClock
from drivers.clock.host_clock import HostClock
from drivers.clock.monotonic_stamps import MonotonicStamps
from drivers.device_api import Description
from drivers.errors import ConfigurationError, DeviceLost, ProtocolError
from drivers.io.byte_log import ByteLog
from drivers.samples import MarkerBody, Matrix4, Pose, PoseStatus, Stamp
from drivers.trackers.ndi.counter_rate import frame_counter_hz
from drivers.trackers.ndi.exchange import Answer, Exchange
from drivers.trackers.ndi.freshness import Freshness
from drivers.trackers.ndi.health import HealthWatch
from drivers.trackers.ndi.identity import ReplyKind
from drivers.trackers.ndi.link import Link, SilentError, lost_by_protocol
from drivers.trackers.ndi.marker_quality import MarkerQuality, worst
from drivers.trackers.ndi.options import TrackerOptions, parse_options
from drivers.trackers.ndi.outlier_gate import OutlierGate
from drivers.trackers.ndi.pose_status import StatusReason
from drivers.trackers.ndi.readings import Reading, Snapshot, dialect
from drivers.trackers.ndi.session import Session
from drivers.trackers.ndi.status_text import BUMPED
from drivers.trackers.ndi.telemetry import NdiTelemetry, describe, tool_telemetry
from drivers.trackers.ndi.tools import Tool, choose_probe
from drivers.trackers.ndi.transport import ByteLine, SerialLine
from drivers.trackers.ndi.wire import RefusedError
from drivers.trackers.rigid import seen_from

_FROZEN = "many poses in a row are equal to the last bit"

_BACKWARD_READINGS = 3
"""Replies in a row with a counter that runs backward that mean a counter started again. Fewer take an old reply come
late for one, each more costs a reply without a pose; tests/drivers/trackers/ndi/test_tracker.py shows both."""

_DETAILS_S = 0.1
"""Between two replies with marker details, which are over twice as long: ten of them in the second over which the
marker checks take the middle (docs/trackers.md). More cost poses on a slow line, fewer leave that middle to chance."""

_RETRY_NS = 1_000_000
"""Pause before the next request where nothing new was there. Less loads the processor
(tests/live/test_tracker_load.py), more delays poses.
"""

_LEAST_RETRIES = 4
"""Requests that fit a period at least, where that is short: at 400 Hz one in 0.6 ms. More load the processor, fewer
delay poses by up to a period. tests/live/test_tracker_load.py measures the load at 400 Hz."""

_EARLY_PART = 3
"""Part of a period, as 1 to this, by which a request may come early, and which a reply may fill without making early
requests rare. More room asks in vain more often, less leaves the bound of the device's clock wider. Not measured."""

_RISKED = 0.1
"""Share of early requests where a reply fills over a third of the period. Each may cost a pose; with none of them
nothing bounds the device's clock from below. Not measured."""

_REFERENCE_PERIODS = 3
"""Of the probe's, by which the reference may be older: devices measure up to three kinds of tools in turn. More sets
poses against a reference that has moved, fewer refuses mixed tools."""

_REPLY_BYTES = 50
"""First guess at the part of a reply that belongs to no tool: frame and status, and strays, 12 bytes each. Longer ones
are noted when they come (Exchange)."""

_SHARE_OF_DEADLINE = 0.5
"""For one question about alerts, so that a tracking reply still fits before the deadline. More loses the device with
the question, less gives slow replies up."""

_UNANSWERED = 3
"""Such questions in a row without an answer that lose the tracker: what it does not tell may be grave. Fewer lose it
for two damaged replies (tests/drivers/trackers/ndi/test_tracker.py), each more leaves an unknown alert half a deadline
longer.
"""


def open_tracker(target: str, options: dict[str, str], clock: HostClock) -> "NdiTracker":
    """Connect, load the tools and start tracking; see drivers.registry for what is raised."""
    wanted = checked(target, options)
    return connect(SerialLine(target), f"ndi:{target}", wanted, clock)


def checked(target: str, options: dict[str, str]) -> TrackerOptions:
    """Raises ConfigurationError naming the option that is unknown or out of range."""
    return parse_options(options, f"ndi:{target}")


def connect(line: ByteLine, url: str, options: TrackerOptions, clock: HostClock) -> "NdiTracker":
    """Take the line over, whatever comes of it. Raises DeviceLost, ConfigurationError."""
    try:
        byte_log = None if options.log is None else ByteLog(options.log, url, clock)
    except ConfigurationError:
        line.close()
        raise
    return NdiTracker(Link(line, clock, byte_log), options, clock)


class NdiTracker:
    """One tracking device, tracking from construction until the context is left; then as a fresh program expects it."""

    def __init__(self, link: Link, options: TrackerOptions, clock: HostClock) -> None:
        self._link, self._options, self._clock = link, options, clock
        self._session = Session(link, clock)
        self._random = random.Random(0)
        self._monotonic = MonotonicStamps()
        self._doubted, self._backward, self._unanswered = 0, 0, 0
        self._absent_ns: int | None = None
        self._next_poll_ns = 0
        try:
            self._session.start(options.baud, options.wishes)
            self._probe = choose_probe(self._session.tools, options.probe is not None, link.where)
            self._reference = self._session.tools[1] if options.reference is not None else None
            self._tools = {tool.handle: tool for tool in self._in_order()}
            self._readings: dict[int, Reading] = {}
            self._detailed: dict[int, Reading] = {}
            self._bodies = self._marker_qualities()
            self._health = HealthWatch(self._session.bumped(), clock.now_ns())
            self._begin(options.reply or self._session.identity.reply)
        except RefusedError as error:
            link.close()
            raise lost_by_protocol(error, link.where) from error
        except BaseException:
            link.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self._session.stop()
        self._link.close()

    @property
    def telemetry(self) -> NdiTelemetry:
        """Everything known by now besides the poses."""
        return NdiTelemetry(
            identity=self._session.identity,
            reply=self._kind,
            health=self._health.health,
            tools=tuple(
                tool_telemetry(tool, self._readings.get(handle), self._detailed.get(handle))
                for handle, tool in self._tools.items()
            ),
            period_ms=self._freshness.period_ns / 1e6,
            refused=self._exchange.refused,
            doubted=self._doubted,
            clock_restarts=self._device_clock.restarts,
            warnings=tuple(self._session.warnings),
        )

    def describe(self) -> Description:
        """See drivers.device_api.Identified."""
        return describe(self.telemetry)

    def body(self) -> MarkerBody:
        """See drivers.device_api.Watched: the worse of probe and reference."""
        return worst(
            watch.look(self._readings.get(handle), self._detailed.get(handle)) for handle, watch in self._bodies.items()
        )

    def clear_bump(self) -> None:
        """See drivers.device_api.BumpDetector."""
        self._session.clear_bump()
        self._health.clear_bump()
        self._exchange.rest()

    def read(self, timeout_s: float) -> Pose | None:
        """The next pose the device has not yet reported, or word that there is none: see drivers.device_api.

        Nothing new for more than three periods gives a STALE pose per period. Raises DeviceLost when the device is
        silent for deadline_ms, reboots, leaves tracking mode, or is unplugged.
        """
        end_ns = self._clock.now_ns() + round(timeout_s * 1e9)
        while True:
            if self._next_poll_ns > end_ns:
                self._clock.sleep_until(end_ns)
                return None
            self._clock.sleep_until(self._next_poll_ns)
            pose = self._poll()
            if pose is not None or self._clock.now_ns() >= end_ns:
                return pose

    def _marker_qualities(self) -> dict[int, MarkerQuality]:
        electromagnetic = self._session.identity.electromagnetic
        return {tool.handle: MarkerQuality(tool, electromagnetic) for tool in self._posed()}

    def _posed(self) -> list[Tool]:
        """The tools that a pose is made of."""
        return [tool for tool in (self._probe, self._reference) if tool is not None]

    def _in_order(self) -> list[Tool]:
        first = self._posed()
        return first + [tool for tool in self._session.tools if tool not in first]

    def _begin(self, kind: ReplyKind) -> None:
        """Settle on a tracking command that the device knows, with details if it has them."""
        kinds = list(ReplyKind)
        for self._kind in kinds[kinds.index(kind) :]:
            self._dialect = dialect(self._kind)
            deadline_ns = round(self._options.deadline_ms * 1e6)
            self._freshness = Freshness(1.0, self._dialect.repeats)
            longest = _REPLY_BYTES + len(self._tools) * self._dialect.tool_bytes
            self._exchange = Exchange(self._link, self._dialect, deadline_ns, longest, self._clock, self._refuse_old)
            if self._understands(detailed=False):
                break
        else:
            raise DeviceLost(
                "the tracker knows no tracking command", self._link.where, "Check its firmware with NDI's program"
            )
        self._details = self._understands(detailed=True)
        self._since_details = 0
        self._outlier_gates = {tool.handle: OutlierGate() for tool in self._posed()}
        self._device_clock, tick_ns = self._make_clock()
        self._freshness = Freshness(tick_ns, self._dialect.repeats)
        self._exchange.rest()

    def _understands(self, detailed: bool) -> bool:
        try:
            self._exchange.ask(detailed)
        except RefusedError as refusal:
            what = "marker details" if detailed else self._kind.name
            self._session.warnings.append(f"{what}: {refusal.what}")
            return False
        return True

    def _make_clock(self) -> tuple[DeviceClock, float]:
        """(clock, nanoseconds of one tick): BX2 tells nanoseconds, TX and BX a counter."""
        if self._kind is ReplyKind.BX2:
            return DeviceClock(), 1.0
        counter_hz = self._options.counter_hz or frame_counter_hz(
            self._session, lambda: self._exchange.ask(detailed=False), self._probe.handle, self._clock
        )
        return CounterClock(counter_hz), 1e9 / counter_hz

    def _poll(self) -> Pose | None:
        answer = self._ask()
        self._watch_health(answer)
        probe = answer.snapshot.tools.get(self._probe.handle)
        if probe is None and self._dialect.repeats:
            raise self._lost(f"the tracker no longer lists the {self._probe.name}", "The connection is made again")
        if not self._believes(answer.snapshot):
            self._doubted += 1
            self._next_poll_ns = answer.arrival_ns + _RETRY_NS * (not self._dialect.repeats)
            return None
        self._readings |= answer.snapshot.tools
        if probe is None or not self._freshness.is_new(probe, answer.arrival_ns):
            return self._nothing_new(answer, probe)
        return self._fresh(answer, probe)

    def _fresh(self, answer: Answer, probe: Reading) -> Pose:
        self._freshness.take(probe, answer.arrival_ns)
        assert probe.tick is not None
        measured = self._device_clock.stamp(probe.tick, answer.arrival_ns, self._absent_ns, answer.sent_ns)
        self._absent_ns = answer.sent_ns
        self._plan(measured, answer.arrival_ns)
        stamp = self._monotonic.stamp(measured.t_ns - round(self._options.latency_ms * 1e6), measured.err_ns)
        status_reason = self._pose_status(probe)
        rms_mm = probe.transform.error if probe.transform is not None else math.nan
        if status_reason[0] is not PoseStatus.OK:
            return self._without_number(status_reason, stamp, rms_mm)
        return Pose(stamp, self._freshness.frame, self._relative(), rms_mm, PoseStatus.OK)

    def _nothing_new(self, answer: Answer, probe: Reading | None) -> Pose | None:
        self._absent_ns = answer.sent_ns
        self._next_poll_ns = answer.arrival_ns + min(_RETRY_NS, round(self._freshness.period_ns / _LEAST_RETRIES))
        self._freshness.is_new(None, answer.arrival_ns)
        reason = self._freshness.overdue(answer.arrival_ns)
        if not reason:
            return None
        absent = probe is not None and probe.tick is None
        status_reason = probe.status_reason if probe is not None and absent else (PoseStatus.STALE, reason)
        return self._without_number(status_reason, self._monotonic.stamp(answer.arrival_ns, 0), math.nan)

    def _pose_status(self, probe: Reading) -> StatusReason:
        """The worst word of device, probe and reference; the first that objects speaks."""
        system = self._health.health.status_reason
        if system[0] is not PoseStatus.OK:
            return system
        if probe.status_reason[0] is not PoseStatus.OK:
            return probe.status_reason
        if self._freshness.frozen:
            return PoseStatus.STALE, _FROZEN
        details = self._detailed.get(self._probe.handle)
        if details is not None and details.markers is not None and details.markers.outside:
            return PoseStatus.PARTIAL, f"markers outside the measurement volume: {details.markers.outside}"
        return self._reference_status()

    def _reference_status(self) -> StatusReason:
        """The last word on the reference, which may be a little older where the device measures the tools in turn."""
        if self._reference is None:
            return PoseStatus.OK, ""
        reading = self._readings.get(self._reference.handle)
        if reading is None:
            return PoseStatus.MISSING, "reference tool: nothing heard of it yet"
        if (
            reading.tick is not None
            and abs(self._freshness.time_ns(reading) - self._freshness.device_ns) > self._apart_ns
        ):
            return PoseStatus.STALE, "the reference tool was measured at another time than the probe"
        status, reason = reading.status_reason
        return status, f"reference tool: {reason}" if reason else ""

    def _relative(self) -> Matrix4:
        """(4, 4) probe → reference where there is one, else → tracker."""
        probe = self._readings[self._probe.handle].transform
        assert probe is not None
        if self._reference is None:
            return probe.matrix()
        reference = self._readings[self._reference.handle].transform
        assert reference is not None
        return seen_from(reference.matrix(), probe.matrix())

    @property
    def _apart_ns(self) -> float:
        """How far apart in time probe and reference may be measured."""
        return _REFERENCE_PERIODS * self._freshness.period_ns

    def _without_number(self, status_reason: StatusReason, stamp: Stamp, rms_mm: float) -> Pose:
        return Pose(stamp, max(self._freshness.frame, 0), None, rms_mm, status_reason[0], status_reason[1])

    def _believes(self, snapshot: Snapshot) -> bool:
        """No pose that the next one counts on has leapt without being confirmed."""
        believed = True
        for handle, watch in self._outlier_gates.items():
            reading, before = snapshot.tools.get(handle), self._readings.get(handle)
            if reading is None or reading.tick is None or reading.transform is None or not reading.usable:
                continue
            if before is None or before.tick != reading.tick:
                believed = watch.believes(self._freshness.time_ns(reading), reading.transform) and believed
        return believed

    def _ask(self) -> Answer:
        """The next reply, with details of the markers ten times a second."""
        interval = max(1, round(_DETAILS_S * 1e9 / self._freshness.period_ns))
        detailed = self._details and self._since_details >= interval
        try:
            answer = self._exchange.ask(detailed)
        except RefusedError as error:
            raise lost_by_protocol(error, self._link.where) from error
        if detailed and self._probe.handle in answer.snapshot.tools:
            self._since_details = 0
            self._detailed |= answer.snapshot.tools
        return answer

    def _watch_health(self, answer: Answer) -> None:
        """Ask what an alert is when the status says there is one; plugged tools need the whole start again."""
        if answer.snapshot.ports_changed:
            raise self._lost("a tool was plugged in or unplugged", "The connection is made again")
        self._health.note(answer.snapshot, answer.detailed, answer.arrival_ns)
        if self._health.asks_for_new():
            self._look_up("Info.Status.New Alerts")
        elif self._health.asks_for_standing(answer.arrival_ns):
            self._look_up("Info.Status.Alerts")

    def _look_up(self, name: str) -> None:
        """Devices that announce new alerts without telling which count as bumped, the gravest meaning.

        One question that is not answered is no silence of the device: the next tracking reply decides that. But what it
        does not tell several times may be grave.
        """
        try:
            alerts = self._session.parameter(name, _SHARE_OF_DEADLINE * self._options.deadline_ms / 1e3)
        except (ProtocolError, SilentError) as error:
            self._exchange.refused += 1
            self._unanswered += 1
            if self._unanswered >= _UNANSWERED:
                raise self._lost(f"the tracker does not tell its alerts ({error.what})", error.remedy) from error
            return
        self._unanswered = 0
        if name == "Info.Status.Alerts":
            self._health.note_standing(alerts, self._clock.now_ns())
        else:
            self._health.note_new(BUMPED if alerts is None else alerts, self._clock.now_ns())
        self._exchange.rest()

    def _refuse_old(self, snapshot: Snapshot) -> None:
        """A clock that runs backward is an old reply come late; if it insists, the device started it again."""
        reading = snapshot.tools.get(self._probe.handle)
        older = reading is not None and self._freshness.is_old(reading)
        self._backward = self._backward + 1 if older else 0
        if 0 < self._backward < _BACKWARD_READINGS:
            raise ProtocolError("an old reply came once more", self._link.where)

    def _plan(self, measured: Stamp, arrival_ns: int) -> None:
        """Ask again when the next measurement is due; sooner while it is not known when that is.

        Requests are spread over the time in which it may come to be there: one that comes too early bounds the device's
        clock from below, one that finds it bounds it from above. Where replies are so long that there is no time for a
        second request, only some are risked.
        """
        self._since_details += 1
        period_ns = self._freshness.period_ns
        if self._freshness.learning:
            self._next_poll_ns = arrival_ns + _RETRY_NS
            return
        early_ns = min(self._device_clock.early_ns, period_ns / _EARLY_PART)
        hurried = self._exchange.reply_ns > period_ns / _EARLY_PART and self._random.random() > _RISKED
        early_ns *= 0.0 if hurried else self._random.random()
        transfer_ns = self._link.transfer_ns(len(self._dialect.request(False)))
        self._next_poll_ns = measured.t_ns + round(period_ns - early_ns) - transfer_ns

    def _lost(self, what: str, remedy: str) -> DeviceLost:
        return DeviceLost(what, self._link.where, remedy)
