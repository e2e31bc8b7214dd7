"""Yields the poses of an OpenIGTLink server: TRANSFORM, TDATA and QTDATA, and what STATUS reports about them."""

import math
from collections import deque
from dataclasses import dataclass

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable
from probewatch.drivers.device_api import Description
from probewatch.drivers.errors import ProtocolError
from probewatch.drivers.openigtlink.client import FOLLOW_REMEDY, IgtlClient
from probewatch.drivers.openigtlink.content import (
    CODES,
    OK,
    UNKNOWN_INSTRUCTION,
    UNKNOWN_VERSION,
    StartTracking,
    Turn,
    parse_status,
    parse_tools,
    parse_transform,
    parse_turned_tools,
)
from probewatch.drivers.openigtlink.freshness import Freshness
from probewatch.drivers.openigtlink.message import Header, Message
from probewatch.drivers.openigtlink.options import IgtlOptions
from probewatch.drivers.openigtlink.sender_time import SenderTime
from probewatch.drivers.openigtlink.stream import Arrived
from probewatch.drivers.printable import printable
from probewatch.drivers.rigid import pose_matrix, seen_from
from probewatch.drivers.samples import Matrix4, Pose, PoseStatus, Stamp
from probewatch.drivers.trackers.plus_transform import (
    GOOD,
    TransformReading,
    rigid_reading,
    without_identity,
    without_matrix,
)
from probewatch.drivers.trackers.pose_bounds import UNIT_TOLERANCE
from probewatch.drivers.trackers.reference_place import ReferencePlace
from probewatch.drivers.trackers.witness import WitnessSight

_APART_NS = 5_000_000
"""Largest difference between the times of probe and reference that make one pose, ns. Tools of one measurement share a
time. A server that reads them in turn is some milliseconds apart, in which a reference that is pushed at 100 mm/s moves
by half a millimetre. Not measured.
"""

_TOGETHER_NS = 1_000_000
"""Largest difference between the times of probe and witness that are one measurement, ns. A hand moves at 200 mm/s,
which is a fifth of a millimetre in that time; less loses a server that rounds its times.
"""

_RESOLUTION_MS = 10
"""Least time between two messages, requested from a server that sends tracking data on request: 100 poses a second at
most, more than a scanner has pictures.
"""

_ASK_AGAIN_NS = 1_000_000_000
"""Time between questions whether a server that complained is well again, ns. More lets it wait; less is idle
traffic.
"""

_MOST_COMPLAINTS = 16
"""Devices of a server whose complaints are kept. A hostile server could invent names without end."""

_KINDS = ("TRANSFORM", "TDATA", "QTDATA", "STATUS")
_NAME_IT = "Name one that it sends by probe= in the URL; where the name is right, bring the tool into view"
_SEND_IT = (
    "Have the server send the tool's pose as TRANSFORM (PLUS: TransformNames); where it does, bring the tool into view"
)
_POSES = ("TRANSFORM ", "TDATA ", "QTDATA ")
_BLAMELESS = (UNKNOWN_INSTRUCTION, UNKNOWN_VERSION)
"""Codes that answer a question of ours and say nothing about the tracker."""


@dataclass(frozen=True, slots=True, eq=False)
class _Measured:
    """Holds one reading. time_ns: that of the sender, or of the arrival where it sends none."""

    reading: TransformReading
    time_ns: int
    stamp: Stamp | None = None


