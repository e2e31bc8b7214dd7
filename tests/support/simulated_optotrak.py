"""A simulated First Principles server in a thread of the test, and faults at its switch."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread

import numpy as np

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.samples import Matrix4, Pose, PoseStatus
from probewatch.drivers.trackers.optotrak.tracker import OptotrakTracker, open_tracker
from probewatch.drivers.twins.fault_control import FaultControl
from probewatch.drivers.twins.faults import Episode, Schedule
from probewatch.drivers.twins.optotrak.first_principles import Device
from probewatch.drivers.twins.optotrak.tracker import FAULTS, OptotrakTwin
from probewatch.drivers.twins.tool_motion import PROBE
from tests.support.rigs import Line, Rig


def moving(tool: str, t_s: float, number: int) -> Matrix4 | None:
    """The probe goes along x at 10 mm/s, turned 30° about z; the reference lies still, turned 90° about z."""
    matrix = np.eye(4)
    angle = np.radians(30 if tool == PROBE else 90)
    matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    matrix[:3, 3] = (10 * t_s, 20, -1600) if tool == PROBE else (100, 0, -1500)
    return matrix


@dataclass
class Bench:
    twin: OptotrakTwin
    clock: HostClock

    @property
    def target(self) -> str:
        host, port = self.twin.address
        return f"{host}:{port}"

    def open(self, **options: str) -> OptotrakTracker:
        """Connect; a busy host is given time unless the options say otherwise."""
        return open_tracker(self.target, {"deadline_ms": "1000"} | options, self.clock)

    def show(self, *faults: str) -> None:
        """These faults from now on, and no others."""
        assert set(faults) <= set(FAULTS)
        self.twin.faults = FaultControl(FAULTS, Schedule(tuple(Episode(fault, 0.0) for fault in faults)))

    def is_back(self) -> bool:
        """A server needs no time for that."""
        return True

    def measured_s(self, sequence: int) -> float:
        """World time of a frame by its number."""
        return sequence / self.twin.device.frame_hz


@contextmanager
def bench(rate: float = 1.0, device: Device | None = None) -> Iterator[Bench]:
    clock, stop = HostClock(rate), Event()
    with OptotrakTwin(("127.0.0.1", 0), clock, device or Device(moving), FaultControl(FAULTS)) as twin:
        thread = Thread(target=twin.run, args=(stop,))
        thread.start()
        try:
            yield Bench(twin, clock)
        finally:
            stop.set()
            thread.join()


def poses(tracker: OptotrakTracker, count: int) -> list[Pose]:
    found = [tracker.read(1.0) for _ in range(count)]
    assert all(found), "a pose within a second of the clock"
    return [pose for pose in found if pose is not None]


def until(tracker: OptotrakTracker, wanted: PoseStatus | Callable[[Pose], bool], limit: int = 200) -> Pose:
    """The first pose of that status, or that is as wanted."""
    for _ in range(limit):
        pose = tracker.read(1.0)
        if pose is not None and (pose.status is wanted if isinstance(wanted, PoseStatus) else wanted(pose)):
            return pose
    raise AssertionError(f"no {wanted} pose came")


@contextmanager
def _line(_: Path, rate: float) -> Iterator[tuple[str, Bench]]:
    with bench(rate) as server:
        yield f"optotrak://{server.target}", server


def _start(*more: str) -> Callable[[Path], list[str]]:
    return lambda _: ["optotrak", "--tcp", "0", *more]


RIGS = (
    Rig("optotrak", "optotrak", "tracker", _start()),
    Rig("optotrak-single", "optotrak", "tracker", _start(), "mode=single&order=little&reference=2", is_variant=True),
    Rig("optotrak-witness", "optotrak", "tracker", _start("--bodies", "3"), "reference=2&witness=3", is_variant=True),
)
LINES = (Line("optotrak", _line, ("lose-tracker", "dribble", "unplug")),)
