"""`probewatch simulate optotrak` as a process: world, pose file, recording, and faults switched while it runs."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.device_api import TrackerSource
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.recordings.metaimage_writing import SequenceItem, write_metaimage
from probewatch.drivers.registry import open_tracker
from probewatch.drivers.samples import Pose, PoseStatus
from tests.support.answers import answered
from tests.support.polling import until
from tests.support.recordings import turn
from tests.support.stopwatch import Stopwatch

PROBEWATCH = Path(sys.executable).parent / "probewatch"
HEADING = "t_s,tool,q0,qx,qy,qz,x_mm,y_mm,z_mm\n"


@pytest.fixture
def simulate() -> Iterator[Callable[..., str]]:
    """Starts `probewatch simulate optotrak` with these options; returns the URL it says."""
    started = []

    def start(*options: str) -> str:
        command = [PROBEWATCH, "simulate", "optotrak", "--tcp", "0", *options]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        started.append(process)
        assert process.stdout is not None
        return str(json.loads(process.stdout.readline())["url"])

    yield start
    for process in started:
        process.terminate()
        process.communicate(timeout=10)


def usable(source: TrackerSource) -> Pose:
    """The next pose with a number."""

    def look() -> Pose | None:
        pose = source.read(0.5)
        return pose if pose is not None and pose.status is PoseStatus.OK else None

    pose = until(look)
    assert pose is not None
    return pose


def test_poses_of_a_file_arrive_as_they_stand_there(tmp_path: Path, simulate: Callable[..., str]) -> None:
    path = tmp_path / "poses.csv"
    path.write_text(
        HEADING
        + "0,probe,1,0,0,0,0,0,-1500\n1000,probe,1,0,0,0,5000,0,-1500\n"
        + "0,reference,0.7071068,0,0,0.7071068,100,0,-1500\n"
    )
    with open_tracker(simulate("--poses", str(path)) + "&reference=2", HostClock()) as tracker:
        pose = usable(tracker)
        assert pose.matrix is not None
        # 90° about z and 100 mm along x lie between the tracker and the reference body.
        np.testing.assert_allclose(pose.matrix[:3, 3], (0, 100 - pose.sequence / 100 * 5, 0), atol=1e-3)
        np.testing.assert_allclose(pose.matrix[:3, :3], [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-6)


def test_poses_of_a_recording_arrive_as_recorded(tmp_path: Path, simulate: Callable[..., str]) -> None:
    session = [
        SequenceItem(round(n * 1e8), np.zeros((16, 16), np.uint8), {"ProbeToTracker": turn(0.01 * n, 2.0 * n, 1)}, n)
        for n in range(200)
    ]
    write_metaimage(tmp_path / "session.mha", session, (16, 16))
    with open_tracker(simulate("--recording", str(tmp_path / "session.mha")), HostClock()) as tracker:
        for _ in range(5):
            pose = usable(tracker)
            t_s = pose.sequence / 100
            np.testing.assert_allclose(pose.matrix, turn(0.1 * t_s, 20 * t_s, 1), atol=1e-3)


@pytest.mark.thorough
def test_a_control_file_switches_faults_while_it_runs(tmp_path: Path, simulate: Callable[..., str]) -> None:
    control = tmp_path / "faults.json"
    with open_tracker(simulate("--control", str(control)), HostClock()) as tracker:
        usable(tracker)
        control.write_text('["missing"]')
        until(lambda: (pose := tracker.read(0.5)) and pose.status is PoseStatus.MISSING)
        control.unlink()
        usable(tracker)
        control.write_text('["lose-tracker"]')
        watch = Stopwatch()
        with pytest.raises(DeviceLost, match="sent no frame"):
            until(lambda: tracker.read(0.5) is None, 5)
        assert watch.spent_s() < 2
    control.write_text("[]")
    with open_tracker(simulate(), HostClock()) as tracker:
        usable(tracker)


@pytest.mark.thorough
def test_faults_of_the_command_line_keep_their_times(simulate: Callable[..., str]) -> None:
    origin_ns = time.monotonic_ns()
    options = ("--origin-ns", str(origin_ns), "--rate", "2", "--fault", "missing@8..9")
    clock, seen = HostClock(2, origin_ns), []
    with open_tracker(simulate(*options) + "&deadline_ms=1000", clock) as tracker:
        while not seen or seen[-1].sequence < 950:
            pose = tracker.read(1.0)
            seen += [pose] if pose is not None else []
    missing = [pose.sequence for pose in seen if pose.status is PoseStatus.MISSING]
    assert missing[0] == pytest.approx(800, abs=20)
    assert missing[-1] == pytest.approx(900, abs=20)


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (["--fault", "flood"], 78, "'flood' is not a known fault"),
        (["--schedule", '[{"fault": "bump", "from_s": 1}]'], 78, "'bump' is not a known fault"),
        (["--program", "waltz"], 78, "'waltz' is not a known motion"),
        (["--poses", "/no/such/file"], 65, "the pose file cannot be read"),
        (["--poses", "a", "--recording", "b"], 78, "exclude each other"),
        (["--host", "203.0.113.1"], 78, "cannot listen"),
    ],
)
def test_what_cannot_be_simulated_is_refused_in_one_line(options: list[str], code: int, words: str) -> None:
    ended = answered("simulate", "optotrak", "--tcp", "0", *options)
    assert ended.returncode == code
    assert words in ended.stderr
    assert ended.stderr.count("\n") == 1