class IgtlTracker(Closable):
    """Holds one connection. refused: count of messages that were damaged or held impossible values."""

    def __init__(self, address: tuple[str, int], options: IgtlOptions, clock: HostClock) -> None:
        """Connects to the server. Raises DeviceLost."""
        self._options, self._clock = options, clock
        self.refused = 0
        self._complaints: dict[str, str] = {}
        self._ask_ns = 0
        self._probe: _Measured | None = None
        self._reference: _Measured | None = None
        self._witness: _Measured | None = None
        self._witness_later = False
        self._judged_ns: int | None = None
        self._damage = ""
        self._has_come = self._by_whole_name = False
        self._poses: deque[Pose] = deque()
        deadline_ns = round(options.tracker_deadline_ms * 1e6)
        self._client = IgtlClient(address, self._wanted, deadline_ns, options.version, clock)
        self._time = SenderTime(round(options.latency_ms * 1e6), self._client.round_trip_ns)
        self._freshness = Freshness(clock.now_ns())
        self._reference_place = ReferencePlace()
        self._sight = None if options.witness is None else WitnessSight(options.witness, clock.now_ns())
        try:
            self._greet()
        except BaseException:
            self._client.close()
            raise

    def close(self) -> None:
        """See Closable."""
        self._client.close()

    def describe(self) -> Description:
        """See drivers.device_api.Identified."""
        remarks = (
            (self._time.untimed, "poses had no time: they are stamped at their arrival"),
            (self.refused, "damaged messages were refused"),
            (self._time.restarts, "times the server's clock jumped, or its messages came later from then on"),
        )
        fixed = self._options.reference
        absent, remedy = ("", "") if self._has_come else self._absent()
        return Description(
            "OpenIGTLink server",
            tools=(
                self._options.probe,
                *(() if fixed is None else (f"{fixed} (reference)",)),
                *(() if self._sight is None else (f"{self._options.witness} (second on the probe)",)),
            ),
            rate_hz=self._freshness.rate_hz,
            remarks=(
                *self._reference_place.remarks(self._clock.now_ns()),
                *(() if self._sight is None else self._sight.remarks(self._clock.now_ns())),
                *(f"{count} {words}" for count, words in remarks if count),
            ),
            absent=absent,
            remedy=remedy,
            time_remedy=self._time.remedy,
        )

    def _absent(self) -> tuple[str, str]:
        """Returns the message that the transform never came, or was damaged each time, and its remedy."""
        named = f"no transform '{printable(self._options.probe)}'"
        if self._damage:
            return f"{named} could be read: {self._damage}", FOLLOW_REMEDY
        remedy = _NAME_IT if any(name.startswith(_POSES) for name in self._client.received) else _SEND_IT
        return f"{named} came; the server sends {self._client.others}", remedy

    def read(self, timeout_s: float) -> Pose | None:
        """Returns the next pose, or one that says that there is none: see drivers.device_api.

        A server that is alive and sends no new transform of the probe gives a pose without a number in every period.
        Raises DeviceLost when it is silent for deadline_ms, closes the connection, or cannot be followed.
        """
        end_ns = self._clock.now_ns() + round(timeout_s * 1e9)
        while not self._poses:
            self._listen(min(end_ns, self._freshness.due_ns))
            self._require_news()
            if self._clock.now_ns() >= end_ns:
                break
        return self._poses.popleft() if self._poses else None

    def _greet(self) -> None:
        """Sends a first message: PLUS sends metadata, and with them the status of each tool, to clients that have shown
        that they support them.
        """
        self._client.send("GET_STATUS")
        if self._options.ask:
            start = StartTracking(_RESOLUTION_MS)
            self._client.send(f"STT_{self._options.ask}", content=start.content)

    def _wanted(self, header: Header) -> bool:
        if header.kind == "TRANSFORM":
            self._by_whole_name |= header.device == self._options.probe
            options = self._options
            named = header.device in (options.probe, options.reference, options.witness)
            return named or self._is_bare(header.device)
        return header.kind in _KINDS

    def _is_bare(self, name: str) -> bool:
        """Returns whether the tool's name alone stands for its transform, as for a server that sends no other."""
        return bool(self._options.bare) and name == self._options.bare and not self._by_whole_name

    def _listen(self, until_ns: int) -> None:
        try:
            arrived = self._client.receive(until_ns)
            if arrived is not None:
                self._take(arrived)
        except ProtocolError as error:
            self.refused += 1
            self._damage = error.what

    def _take(self, arrived: Arrived) -> None:
        message = arrived.message
        if message.kind == "STATUS":
            self._heed(message)
            return
        found = _readings(message)
        if message.kind == "TRANSFORM" and self._is_bare(message.device):
            found[self._options.probe] = found[message.device]
        if self._options.reference in found:
            time_ns = message.time_ns or arrived.arrival_ns
            self._reference = _Measured(found[self._options.reference], time_ns)
            self._pair()
        if self._options.witness in found:
            self._witness = _Measured(found[self._options.witness], message.time_ns or arrived.arrival_ns)
            self._witness_later |= self._probe is None and self._together(self._judged_ns)
            self._pair()
        if self._options.probe in found:
            self._has_come = True
            self._measured(found[self._options.probe], arrived)

    def _heed(self, message: Message) -> None:
        """Notes a complaint. Until the same device reports that it is OK, the poses are not trusted."""
        status = parse_status(message.content)
        if status.code == OK:
            self._complaints.pop(message.device, None)
        if status.code in (OK, *_BLAMELESS):
            return
        words = ", ".join(printable(part) for part in (status.error, status.text) if part)
        said = f"{CODES.get(status.code, f'code {status.code}')}{f' ({words})' if words else ''}"
        if message.device in self._complaints or len(self._complaints) < _MOST_COMPLAINTS:
            self._complaints[message.device] = f"the server reports of '{printable(message.device)}': {said}"
        self._put_status(PoseStatus.MISSING, next(iter(self._complaints.values())))

    def _measured(self, reading: TransformReading, arrived: Arrived) -> None:
        """Takes a reading of the probe. The one before, if no reference of its time came, goes without a number."""
        time_ns = arrived.message.time_ns
        self._release()
        self._time.note(time_ns)
        if not self._freshness.take(time_ns, reading.matrix, self._clock.now_ns()):
            return
        if self._probe is not None:
            reason = f"no transform '{printable(str(self._options.reference))}' of the same time"
            self._judge(self._probe, TransformReading(None, PoseStatus.MISSING, reason))
        self._damage = ""
        stamp = self._time.stamp(time_ns, arrived.arrival_ns)
        self._probe = _Measured(reading, time_ns or arrived.arrival_ns, stamp)
        self._pair()

    def _pair(self) -> None:
        """Makes the pose, once everything that belongs to it has one time."""
        probe, reference = self._probe, self._reference
        if probe is None or (self._witness_later and not self._together(probe.time_ns)):
            return
        if probe.reading.matrix is None or self._options.reference is None:
            self._judge(probe, probe.reading, witness=self._witnessed(probe))
            return
        apart_ns = abs(reference.time_ns - probe.time_ns) if reference is not None else _APART_NS + 1
        if reference is None or apart_ns > _APART_NS:
            return
        witness = self._witnessed(probe)
        reading = reference.reading
        if reading.matrix is not None:
            assert probe.stamp is not None
            self._reference_place.take(probe.stamp.t_ns, reading.matrix)
            witness = None if witness is None else seen_from(reading.matrix, witness)
            reading = TransformReading(seen_from(reading.matrix, probe.reading.matrix), PoseStatus.OK)
        self._judge(probe, reading, apart_ns, witness)

    def _release(self) -> None:
        """Makes the pose that was waiting only for the witness of its time."""
        if self._witness_later and self._probe is not None:
            self._witness_later = False
            self._pair()

    def _together(self, time_ns: int | None) -> bool:
        """Returns whether the last witness was measured at that time of the sender's."""
        return (
            self._witness is not None and time_ns is not None and abs(self._witness.time_ns - time_ns) <= _TOGETHER_NS
        )

    def _witnessed(self, probe: _Measured) -> Matrix4 | None:
        """Returns the second body measured with the probe, in the tracker's frame; None where it is not seen."""
        if self._sight is None or self._witness is None or probe.reading.matrix is None or probe.stamp is None:
            return None
        matrix = self._witness.reading.matrix if self._together(probe.time_ns) else None
        return self._sight.take(probe.stamp.t_ns, probe.reading.matrix, matrix)

    def _judge(
        self, probe: _Measured, reading: TransformReading, apart_ns: int = 0, witness: Matrix4 | None = None
    ) -> None:
        """Queues the pose as read, unless the server complains or the poses are frozen."""
        if self._complaints:
            reading = TransformReading(None, PoseStatus.MISSING, next(iter(self._complaints.values())))
        elif reading.matrix is not None and self._freshness.frozen:
            reading = TransformReading(None, PoseStatus.STALE, self._freshness.frozen)
        assert probe.stamp is not None
        stamp = Stamp(probe.stamp.t_ns, probe.stamp.err_ns + apart_ns)
        self._judged_ns = probe.time_ns
        self._put(stamp, reading, None if reading.matrix is None else witness)

    def _put(self, stamp: Stamp, reading: TransformReading, witness: Matrix4 | None = None) -> None:
        self._probe = None
        count = self._freshness.count
        self._poses.append(Pose(stamp, count, reading.matrix, math.nan, reading.status, reading.reason, witness))

    def _require_news(self) -> None:
        """Queues a pose that says so where the server is alive and sends nothing new about the probe."""
        now_ns = self._clock.now_ns()
        self._ask_whether_well(now_ns)
        if not self._freshness.overdue(now_ns):
            return
        if self._freshness.repeats:
            self._put_status(PoseStatus.STALE, "the server repeats an old transform")
            return
        names = [self._options.probe, *([self._options.reference] if self._options.reference else [])]
        wanted = " and ".join(f"'{printable(name)}'" for name in names)
        damage = f"; damaged: {self._damage}" if self._damage else ""
        self._put_status(
            PoseStatus.MISSING, f"no new transform {wanted}; the server sends {self._client.others}{damage}"
        )

    def _ask_whether_well(self, now_ns: int) -> None:
        if self._complaints and now_ns >= self._ask_ns:
            self._ask_ns = now_ns + _ASK_AGAIN_NS
            self._client.send("GET_STATUS", next(iter(self._complaints)))

    def _put_status(self, status: PoseStatus, reason: str) -> None:
        """Queues a status as of now, in place of the reading that waits for its reference."""
        self._put(self._time.heard(self._clock.now_ns()), TransformReading(None, status, reason))


