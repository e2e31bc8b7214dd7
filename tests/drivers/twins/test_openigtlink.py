"""The driver against the simulated server, on a slow clock: faults."""

import pytest

from probewatch.drivers.openigtlink.tracker import IgtlTracker
from probewatch.drivers.registry import open_tracker
from probewatch.drivers.samples import Pose, PoseStatus
from tests.support.simulated_igtl import Bench, bench

RATE = 0.4
"""Seconds of the clock per second: leaves a busy host more time for the same milliseconds."""


def opened(server: Bench) -> IgtlTracker:
    tracker = open_tracker(f"igtl://{server.target}", server.clock)
    assert isinstance(tracker, IgtlTracker)
    return tracker


def until(tracker: IgtlTracker, status: PoseStatus, words: str = "") -> Pose:
    for _ in range(400):
        pose = tracker.read(1.0)
        if pose is not None and pose.status is status and words in pose.reason:
            return pose
    raise AssertionError(f"no {status} pose came")


@pytest.mark.parametrize(
    ("fault", "status", "words"),
    [
        ("bad-crc", PoseStatus.MISSING, "damaged"),
        ("mute", PoseStatus.MISSING, "no new transform 'ProbeToTracker'"),
        ("repeat", PoseStatus.STALE, ""),
        ("complain", PoseStatus.MISSING, "warms up"),
    ],
)
def test_a_fault_takes_the_poses_away_and_they_come_back(fault: str, status: PoseStatus, words: str) -> None:
    with bench(RATE) as server, opened(server) as tracker:
        until(tracker, PoseStatus.OK)
        server.show(fault)
        until(tracker, status, words)
        server.show()
        until(tracker, PoseStatus.OK)


@pytest.mark.parametrize("fault", ["split", "old-header", "untimed", "clock-jump"])
def test_what_is_odd_and_right_stays_a_pose(fault: str) -> None:
    with bench(RATE) as server, opened(server) as tracker:
        until(tracker, PoseStatus.OK)
        server.show(fault)
        found = [tracker.read(1.0) for _ in range(30)]
        assert sum(pose is not None and pose.status is PoseStatus.OK for pose in found) > 20
