"""Opens `optotrak://host:3020?body=1&reference=2` and yields the poses of an Optotrak's rigid body, from NDI's First
Principles server. Its options are the rows of OPTOTRAK, in the `__init__.py` of this folder.
"""

import math
import random
from collections import deque
from dataclasses import dataclass
from pathlib import Path

from probewatch.drivers.clock.device_clock import DeviceClock
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.clock.monotonic_stamps import MonotonicStamps
from probewatch.drivers.closable import Closable
from probewatch.drivers.device_api import Description
from probewatch.drivers.errors import ConfigurationError, ProtocolError
from probewatch.drivers.io.tcp_line import parse_address
from probewatch.drivers.rigid import seen_from
from probewatch.drivers.samples import MarkerBody, Matrix4, Pose, PoseStatus, Stamp
from probewatch.drivers.trackers.optotrak import OPTOTRAK
from probewatch.drivers.trackers.optotrak.client import SERVER_REMEDY, Rtc3dClient, error_words
from probewatch.drivers.trackers.optotrak.rtc3d import (
    Body,
    ByteOrder,
    Component,
    ComponentType,
    DataFrame,
    Event,
    NoData,
    Packet,
    PacketType,
    Text,
)
from probewatch.drivers.trackers.reference_place import ReferencePlace
from probewatch.drivers.trackers.staleness import (
    DEADLINE_MS,
    FROZEN_READINGS,
    SLOWEST_PERIOD_NS,
    STALE_PERIODS,
)
from probewatch.drivers.trackers.witness import WitnessSight

PORT = 3020
"""TCP port of the RTC3D server of First Principles."""

_ORDERS = {"big": ByteOrder.BIG, "little": ByteOrder.LITTLE}
_WANTED = "6D Events"
_CONNECT_S = 2.0
"""Seconds for the name, the connection and the replies to up to three commands together. More delays the report that no
server is there; how long a busy First Principles takes is not known."""

_SINGLE_HZ = 60
"""Requests a second in single mode without rate=: two poses per picture of a 30 Hz scanner. Each costs a command and a
reply; fewer leave the pose of a picture further away."""

_EVENTS_KEPT = 100
"""Newest events from the server that are kept for callers; nothing is decided by them. More only takes memory."""


@dataclass(frozen=True, slots=True)
class OptotrakOptions:
    """Holds the options of the URL, checked. body, reference, witness: from 1. rate_hz: None for every frame."""

    body: int = 1
    reference: int | None = None
    witness: int | None = None
    single: bool = False
    order: ByteOrder = ByteOrder.BIG
    rate_hz: int | None = None
    deadline_ms: float = DEADLINE_MS
    latency_ms: float = 0.0
    log: Path | None = None


def open_tracker(target: str, options: dict[str, str], clock: HostClock) -> "OptotrakTracker":
    """Connects and starts the stream; see drivers.registry for what is raised. target: host or host:port."""
    (host, port), wanted = checked(target, options)
    return OptotrakTracker(host, port, wanted, clock)


def checked(target: str, options: dict[str, str]) -> tuple[tuple[str, int], OptotrakOptions]:
    """Returns (host, port) and the options. Raises ConfigurationError that names what is invalid."""
    where = f"optotrak://{target}"
    return parse_address(target, PORT, where), parse_options(options, where)


def parse_options(options: dict[str, str], where: str) -> OptotrakOptions:
    """Returns the checked options. Raises ConfigurationError that names the option that is unknown or out of range."""
    given = OPTOTRAK.given(options, where)
    log = given.text("log")
    checked = OptotrakOptions(
        body=given.integer("body"),
        reference=given.integer_or_none("reference"),
        witness=given.integer_or_none("witness"),
        single=given.word("mode") == "single",
        order=_ORDERS[given.word("order")],
        rate_hz=given.integer_or_none("rate"),
        deadline_ms=given.number("deadline_ms"),
        latency_ms=given.number("latency_ms"),
        log=None if log is None else Path(log),
    )
    if checked.reference == checked.body:
        raise ConfigurationError("body and reference are the same rigid body", where, "Give two different numbers")
    if checked.witness in (checked.body, checked.reference) and checked.witness is not None:
        what = f"the witness is rigid body {checked.witness}, which is the probe's or the reference already"
        raise ConfigurationError(what, where, "Give the number of a second body on the probe")
    if checked.rate_hz and 2000 / checked.rate_hz > checked.deadline_ms:
        remedy = f"Use deadline_ms={2000 / checked.rate_hz:.0f} or a higher rate"
        raise ConfigurationError(f"rate={checked.rate_hz} is too slow for the deadline", where, remedy)
    return checked


