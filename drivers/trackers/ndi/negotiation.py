"""Negotiates with a device that tracks: the command that asks for poses, whether it gives details, its clock's rate."""

from dataclasses import dataclass

from probewatch.drivers.clock.counter_clock import CounterClock
from probewatch.drivers.clock.device_clock import DeviceClock
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.trackers.ndi.counter_rate import frame_counter_hz
from probewatch.drivers.trackers.ndi.exchange import Exchange
from probewatch.drivers.trackers.ndi.identity import ReplyKind
from probewatch.drivers.trackers.ndi.options import TrackerOptions
from probewatch.drivers.trackers.ndi.readings import Dialect, dialect
from probewatch.drivers.trackers.ndi.session import Session
from probewatch.drivers.trackers.ndi.tools import Tool
from probewatch.drivers.trackers.ndi.wire import RefusedError

_REPLY_BYTES = 50
"""First guess at the bytes of a reply that belong to no tool: frame and status, and strays, 12 bytes each. Longer
replies are noted when they come (Exchange).
"""


@dataclass(frozen=True, slots=True)
class Agreed:
    """Holds what was agreed. kind: the tracking command. details: whether the device knows that command with marker
    details.

    tick_ns: length of a tick of the device's clock: nanoseconds for BX2, steps of a frame counter for TX and BX.
    """

    kind: ReplyKind
    dialect: Dialect
    exchange: Exchange
    details: bool
    device_clock: DeviceClock
    tick_ns: float


def negotiate(session: Session, options: TrackerOptions, probe: Tool, clock: HostClock) -> Agreed:
    """Returns the best tracking command that a device in tracking mode answers. Raises DeviceLost if it knows none."""
    kinds = list(ReplyKind)
    for kind in kinds[kinds.index(options.reply or session.identity.reply) :]:
        spoken = dialect(kind)
        longest = _REPLY_BYTES + len(session.tools) * spoken.tool_bytes
        exchange = Exchange(session.link, spoken, round(options.deadline_ms * 1e6), longest, clock)
        if _understands(session, exchange, kind.name, detailed=False):
            break
    else:
        remedy = "Check its firmware with NDI's program"
        raise DeviceLost("the tracker knows no tracking command", session.link.where, remedy)
    details = _understands(session, exchange, "marker details", detailed=True)
    device_clock, tick_ns = _make_clock(session, exchange, kind, options, probe, clock)
    exchange.rest()
    return Agreed(kind, spoken, exchange, details, device_clock, tick_ns)


def _understands(session: Session, exchange: Exchange, what: str, detailed: bool) -> bool:
    try:
        exchange.ask(detailed)
    except RefusedError as refusal:
        session.warnings.append(f"{what}: {refusal.what}")
        return False
    return True


def _make_clock(
    session: Session, exchange: Exchange, kind: ReplyKind, options: TrackerOptions, probe: Tool, clock: HostClock
) -> tuple[DeviceClock, float]:
    """Returns (clock, nanoseconds of one tick): BX2 sends nanoseconds, TX and BX a counter."""
    if kind is ReplyKind.BX2:
        return DeviceClock(), 1.0
    counter_hz = options.counter_hz or frame_counter_hz(
        session, lambda: exchange.ask(detailed=False), probe.handle, clock
    )
    return CounterClock(counter_hz), 1e9 / counter_hz
