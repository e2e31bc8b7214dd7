"""How soon a lost tracker is reported, and how soon it tracks again: over every line, on a clock that runs slowly.
Its rows are LINES of `tests/support/simulated_*.py`.

The NDI trackers have four tools, whose replies take their time on a serial line. A slow clock leaves a busy host more
time for the same milliseconds, so that one attempt is enough.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from probewatch.appliance.service.devices.source_thread import TrackerThread
from probewatch.drivers.device_api import TrackerSource
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.registry import open_tracker
from probewatch.drivers.samples import Pose, PoseStatus
from tests.support.polling import until
from tests.support.rigs import Bench, lines

RATE = 0.4
REPORTED_NS, RESUMED_NS, FOUND_NS = 250e6, 2e9, 3e9
BREAK_NS = 1.31e9
"""Quarter of a second and 60 ms of break, and a second until the device speaks again: the protocol demands them."""

LINES = lines()
LOSSES = [(line.scheme, fault) for line in LINES.values() for fault in line.silences]
RESTARTS = [(line.scheme, fault) for line in LINES.values() for fault in line.restarts]


@contextmanager
def device(line: str, folder: Path) -> Iterator[tuple[str, Bench]]:
    """Its URL, and the simulated tracker behind it."""
    with LINES[line].open(folder, RATE) as opened:
        yield opened


@pytest.mark.parametrize(("line", "fault"), LOSSES)
def test_a_lost_tracker_is_reported_within_250_ms(line: str, fault: str, tmp_path: Path) -> None:
    with device(line, tmp_path) as (url, lost), open_tracker(url, lost.clock) as tracker:
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
    with device(line, tmp_path) as (url, lost):
        thread = TrackerThread("tracker", url, open_tracker, found.append, lost.clock)  # type: ignore[arg-type]
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
    with device("ndi", tmp_path) as (url, lost):
        thread = TrackerThread("tracker", url, open_tracker, found.append, lost.clock)  # type: ignore[arg-type]
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
