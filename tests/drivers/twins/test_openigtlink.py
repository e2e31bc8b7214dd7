"""The driver against the simulated server, on a slow clock: faults, and how true the stamps are."""

import numpy as np
import pytest

from drivers.openigtlink.tracker import IgtlTracker
from drivers.registry import open_tracker
from drivers.samples import Pose, PoseStatus
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


@pytest.mark.thorough
def test_the_bound_of_the_stamps_holds() -> None:
    """Every pose tells by its place which measurement it was, and so when it was made."""
    with bench(RATE) as server, opened(server) as tracker:
        origin_ns, errors = server.clock.origin_ns, []
        places = np.array([server.world.measured_pose(n / 60, n)[:3, 3] for n in range(900)])
        while len(errors) < 400:
            pose = until(tracker, PoseStatus.OK)
            assert pose.matrix is not None
            far_mm = np.linalg.norm(places - pose.matrix[:3, 3], axis=1)
            assert far_mm.min() < 1e-3
            true_ns = origin_ns + int(far_mm.argmin()) * 1e9 / 60
            errors.append((abs(pose.stamp.t_ns - true_ns), pose.stamp.err_ns))
        held = sum(error_ns <= err_ns for error_ns, err_ns in errors) / len(errors)
        settled = sorted(error_ns for error_ns, _ in errors[200:])
        print(
            f"bound holds for {held:.1%}; median error {settled[100] / 1e6:.2f} ms, bound {errors[-1][1] / 1e6:.2f} ms"
        )
        assert held >= 0.99