class OptotrakTracker(Closable):
    """Holds one connection to the server, streaming from construction until the context is left.

    refused: count of packets dropped because they were damaged or held impossible values. events: the last ones, as the
    server sent them. restarts: how often the server's clock jumped.
    """

    def __init__(self, host: str, port: int, options: OptotrakOptions, clock: HostClock) -> None:
        self.refused = 0
        self.events: deque[Event] = deque(maxlen=_EVENTS_KEPT)
        self._options, self._clock = options, clock
        self._deadline_ns = round(options.deadline_ms * 1e6)
        self._device_clock = DeviceClock()
        self._freshness = _Freshness()
        self._monotonic = MonotonicStamps()
        self._reference_place = ReferencePlace()
        named = options.witness is not None
        self._witness = WitnessSight(f"rigid body {options.witness}", clock.now_ns()) if named else None
        self._words = ""
        self._bodies: Component | None = None
        deadline_ns = clock.now_ns() + round(_CONNECT_S * 1e9)
        self._connection = Rtc3dClient(host, port, options.order, clock, _CONNECT_S, options.log)
        try:
            self._version = self._connection.ask("Version 1.0", deadline_ns)
            self._connection.ask(f"SetByteOrder {options.order.word}", deadline_ns)
            if not options.single:
                self._connection.ask(f"StreamFrames {_stream_rate(options.rate_hz)} {_WANTED}", deadline_ns)
        except BaseException:
            self._connection.close(())
            raise
        self._heard_ns = self._next_request_ns = clock.now_ns()
        self._asked = False
        self._request_ns: int | None = None
        self._absent_ns: int | None = None
        self._random = random.Random(0)

    def close(self) -> None:
        """See Closable."""
        self._connection.close(("Bye",) if self._options.single else ("StreamFrames Stop", "Bye"))

    @property
    def restarts(self) -> int:
        """Returns how often the server's clock jumped or restarted."""
        return self._device_clock.restarts

    def describe(self) -> Description:
        """See drivers.device_api.Identified."""
        reference = self._options.reference
        return Description(
            model="Optotrak, by the RTC3D server of First Principles",
            firmware=self._version,
            tools=(
                f"rigid body {self._options.body}",
                *(() if reference is None else (f"rigid body {reference} (reference)",)),
                *(() if self._witness is None else (f"rigid body {self._options.witness} (second on the probe)",)),
            ),
            rate_hz=self._freshness.rate_hz,
            remarks=(
                *self._reference_place.remarks(self._clock.now_ns()),
                *(() if self._witness is None else self._witness.remarks(self._clock.now_ns())),
                *((f"{self.refused} damaged packets were refused",) if self.refused else ()),
            ),
        )

    def body(self) -> MarkerBody:
        """Returns the fit alone, as the stream lacks the definition of a rigid body; see drivers.device_api.Watched."""
        if self._bodies is None:
            return MarkerBody()
        numbers = (self._options.body, self._options.reference)
        listed = [_listed(self._bodies, number) for number in numbers if number is not None]
        return MarkerBody(fit_mm=max((body.rms_mm for body in listed if isinstance(body, Body)), default=None))

    def read(self, timeout_s: float) -> Pose | None:
        """Returns the next pose, or one that says that there is none: see drivers.device_api.

        Frames whose number or time does not advance for more than three periods give a STALE pose per period. Raises
        DeviceLost when the server is silent for deadline_ms, closes the connection, or sends what cannot be read.
        """
        end_ns = self._clock.now_ns() + round(timeout_s * 1e9)
        while True:
            pose = self._listen(self._prompt(end_ns))
            if pose is not None or self._clock.now_ns() >= end_ns:
                return pose

    def _prompt(self, end_ns: int) -> int:
        """Asks for a frame when it is due. Returns until when to listen, ns.

        The random part keeps the requests from falling into step with the frames, which would hide the lowest delay.
        """
        if not self._options.single or self._asked:
            return min(end_ns, self._heard_ns + self._deadline_ns)
        now_ns = self._clock.now_ns()
        if now_ns < self._next_request_ns:
            return min(end_ns, self._next_request_ns)
        self._connection.send(f"SendCurrentFrame {_WANTED}")
        self._asked, self._heard_ns = True, now_ns
        self._absent_ns, self._request_ns = self._request_ns, now_ns
        period_ns = 1e9 / (self._options.rate_hz or _SINGLE_HZ)
        self._next_request_ns = now_ns + round(period_ns * (0.8 + 0.4 * self._random.random()))
        return min(end_ns, now_ns + self._deadline_ns)

    def _listen(self, until_ns: int) -> Pose | None:
        """Returns the pose of one packet; None also when none came. Raises DeviceLost after too long a silence."""
        try:
            packet = self._connection.receive(until_ns)
        except ProtocolError as error:
            self.refused += 1
            self._words = error.what
            packet = None
        now_ns = self._clock.now_ns()
        waiting = self._asked or not self._options.single
        if waiting and packet is None and now_ns - self._heard_ns >= self._deadline_ns:
            raise self._connection.lost(f"the server {self._silence()}", f"{SERVER_REMEDY} and collects")
        return None if packet is None else self._take(packet, self._connection.arrival_ns)

    def _silence(self) -> str:
        said = f"; before that: {self._words}" if self._words else ""
        return f"sent no frame for {self._options.deadline_ms:g} ms{said}"

    def _take(self, packet: Packet, arrival_ns: int) -> Pose | None:
        match packet:
            case DataFrame():
                self._note_heard()
                return self._measured(packet, arrival_ns)
            case NoData():
                self._note_heard()
                return self._overdue(arrival_ns)
            case Text(kind=PacketType.ERROR):
                self._note_heard()
                self._words = error_words(packet.text)
                return self._without_number(PoseStatus.FAULT, self._words, self._monotonic.stamp(arrival_ns, 0))
            case _:
                return None

    def _note_heard(self) -> None:
        self._heard_ns, self._asked, self._words = self._connection.arrival_ns, False, ""

    def _measured(self, frame: DataFrame, arrival_ns: int) -> Pose | None:
        events = frame.component(ComponentType.EVENTS)
        if events is not None:
            self.events.extend(item for item in events.items if isinstance(item, Event))
        bodies = frame.component(ComponentType.BODIES)
        if bodies is None or not self._freshness.take(bodies, self._options.body, arrival_ns):
            return self._overdue(arrival_ns)
        self._bodies = bodies
        return self._fresh(bodies, arrival_ns)

    def _fresh(self, bodies: Component, arrival_ns: int) -> Pose:
        stamp = self._device_clock.stamp(bodies.time_us * 1000, arrival_ns, self._absent_ns)
        half_ns = self._connection.shortest_ns // 2
        early_ns = round(self._options.latency_ms * 1e6) + half_ns
        stamp = self._monotonic.stamp(stamp.t_ns - early_ns, stamp.err_ns + half_ns)
        probe = _listed(bodies, self._options.body)
        rms_mm = probe.rms_mm if isinstance(probe, Body) else math.nan
        if isinstance(probe, str):
            return self._without_number(PoseStatus.DISABLED, probe, stamp)
        if probe is None:
            return self._without_number(PoseStatus.MISSING, "the tracker does not see the probe's rigid body", stamp)
        if self._freshness.frozen:
            reason = f"{FROZEN_READINGS} poses in a row are equal to the last bit"
            return self._without_number(PoseStatus.STALE, reason, stamp, rms_mm)
        return self._relative(bodies, probe, stamp)

    def _relative(self, bodies: Component, probe: Body, stamp: Stamp) -> Pose:
        """Returns the probe in the frame of the reference body, where one is configured."""
        matrix: Matrix4 = probe.matrix()
        witness = self._witnessed(bodies, matrix, stamp)
        if self._options.reference is not None:
            reference = _listed(bodies, self._options.reference)
            if isinstance(reference, str):
                return self._without_number(PoseStatus.DISABLED, reference, stamp, probe.rms_mm)
            if reference is None:
                reason = "the tracker does not see the reference body"
                return self._without_number(PoseStatus.MISSING, reason, stamp, probe.rms_mm)
            seen = reference.matrix()
            self._reference_place.take(stamp.t_ns, seen)
            matrix = seen_from(seen, matrix)
            witness = None if witness is None else seen_from(seen, witness)
        return Pose(stamp, bodies.frame, matrix, probe.rms_mm, PoseStatus.OK, witness=witness)

    def _witnessed(self, bodies: Component, probe: Matrix4, stamp: Stamp) -> Matrix4 | None:
        """Returns the second body on the probe in the tracker's frame, of the same frame; None where it is not seen."""
        if self._witness is None or self._options.witness is None:
            return None
        listed = _listed(bodies, self._options.witness)
        return self._witness.take(stamp.t_ns, probe, listed.matrix() if isinstance(listed, Body) else None)

    def _overdue(self, arrival_ns: int) -> Pose | None:
        reason = self._freshness.overdue(arrival_ns)
        return self._without_number(PoseStatus.STALE, reason, self._monotonic.stamp(arrival_ns, 0)) if reason else None

    def _without_number(self, status: PoseStatus, reason: str, stamp: Stamp, rms_mm: float = math.nan) -> Pose:
        return Pose(stamp, self._freshness.frame, None, rms_mm, status, reason)


