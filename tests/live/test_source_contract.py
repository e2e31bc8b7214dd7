"""What every source promises, whatever its bytes: one suite over every simulated device that yields poses or pictures.

Its rows are RIGS of `tests/support/simulated_*.py`; tests/drivers/test_descriptor.py fails for a driver without one,
and has what is refused.
"""

import json
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.device_api import TrackerSource, VideoSource
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.recordings.metaimage_writing import SequenceItem, write_metaimage
from probewatch.drivers.registry import drivers, open_tracker, open_video
from probewatch.drivers.samples import Frame, Pose, PoseStatus
from probewatch.drivers.twins.scene.world import World
from tests.support.polling import until
from tests.support.rigs import Rig, rigs
from tests.support.simulated import PROBEWATCH

DEADLINE_S = 0.6
"""Of the trackers here: how soon they are lost by default is under test elsewhere, on a clock of its own."""

SLACK_S = 0.4
"""What a busy machine may add to a deadline."""

OPTIONS = {driver.scheme: [option.name for option in driver.options] for driver in drivers().values()}


RIGS = rigs()
SILENT = [name for name, rig in RIGS.items() if "deadline_ms" in OPTIONS[rig.scheme]]
"""Those that say after how long a silence they are lost."""


@dataclass
class Device:
    """One device that can be switched on and off."""

    rig: Rig
    folder: Path
    process: "subprocess.Popen[str] | None" = None
    url: str = ""

    def start(self) -> None:
        command = [*PROBEWATCH, "simulate", *self.rig.start(self.folder)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        ready = json.loads(self.process.stdout.readline())
        self.url = ready["url"]

    def open(self) -> TrackerSource | VideoSource:
        deadline = f"deadline_ms={1000 * DEADLINE_S:.0f}" if self.rig.name in SILENT else ""
        query = "&".join(filter(None, (deadline, self.rig.query)))
        opener = open_video if self.rig.kind == "video" else open_tracker
        return opener(f"{self.url}{('&' if '?' in self.url else '?') if query else ''}{query}", HostClock())

    def end(self) -> None:
        """Its process is gone, as when the plug is pulled. The name of its pseudo-terminal goes first: the kernel gives
        the number to whoever asks next, who would be taken for it.
        """
        assert self.process is not None
        (self.folder / "tracker").unlink(missing_ok=True)
        self.process.kill()
        self.process.communicate()


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[str], Device]]:
    """Starts devices, and ends those that the test has left."""
    started: list[Device] = []

    def begin(kind: str) -> Device:
        device = Device(RIGS[kind], tmp_path)
        started.append(device)
        device.start()
        return device

    yield begin
    for device in started:
        device.end()


def samples(source: TrackerSource | VideoSource, number: int, deadline_s: float = 10.0) -> list[Frame | Pose]:
    end_s = time.monotonic() + deadline_s
    found: list[Frame | Pose] = []
    while len(found) < number:
        assert time.monotonic() < end_s, f"{len(found)} samples within {deadline_s} s"
        sample = source.read(0.5)
        if sample is not None:
            found.append(sample)
    return found


def require_contract(found: list[Frame | Pose], opened_ns: int) -> None:
    now_ns = time.monotonic_ns()
    for earlier, later in pairwise(found):
        assert later.stamp.t_ns > earlier.stamp.t_ns, "stamps run forward"
    fresh = [sample for sample in found if isinstance(sample, Frame) or sample.status is not PoseStatus.STALE]
    for earlier, later in pairwise(fresh):
        assert later.sequence > earlier.sequence, "the device's counter advances"
    for sample in found:
        assert sample.stamp.err_ns >= 0
        assert opened_ns - sample.stamp.err_ns - 1e9 < sample.stamp.t_ns <= now_ns, "the clock is CLOCK_MONOTONIC"
        if isinstance(sample, Pose):
            require_pose(sample)
        else:
            assert sample.image.ndim == 2
            assert sample.image.dtype == np.uint8


