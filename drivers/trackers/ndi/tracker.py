"""Opens `ndi:/dev/ttyUSB0?probe=FILE.rom&reference=FILE.rom` and yields poses of a Polaris, Vega or Aurora, for
`ndi+tcp://` as well.

Its options are the rows of NDI, in the `__init__.py` of this folder. Without probe= the first wired tool of six degrees
of freedom is the probe; poses of further tools are in `telemetry`.
"""

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable
from probewatch.drivers.device_api import Description
from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.drivers.io.byte_log import ByteLog
from probewatch.drivers.samples import MarkerBody, Pose
from probewatch.drivers.trackers.ndi.alerts import Alerts
from probewatch.drivers.trackers.ndi.exchange import Answer
from probewatch.drivers.trackers.ndi.health import HealthWatch
from probewatch.drivers.trackers.ndi.link import Link, lost_by_protocol
from probewatch.drivers.trackers.ndi.marker_quality import MarkerQuality, worst
from probewatch.drivers.trackers.ndi.negotiation import negotiate
from probewatch.drivers.trackers.ndi.options import TrackerOptions, parse_options
from probewatch.drivers.trackers.ndi.polling import Polling
from probewatch.drivers.trackers.ndi.pose_assembly import Bodies, PoseAssembly
from probewatch.drivers.trackers.ndi.session import Session
from probewatch.drivers.trackers.ndi.telemetry import NdiTelemetry, describe, tool_telemetry
from probewatch.drivers.trackers.ndi.tools import choose_probe
from probewatch.drivers.trackers.ndi.transport import ByteLine, SerialLine
from probewatch.drivers.trackers.ndi.wire import RefusedError
from probewatch.drivers.trackers.witness import WitnessSight


def open_tracker(target: str, options: dict[str, str], clock: HostClock) -> "NdiTracker":
    """Connects, loads the tools and starts tracking; see drivers.registry for what is raised."""
    wanted = checked(target, options)
    return connect(SerialLine(target), f"ndi:{target}", wanted, clock)


def checked(target: str, options: dict[str, str]) -> TrackerOptions:
    """Returns the checked options. Raises ConfigurationError that names the option that is unknown or out of range."""
    return parse_options(options, f"ndi:{target}")


def connect(line: ByteLine, url: str, options: TrackerOptions, clock: HostClock) -> "NdiTracker":
    """Takes over the line, and closes it if anything fails. Raises DeviceLost, ConfigurationError."""
    try:
        byte_log = None if options.log is None else ByteLog(options.log, url, clock)
    except ConfigurationError:
        line.close()
        raise
    return NdiTracker(Link(line, clock, byte_log), options, clock)


class NdiTracker(Closable):
    """Controls one tracking device. It tracks from construction until the context is left; then it is as a fresh
    program expects it.
    """

    def __init__(self, link: Link, options: TrackerOptions, clock: HostClock) -> None:
        self._link, self._clock = link, clock
        self._session = Session(link, clock)
        try:
            self._start(options)
        except RefusedError as error:
            link.close()
            raise lost_by_protocol(error, link.where) from error
        except BaseException:
            link.close()
            raise

    def _start(self, options: TrackerOptions) -> None:
        """Brings the device from any state to the first request for a pose."""
        session, clock = self._session, self._clock
        session.start(options.baud, options.requested_tools)
        self._probe = choose_probe(session.tools, options.probe is not None, self._link.where)
        reference = session.tools[1] if options.reference is not None else None
        witness = (
            session.tools[len(options.requested_tools) - len(options.further) - 1]
            if options.witness is not None
            else None
        )
        posed = [tool for tool in (self._probe, reference) if tool is not None]
        self._tools = (*posed, *(tool for tool in session.tools if tool not in posed))
        electromagnetic = session.identity.electromagnetic
        self._marker_qualities = {tool.handle: MarkerQuality(tool, electromagnetic) for tool in posed}
        health = HealthWatch(session.bumped(), clock.now_ns())
        self._agreed = agreed = negotiate(session, options, self._probe, clock)
        self._alerts = Alerts(session, health, agreed.exchange, options.deadline_ms, clock)
        sight = None if witness is None else WitnessSight(witness.name, clock.now_ns())
        bodies = Bodies(self._probe, reference, witness, sight)
        self._assembly = PoseAssembly(bodies, agreed, options.latency_ms)
        self._polling = Polling(self._link, agreed, self._assembly.freshness, self._probe.handle)

    def close(self) -> None:
        """See Closable."""
        self._session.stop()
        self._link.close()

    @property
    def telemetry(self) -> NdiTelemetry:
        """Returns everything that is known so far besides the poses."""
        readings, detailed = self._assembly.readings, self._assembly.detailed
        return NdiTelemetry(
            identity=self._session.identity,
            reply=self._agreed.kind,
            health=self._alerts.health,
            tools=tuple(
                tool_telemetry(tool, readings.get(tool.handle), detailed.get(tool.handle)) for tool in self._tools
            ),
            period_ms=self._assembly.freshness.period_ns / 1e6,
            refused=self._agreed.exchange.refused,
            doubted=self._assembly.doubted,
            clock_restarts=self._agreed.device_clock.restarts,
            warnings=(
                *self._session.warnings,
                *self._assembly.remarks(self._clock.now_ns()),
            ),
        )

    def describe(self) -> Description:
        """See drivers.device_api.Identified."""
        return describe(self.telemetry)

    def body(self) -> MarkerBody:
        """Returns the worse of probe and reference; see drivers.device_api.Watched."""
        readings, detailed = self._assembly.readings, self._assembly.detailed
        qualities = self._marker_qualities.items()
        return worst(quality.look(readings.get(handle), detailed.get(handle)) for handle, quality in qualities)

    def clear_bump(self) -> None:
        """See drivers.device_api.BumpDetector."""
        self._alerts.clear_bump()

    def read(self, timeout_s: float) -> Pose | None:
        """Returns the next pose that the device has not yet reported, or one that says that there is none: see
        drivers.device_api.

        After more than three periods without anything new, there is a STALE pose per period. Raises DeviceLost when the
        device is silent for deadline_ms, reboots, leaves tracking mode, or is unplugged.
        """
        end_ns = self._clock.now_ns() + round(timeout_s * 1e9)
        while True:
            if self._polling.next_ns > end_ns:
                self._clock.sleep_until(end_ns)
                return None
            self._clock.sleep_until(self._polling.next_ns)
            pose = self._poll()
            if pose is not None or self._clock.now_ns() >= end_ns:
                return pose

    def _poll(self) -> Pose | None:
        """Handles one reply: asks for it, follows its alerts, assembles the pose, and plans the next request."""
        answer = self._polling.ask()
        self._alerts.follow(answer)
        self._require_probe(answer)
        if not self._assembly.take(answer):
            self._polling.after_doubt(answer.arrival_ns)
            return None
        measured = self._assembly.measured(answer)
        if measured is None:
            self._polling.after_nothing_new(answer.arrival_ns)
            return self._assembly.overdue_pose(answer)
        self._polling.after_new(measured, answer.arrival_ns, self._agreed.device_clock.early_ns)
        return self._assembly.new_pose(measured, self._alerts.health.status_reason)

    def _require_probe(self, answer: Answer) -> None:
        """Raises DeviceLost where a device that lists every tool in each reply no longer lists the probe."""
        if self._agreed.dialect.repeats and self._probe.handle not in answer.snapshot.tools:
            what = f"the tracker no longer lists the {self._probe.name}"
            raise DeviceLost(what, self._link.where, "The connection is made again")
