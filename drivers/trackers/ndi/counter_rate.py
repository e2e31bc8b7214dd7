"""Determines how fast the frame counter of a tracker runs: by its kind, by what it publishes, or by measurement."""

import math
from collections.abc import Callable

from probewatch.drivers.clock.counter_clock import counter_rate_hz
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.trackers.ndi.exchange import Answer
from probewatch.drivers.trackers.ndi.session import Session

_POLARIS_HZ = 60.0
"""Combined API: a Polaris counts at 60 Hz, whatever rate it measures at; a recorded 20 Hz unit steps by three."""

_AURORAS_HZ = (40.0, 320.0)
"""Counter rates of an Aurora, Hz: one count per measurement of 25 ms, or eight. Recorded frame numbers of an Aurora V3
step by eight; that this makes 320 Hz is inferred from their pace. That older units count single measurements is not
documented.
"""

_LEARN_NS = 400_000_000
"""How long the counter is watched, ns: 16 measurements, to distinguish rates that differ by a factor of eight. More
delays every connection to an Aurora; less leaves little margin for a late reply.
"""

_LEARN_STEP_NS = 20_000_000
"""Pause between those requests, ns: below the 25 ms of a measurement. A shorter one asks more and learns no more."""


def frame_counter_hz(session: Session, ask: Callable[[], Answer], handle: int, clock: HostClock) -> float:
    """Returns the counts per second. ask: requests one tracking reply, of which the tool of that handle is read.

    Raises DeviceLost where the counter of an Aurora, of which there are two kinds, does not advance.
    """
    if session.identity.electromagnetic:
        measured_hz = _measured_hz(session.link.where, ask, handle, clock)
        return min(_AURORAS_HZ, key=lambda hz: abs(math.log(hz / measured_hz)))
    published_hz = session.parameter("Param.Tracking.Frame Frequency") if session.identity.has_bx2 else None
    return float(published_hz or _POLARIS_HZ)


def _measured_hz(where: str, ask: Callable[[], Answer], handle: int, clock: HostClock) -> float:
    begin_ns = clock.now_ns()
    counts: list[int] = []
    arrivals_ns: list[int] = []
    while clock.now_ns() < begin_ns + _LEARN_NS:
        answer = ask()
        reading = answer.snapshot.tools.get(handle)
        if reading is not None and reading.tick is not None:
            counts.append(reading.tick)
            arrivals_ns.append(answer.arrival_ns)
        clock.sleep_until(clock.now_ns() + _LEARN_STEP_NS)
    if not counts or counts[-1] <= counts[0]:
        raise DeviceLost("the tracker's frame counter stands still", where, "Switch the tracker off and on")
    return counter_rate_hz(counts, arrivals_ns)