def require_pose(pose: Pose) -> None:
    assert (pose.matrix is not None) == (pose.status is PoseStatus.OK)
    assert pose.witness is None or pose.matrix is not None, "the second body comes with the first alone"
    assert pose.reason or pose.status is PoseStatus.OK, "what is not OK says why"
    for matrix in (pose.matrix, pose.witness):
        if matrix is not None:
            rotation = matrix[:3, :3]
            np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
            assert np.linalg.det(rotation) == pytest.approx(1)
            np.testing.assert_array_equal(matrix[3], (0, 0, 0, 1))


@pytest.mark.parametrize("kind", RIGS)
def test_a_source_yields_samples_in_order_with_times_and_bounds(kind: str, start: Callable[[str], Device]) -> None:
    device, opened_ns = start(kind), time.monotonic_ns()
    with device.open() as source:
        found = samples(source, 15)
        require_contract(found, opened_ns)
        assert [s for s in found if isinstance(s, Frame) or s.status is PoseStatus.OK], "some can be used"
        seconds = [s for s in found if isinstance(s, Pose) and s.witness is not None]
        assert bool(seconds) == kind.endswith("-witness"), "a second body where one is named, and nowhere else"
        require_timeouts(source)
    source.__exit__(None, None, None)
    with device.open() as source:
        require_contract(samples(source, 5), opened_ns)


def require_timeouts(source: TrackerSource | VideoSource) -> None:
    """A read takes no longer than it was given, and finds nothing when it is given less than a period."""
    found = []
    for _ in range(15):
        began_s = time.monotonic()
        found.append(source.read(0.003))
        assert time.monotonic() - began_s < 0.003 + SLACK_S
    assert None in found
    began_s = time.monotonic()
    source.read(0.0)
    assert time.monotonic() - began_s < SLACK_S


@pytest.mark.parametrize("kind", [name for name, rig in RIGS.items() if not rig.is_variant])
def test_a_device_that_is_gone_is_lost_and_comes_back(kind: str, start: Callable[[str], Device]) -> None:
    device = start(kind)
    with device.open() as source:
        samples(source, 3)
        device.end()
        began_s = time.monotonic()
        with pytest.raises(DeviceLost) as loss:
            samples(source, 1000)
        assert time.monotonic() - began_s < DEADLINE_S + SLACK_S
        assert loss.value.where
    with pytest.raises(DeviceLost):
        device.open()
    device.start()
    with device.open() as source:
        samples(source, 3)


@pytest.mark.parametrize("kind", SILENT)
def test_a_tracker_that_freezes_is_lost_within_its_deadline(kind: str, start: Callable[[str], Device]) -> None:
    """Stopped as a whole, it answers nothing and closes nothing: a half-open line."""
    device = start(kind)
    assert device.process is not None
    with device.open() as source:
        samples(source, 3)
        device.process.send_signal(signal.SIGSTOP)
        began_s = time.monotonic()
        with pytest.raises(DeviceLost):
            samples(source, 1000)
        assert time.monotonic() - began_s < 2 * DEADLINE_S + SLACK_S
    device.process.send_signal(signal.SIGCONT)
    with until(lambda: _reopened(device)) as source:
        assert samples(source, 3)


def _reopened(device: Device) -> TrackerSource | VideoSource | None:
    try:
        return device.open()
    except DeviceLost:
        return None


@pytest.mark.parametrize("opener", [open_tracker, open_video])
def test_a_replay_keeps_the_same_promises(tmp_path: Path, opener: Callable[..., TrackerSource | VideoSource]) -> None:
    world, path = World(2), tmp_path / "session.mha"
    image = np.zeros((16, 24), np.uint8)
    session = [
        SequenceItem(round(n * 2e7), image, {"ProbeToTracker": world.measured_pose(n / 50, n)}, sequence=n)
        for n in range(1, 26)
    ]
    write_metaimage(path, session, (24, 16))
    for _ in range(2):
        opened_ns = time.monotonic_ns()
        with opener(f"replay:{path}?start_s=0.1", HostClock()) as source:
            require_contract(samples(source, 5), opened_ns)
            require_timeouts(source)
            with pytest.raises(DeviceLost, match="the recording has ended"):
                samples(source, 1000)
        source.__exit__(None, None, None)
