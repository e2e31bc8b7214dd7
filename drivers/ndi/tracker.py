"""`ndi:/dev/ttyUSB0?probe=FILE.rom&reference=FILE.rom&baud=115200`: poses of a Polaris or Aurora by BX.

Options: probe, reference (tool definition files of passive tools; without probe the first wired tool), baud,
counter_hz (of the device's frame counter: 60 for Polaris, which is the default), deadline_ms (silence after which the
tracker counts as lost, 250), latency_ms (exposure to first byte of the reply as measured on this unit, 0).
"""

import math
import random
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np

from drivers.counter_clock import CounterClock
from drivers.errors import ConfigurationError, DeviceLost, ProtocolError
from drivers.hosttime import HostClock
from drivers.ndi.bx import decode_bx
from drivers.ndi.judge import SYSTEM_ALERTS_PENDING, SYSTEM_PORTS_CHANGED, Judgement, judge_system, judge_tool
from drivers.ndi.link import Link, lost_by_protocol, refuse_reset
from drivers.ndi.replies import HandleState, Options, ToolReply, TrackingReply, Transform
from drivers.ndi.rom import read_rom
from drivers.ndi.session import COMM_CODES, Session
from drivers.ndi.wire import Command, RefusedError, decode_text, encode_command, open_container
from drivers.samples import Matrix4, Pose, PoseStatus, Stamp

_OPTIONS = Options.POSE | Options.OUT_OF_VOLUME
_REQUEST = encode_command(Command("BX", f"{int(_OPTIONS):04X}"))
_STALE_PERIODS = 3
_FROZEN_READINGS = 12
_BACKWARD_READINGS = 3
_SLOWEST_STEP_S = 0.05
_GAP_NS = 40_000_000
_RETRY_NS = 1_000_000.0
_LEARNING_READINGS = 20
_COUNTS = 1 << 32


@dataclass(frozen=True, slots=True)
class TrackerOptions:
    """The options of the URL, checked."""

    probe: bytes | None = None
    reference: bytes | None = None
    baud: int = 115200
    counter_hz: float = 60.0
    deadline_ms: float = 250.0
    latency_ms: float = 0.0

    @property
    def roms(self) -> tuple[bytes, ...]:
        """Tool definitions to load, the probe's first."""
        return tuple(rom for rom in (self.probe, self.reference) if rom is not None)


def open_tracker(target: str, options: dict[str, str], clock: HostClock) -> "NdiTracker":
    """Connect, load the tools and start tracking; see drivers.ports for what is raised."""
    return NdiTracker(target, parse_options(options, f"ndi:{target}"), clock)


def parse_options(options: dict[str, str], where: str) -> TrackerOptions:
    """Raises ConfigurationError naming the option that is unknown or out of range."""
    known = ("probe", "reference", "baud", "counter_hz", "deadline_ms", "latency_ms")
    if unknown := sorted(set(options) - set(known)):
        raise ConfigurationError(f"unknown option '{unknown[0]}'", where, f"Use {', '.join(known)}")
    if "reference" in options and "probe" not in options:
        raise ConfigurationError("a reference needs a probe", where, "Add probe=FILE.rom")
    return TrackerOptions(
        probe=read_rom(options["probe"]) if "probe" in options else None,
        reference=read_rom(options["reference"]) if "reference" in options else None,
        baud=_baud(options.get("baud", "115200"), where),
        counter_hz=_number(options, "counter_hz", 60.0, (1, 1000), where),
        deadline_ms=_number(options, "deadline_ms", 250.0, (20, 5000), where),
        latency_ms=_number(options, "latency_ms", 0.0, (0, 500), where),
    )