def _readings(message: Message) -> dict[str, TransformReading]:
    """Returns what a message reports about each tool, under the name of its transform. Raises ProtocolError."""
    if message.kind == "TRANSFORM":
        return {message.device: _of_transform(message)}
    if message.kind == "TDATA":
        return _named({tool.name: _checked(tool.matrix, tool.name) for tool in parse_tools(message.content)})
    return _named({tool.name: _of_turn(tool.turn, tool.name) for tool in parse_turned_tools(message.content)})


def _named(readings: dict[str, TransformReading]) -> dict[str, TransformReading]:
    """Returns the readings under both names: an element of tracking data has the name of a tool or of its transform."""
    return {f"{name}ToTracker": reading for name, reading in readings.items()} | readings


def _of_transform(message: Message) -> TransformReading:
    """Returns the reading of TRANSFORM. PLUS sends the status of a transform in the metadata."""
    name, status = message.device, message.said("TransformStatus").upper()
    matrix = parse_transform(message.content)
    if status not in ("", *GOOD):
        return without_matrix(status, name)
    if message.said("TransformValid").lower() in ("false", "0"):
        return without_matrix("INVALID", name)
    return _checked(matrix, name)


def _checked(matrix: Matrix4, name: str) -> TransformReading:
    return without_identity(rigid_reading(matrix, name), name)


def _of_turn(turn: Turn, name: str) -> TransformReading:
    x, y, z, w = turn.quaternion
    length = math.hypot(x, y, z, w)
    if not abs(length - 1) <= UNIT_TOLERANCE:
        reason = f"{printable(name)} has a quaternion of length {length:.4g}"
        return TransformReading(None, PoseStatus.NOT_UNDERSTOOD, reason)
    return _checked(pose_matrix((w, x, y, z), turn.position), name)
