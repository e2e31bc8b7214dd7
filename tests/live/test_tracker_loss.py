"""How soon a lost tracker is reported, and how soon it tracks again: over every line, on a clock that runs slowly.

The NDI trackers have four tools, whose replies take their time on a serial line. A slow clock leaves a busy host more
time for the same milliseconds, so that one attempt is enough.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from appliance.service.devices.source_thread import TrackerThread
from drivers.clock.host_clock import HostClock
from drivers.device_api import TrackerSource
from drivers.errors import DeviceLost
from drivers.registry import open_tracker
from drivers.samples import Pose, PoseStatus
from drivers.twins.ndi.models import SPECTRA, VEGA, Model
from tests.support import simulated_igtl, simulated_ndi, simulated_optotrak
from tests.support.polling import until

RATE = 0.4
REPORTED_NS, RESUMED_NS, FOUND_NS = 250e6, 2e9, 3e9
BREAK_NS = 1.31e9
"""Quarter of a second and 60 ms of break, and a second until the device speaks again: the protocol demands them."""

LOSSES = [
    *((line, fault) for line in ("ndi", "ndi+tcp") for fault in ("no-reply", "slow", "unplug")),
    ("ndi", "baud-mismatch"),
    *(("optotrak", fault) for fault in ("lose-tracker", "dribble", "unplug")),
    *(("igtl", fault) for fault in ("stall", "unplug")),
]
RESTARTS = [("ndi", "reset"), ("ndi+tcp", "reset"), ("optotrak", "reset"), ("igtl", "reset")]


@dataclass
class Device:
    """A simulated tracker under its URL. bench: the one of its kind."""

    url: str
    clock: HostClock
    bench: simulated_ndi.Bench | simulated_optotrak.Bench | simulated_igtl.Bench

    def show(self, *faults: str) -> None:
        """Exactly these from now on."""
        show = self.bench.faults if isinstance(self.bench, simulated_ndi.Bench) else self.bench.show
        show(*faults)

    def is_back(self) -> bool:
        """Whether no fault acts any longer, and the device has started again if it had to."""
        if isinstance(self.bench, simulated_ndi.Bench):
            return self.bench.twin._since == {} and not self.bench.twin.starting
        return True


@contextmanager
def device(line: str, folder: Path) -> Iterator[Device]:
    if line == "igtl":
        with simulated_igtl.bench(RATE) as relay:
            yield Device(f"igtl://{relay.target}", relay.clock, relay)
        return
    if line == "optotrak":
        with simulated_optotrak.bench(RATE) as server:
            yield Device(f"optotrak://{server.target}", server.clock, server)
        return
    model: Model = {"ndi": SPECTRA, "ndi+tcp": VEGA}[line]
    with simulated_ndi.bench(folder, model, RATE) as cart:
        probe, reference = cart.rom("probe"), cart.rom("reference")
        yield Device(f"{cart.place}?probe={probe}&reference={reference}&tools={probe},{probe}", cart.clock, cart)


@pytest.mark.parametrize(("line", "fault"), LOSSES)
def test_a_lost_tracker_is_reported_within_250_ms(line: str, fault: str, tmp_path: Path) -> None:
    with device(line, tmp_path) as lost, open_tracker(lost.url, lost.clock) as tracker:
        until(lambda: _is_ok(tracker.read(1.0)))
        lost.show(fault)
        began_ns = lost.clock.now_ns()
        with pytest.raises(DeviceLost):
            _read_on(tracker)
        assert lost.clock.now_ns() - began_ns < REPORTED_NS
        lost.show()


@pytest.mark.parametrize(("line", "fault"), LOSSES + RESTARTS)
def test_tracking_resumes_within_two_seconds(line: str, fault: str, tmp_path: Path) -> None:
    """Through the thread of the appliance, with its pauses. What the device needs to start again is not counted."""
    found: list[Pose] = []
    with device(line, tmp_path) as lost:
        thread = TrackerThread("tracker", lost.url, open_tracker, found.append, lost.clock)  # type: ignore[arg-type]
        thread.start()
        try:
            until(lambda: any(map(_is_ok, found)), 20)
            lost.show(fault)
            until(lambda: thread.losses == 1)
            lost.show()
            until(lost.is_back)
            ended_ns = lost.clock.now_ns()
            until(lambda: any(_is_ok(pose) and pose.stamp.t_ns > ended_ns for pose in tuple(found)), 20)
            resumed_ns = lost.clock.now_ns() - ended_ns
            assert resumed_ns < RESUMED_NS + (BREAK_NS if fault == "baud-mismatch" else 0)
            assert thread.failure is None
        finally:
            thread.stop()
            thread.join()


@pytest.mark.parametrize("silent_s", [2.0, 3.5])
def test_a_tracker_that_was_away_for_long_is_found_within_three_seconds(silent_s: float, tmp_path: Path) -> None:
    """As behind a cable that was pulled: no reset has reached it, so it goes on tracking, at the speed it had."""
    found: list[Pose] = []
    with device("ndi", tmp_path) as lost:
        thread = TrackerThread("tracker", lost.url, open_tracker, found.append, lost.clock)  # type: ignore[arg-type]
        thread.start()
        try:
            until(lambda: any(map(_is_ok, found)), 20)
            lost.show("no-reply")
            lost.clock.sleep_until(lost.clock.now_ns() + round(silent_s * 1e9))
            lost.show()
            until(lost.is_back)
            ended_ns = lost.clock.now_ns()
            until(lambda: any(_is_ok(pose) and pose.stamp.t_ns > ended_ns for pose in tuple(found)), 20)
            assert lost.clock.now_ns() - ended_ns < FOUND_NS
            assert (thread.losses, thread.failure) == (1, None)
        finally:
            thread.stop()
            thread.join()


def _read_on(tracker: TrackerSource) -> None:
    for _ in range(1000):
        tracker.read(0.05)


def _is_ok(pose: Pose | None) -> bool:
    return pose is not None and pose.status is PoseStatus.OK