class _Freshness:
    """Distinguishes new frames from repeated ones: both their number and their time must advance.

    frame: number of the last new one, -1 before it. frozen: whether the pose repeats while the frames run.
    """

    def __init__(self) -> None:
        self.frame = -1
        self.frozen = False
        self._time_us = -1
        self._period_ns = SLOWEST_PERIOD_NS
        self._learnt = False
        self._new_ns: int | None = None
        self._reported_ns = 0
        self._odd = ""
        self._body: Body | None = None
        self._equal = 0

    @property
    def rate_hz(self) -> float:
        """Returns the shortest step of the server's time so far, as a rate; NaN before the second frame."""
        return 1e9 / self._period_ns if self._learnt else math.nan

    def take(self, bodies: Component, number: int, arrival_ns: int) -> bool:
        """Returns whether this frame is new. number: that of the rigid body whose pose is watched for repetition."""
        same_frame, same_time = bodies.frame == self.frame, bodies.time_us == self._time_us
        if same_frame or same_time:
            self._odd = _disagreement(same_frame, same_time)
            return False
        self._learn(bodies)
        body = _listed(bodies, number)
        repeated = isinstance(body, Body) and body == self._body
        self._equal = self._equal + 1 if repeated else 0
        self.frozen = self._equal >= FROZEN_READINGS - 1
        self._body = body if isinstance(body, Body) else None
        self.frame, self._time_us, self._odd = bodies.frame, bodies.time_us, ""
        self._new_ns = self._reported_ns = arrival_ns
        return True

    def overdue(self, arrival_ns: int) -> str:
        """Returns why the data are stale; empty while they are not, or if that was reported less than a period ago."""
        if self._new_ns is None:
            self._new_ns = arrival_ns
        age_ns = arrival_ns - self._new_ns
        if age_ns <= STALE_PERIODS * self._period_ns or arrival_ns - self._reported_ns < self._period_ns:
            return ""
        self._reported_ns = arrival_ns
        return f"{self._odd or 'no new frame'} for {age_ns / 1e6:.0f} ms"

    def _learn(self, bodies: Component) -> None:
        """Learns the period of the frames; a collection that restarts may have another rate."""
        if self.frame < 0:
            return
        step_ns = (bodies.time_us - self._time_us) * 1000.0
        if step_ns <= 0 or bodies.frame < self.frame:
            self._period_ns, self._learnt = SLOWEST_PERIOD_NS, False
        elif step_ns < self._period_ns or not self._learnt:
            self._period_ns, self._learnt = step_ns, True


def _disagreement(same_frame: bool, same_time: bool) -> str:
    if same_frame and same_time:
        return ""
    return "the frame number has stood still" if same_frame else "the time of the frames has stood still"


def _listed(bodies: Component, number: int) -> Body | str | None:
    """Returns the rigid body of that number, None where it is not seen, or a text that it is not listed."""
    if number > len(bodies.items):
        return f"the server lists {len(bodies.items)} rigid bodies, number {number} is not among them"
    item = bodies.items[number - 1]
    assert item is None or isinstance(item, Body)
    return item


def _stream_rate(rate_hz: int | None) -> str:
    return "AllFrames" if rate_hz is None else f"Frequency:{rate_hz}"