class NdiTracker:
    """One tracking device, tracking from construction until the context is left; then at 9600 baud again.

    refused: replies dropped because their bytes were damaged. warnings: what the device remarked while starting.
    """

    def __init__(self, path: str, options: TrackerOptions, clock: HostClock) -> None:
        self.refused = 0
        self._options, self._clock = options, clock
        self._counter_clock = CounterClock(options.counter_hz)
        self._news = _NewsWatch(options.counter_hz)
        self._alerts = 0
        self._backward = 0
        self._next_poll_ns = 0
        self._random = random.Random(0)
        self._link = Link(path, clock)
        self._session = Session(self._link, clock)
        try:
            self._handles = self._session.start(options.baud, options.roms)
        except BaseException:
            self._link.close()
            raise
        self.warnings = tuple(self._session.warnings)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self._session.stop()
        self._link.close()

    def read(self, timeout_s: float) -> Pose | None:
        """The next pose the device has not yet reported, or word that there is none: see drivers.ports.

        A counter that stands still for more than three periods gives a STALE pose per period. Raises DeviceLost when
        the device is silent for deadline_ms, reboots, leaves tracking mode, or is unplugged.
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

    def _poll(self) -> Pose | None:
        reply, arrival_ns = self._exchange()
        probe = self._listed(reply, self._handles[0])
        self._watch_system(reply.system_status)
        new = self._news.take(probe, arrival_ns)
        self._plan(new, arrival_ns)
        if new:
            return self._fresh(reply, probe, arrival_ns)
        if reason := self._news.overdue(arrival_ns):
            kind = (
                PoseStatus.DISABLED
                if probe.state is not HandleState.VALID and probe.frame is None
                else PoseStatus.STALE
            )
            return self._without_number((kind, reason), Stamp(arrival_ns, 0), math.nan)
        return None

    def _fresh(self, reply: TrackingReply, probe: ToolReply, arrival_ns: int) -> Pose:
        stamp = self._counter_clock.stamp(self._news.frame, arrival_ns)
        stamp = Stamp(stamp.t_ns - round(self._options.latency_ms * 1e6), stamp.err_ns)
        rms_mm = probe.transform.error if probe.transform is not None else math.nan
        judgement = self._judge(reply, probe)
        if judgement[0] is not PoseStatus.OK or probe.transform is None:
            return self._without_number(judgement, stamp, rms_mm)
        return Pose(stamp, self._news.frame, self._relative(reply, probe.transform), rms_mm, PoseStatus.OK)

    def _judge(self, reply: TrackingReply, probe: ToolReply) -> Judgement:
        """The worst word of device, probe and reference; the first that objects speaks."""
        system = judge_system(reply.system_status, self._alerts)
        if system[0] is not PoseStatus.OK:
            return system
        own = judge_tool(probe)
        if own[0] is not PoseStatus.OK:
            return own
        if self._news.frozen:
            return PoseStatus.STALE, f"{_FROZEN_READINGS} poses in a row are equal to the last bit"
        return self._judge_reference(reply, probe)

    def _judge_reference(self, reply: TrackingReply, probe: ToolReply) -> Judgement:
        if len(self._handles) == 1:
            return PoseStatus.OK, ""
        reference = self._listed(reply, self._handles[1])
        status, reason = judge_tool(reference)
        if status is PoseStatus.OK and reference.frame != probe.frame:
            return PoseStatus.STALE, "the reference tool was measured at another time than the probe"
        return status, f"reference tool: {reason}" if reason else ""

    def _relative(self, reply: TrackingReply, probe: Transform) -> Matrix4:
        if len(self._handles) == 1:
            return probe.matrix()
        reference = self._listed(reply, self._handles[1]).transform
        assert reference is not None
        return np.asarray(np.linalg.solve(reference.matrix(), probe.matrix()))

    def _without_number(self, judgement: Judgement, stamp: Stamp, rms_mm: float) -> Pose:
        return Pose(stamp, self._news.frame, None, rms_mm, judgement[0], judgement[1])

    def _listed(self, reply: TrackingReply, handle: int) -> ToolReply:
        tool = reply.tool(handle)
        if tool is None:
            raise self._lost(f"the tracker no longer lists the tool {handle:02X}", "The connection is made anew")
        return tool

    def _watch_system(self, system_status: int) -> None:
        """Ask what the alert is when the status says there is one; plugged tools need the whole start anew."""
        if system_status & SYSTEM_PORTS_CHANGED:
            raise self._lost("a tool was plugged in or unplugged", "The connection is made anew")
        if system_status & SYSTEM_ALERTS_PENDING:
            self._alerts |= self._new_alerts()

    def _new_alerts(self) -> int:
        """Mask of Info.Status.New Alerts; devices without the parameter count as bumped, the gravest meaning."""
        try:
            text = self._session.command("GET", "Info.Status.New Alerts", timeout_s=self._deadline_s)
            return int(text.strip().rpartition("=")[2])
        except RefusedError:
            return 0x200000
        except (ProtocolError, ValueError):
            self.refused += 1
            return 0

    def _exchange(self) -> tuple[TrackingReply, int]:
        """One good BX reply and when its first byte left the device, ns. Damaged replies are asked for again."""
        deadline_ns = self._clock.now_ns() + round(self._deadline_s * 1e9)
        while True:
            self._link.send(_REQUEST)
            try:
                data = self._link.read_reply(deadline_ns)
                arrival_ns = self._clock.now_ns() - self._link.transfer_ns(len(data))
                return self._refuse_old(self._decode(data)), arrival_ns
            except RefusedError as error:
                raise lost_by_protocol(error, self._link.path) from error
            except ProtocolError:
                self.refused += 1
                self._link.wait_quiet(_GAP_NS, deadline_ns)

    def _decode(self, data: bytes) -> TrackingReply:
        if data.endswith(b"\r") and data.isascii():
            refuse_reset(decode_text(data), self._link.path)
        open_container(data)
        return decode_bx(data, _OPTIONS)

    def _refuse_old(self, reply: TrackingReply) -> TrackingReply:
        """A counter that runs backward is an old reply come late; if it insists, the device started it anew."""
        tool = reply.tool(self._handles[0])
        older = tool is not None and tool.frame is not None and self._news.runs_backward(tool.frame)
        self._backward = self._backward + 1 if older else 0
        if 0 < self._backward < _BACKWARD_READINGS:
            raise ProtocolError("an old reply came once more", self._link.path)
        return reply

    def _plan(self, new: bool, arrival_ns: int) -> None:
        """When to ask again: soon after the next measurement is due, or at once when it is late.

        The random part keeps the polls from marching in step with the device, which would hide the lowest delay.
        """
        pause_ns = self._news.pace_ns * (0.7 + 0.15 * self._random.random()) if new else _RETRY_NS
        self._next_poll_ns = arrival_ns + round(pause_ns)

    @property
    def _deadline_s(self) -> float:
        return self._options.deadline_ms / 1e3

    def _lost(self, what: str, remedy: str) -> DeviceLost:
        return DeviceLost(what, self._link.path, remedy)


class _NewsWatch:
    """Tells new replies from repeated ones by the frame counter, and learns the step of the device.

    frame: last counter value. period_ns: between two measurements, an upper bound at first; pace_ns: likewise, but a
    lower bound at first. frozen: the pose repeats while the counter runs.
    """

    def __init__(self, counter_hz: float) -> None:
        self.frame = -1
        self.frozen = False
        self._count_ns = 1e9 / counter_hz
        self.period_ns = _SLOWEST_STEP_S * 1e9
        self._learning = _LEARNING_READINGS
        self._new_ns: int | None = None
        self._told_ns = 0
        self._transform: Transform | None = None
        self._equal = 0

    def take(self, tool: ToolReply, arrival_ns: int) -> bool:
        """Whether the tool's entry is of another frame than the last."""
        if self._new_ns is None:
            self._new_ns = arrival_ns
        if tool.frame is None or tool.frame == self.frame:
            return False
        if self.frame >= 0:
            steps = (tool.frame - self.frame) % _COUNTS
            self.period_ns = min(self.period_ns, steps * self._count_ns)
            self._learning -= 1
        repeated = tool.transform is not None and tool.transform == self._transform
        self._equal = self._equal + 1 if repeated else 0
        self.frozen = self._equal >= _FROZEN_READINGS - 1
        self._transform = tool.transform
        self.frame, self._new_ns, self._told_ns = tool.frame, arrival_ns, arrival_ns
        return True

    def runs_backward(self, frame: int) -> bool:
        """Whether a counter value is older than the last, wrap-around considered."""
        return self.frame >= 0 and (frame - self.frame) % _COUNTS >= _COUNTS // 2

    @property
    def pace_ns(self) -> float:
        return self._count_ns if self._learning > 0 else self.period_ns

    def overdue(self, arrival_ns: int) -> str:
        """Why the data are stale; empty while they are not, or while it was said less than a period ago."""
        assert self._new_ns is not None
        age_ns = arrival_ns - self._new_ns
        if age_ns <= _STALE_PERIODS * self.period_ns or arrival_ns - self._told_ns < self.period_ns:
            return ""
        self._told_ns = arrival_ns
        return f"the frame counter has stood still for {age_ns / 1e6:.0f} ms"


def _baud(text: str, where: str) -> int:
    if not text.isdecimal() or int(text) not in COMM_CODES:
        rates = ", ".join(str(rate) for rate in sorted(COMM_CODES))
        raise ConfigurationError(f"baud={text} is not a line speed of these trackers", where, f"Use one of {rates}")
    return int(text)


def _number(options: dict[str, str], key: str, default: float, bounds: tuple[float, float], where: str) -> float:
    low, high = bounds
    try:
        value = float(options.get(key, default))
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise ConfigurationError(f"{key}={options[key]} is out of range", where, f"Use a number from {low} to {high}")
    return value
