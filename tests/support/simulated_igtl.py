"""A simulated OpenIGTLink server in a thread of the test, with the poses of a world, and faults at its switch."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.twins.fault_control import FaultControl
from probewatch.drivers.twins.faults import Episode, Schedule
from probewatch.drivers.twins.openigtlink import FAULTS, IgtlTwin
from probewatch.drivers.twins.scene.world import World
from probewatch.drivers.twins.world_sources import WorldTracker
from tests.support.rigs import Line, Rig


@dataclass
class Bench:
    """world: whose poses are sent, number n at n / 60 s after the origin of the clock."""

    twin: IgtlTwin
    clock: HostClock
    world: World

    @property
    def target(self) -> str:
        host, port = self.twin.address
        return f"{host}:{port}"

    def show(self, *faults: str) -> None:
        """These faults from now on, and no others."""
        assert set(faults) <= set(FAULTS)
        self.twin.faults = FaultControl(FAULTS, Schedule(tuple(Episode(fault, 0.0) for fault in faults)))

    def is_back(self) -> bool:
        """A server needs no time for that."""
        return True


@contextmanager
def bench(rate: float = 1.0) -> Iterator[Bench]:
    clock, world, stop = HostClock(rate), World(2), Event()
    with IgtlTwin(("127.0.0.1", 0), clock, (lambda: WorldTracker(world, clock),), FaultControl(FAULTS)) as twin:
        thread = Thread(target=twin.run, args=(stop,))
        thread.start()
        try:
            yield Bench(twin, clock, world)
        finally:
            stop.set()
            thread.join()


@contextmanager
def _line(_: Path, rate: float) -> Iterator[tuple[str, Bench]]:
    with bench(rate) as relay:
        yield f"igtl://{relay.target}", relay


def _start(_: Path) -> list[str]:
    return ["openigtlink", "--tcp", "0"]


RIGS = (
    Rig("igtl", "igtl", "tracker", _start),
    Rig("igtl-video", "igtl", "video", _start),
    Rig("igtl-witness", "igtl", "tracker", _start, "witness=Witness", is_variant=True),
)
LINES = (Line("igtl", _line, ("stall", "unplug")),)
