"""A simulated NDI tracker in a thread of the test, so that a test can look into it and change it."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event, Thread

import numpy as np

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.registry import open_tracker
from probewatch.drivers.samples import Matrix4, Pose, PoseStatus
from probewatch.drivers.trackers.ndi.tracker import NdiTracker
from probewatch.drivers.twins.fault_control import FaultControl
from probewatch.drivers.twins.faults import Episode, Schedule
from probewatch.drivers.twins.ndi.combined_api import CombinedApi
from probewatch.drivers.twins.ndi.models import SPECTRA, VEGA, Model
from probewatch.drivers.twins.ndi.tool_definitions import PROBE, REFERENCE, make_rom
from probewatch.drivers.twins.ndi.tracker import NDI_FAULTS, NdiTwin
from probewatch.drivers.twins.pty_line import PtyLine
from probewatch.drivers.twins.tcp_line import TcpLine
from tests.support.rigs import Line, Rig

RATE = 4.0


def moving(tool: str, t_s: float, number: int = 0) -> Matrix4:
    """The probe goes along x at 10 mm/s, turned 30° about z; all other tools lie still, turned 90° about z."""
    matrix = np.eye(4)
    angle = np.radians(30 if tool == "probe" else 90)
    matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    matrix[:3, 3] = (10 * t_s, 20, -1600) if tool == "probe" else (100, 0, -1500)
    return matrix


@dataclass
class Bench:
    """A twin in a thread, and where its line and its tool definitions are."""

    twin: NdiTwin
    line: PtyLine | TcpLine
    clock: HostClock
    folder: Path

    @property
    def place(self) -> str:
        """The URL without its options."""
        if isinstance(self.line, TcpLine):
            return f"ndi+tcp://127.0.0.1:{self.line.port}"
        return f"ndi:{self.folder / 'tracker'}"

    def open(self, **options: str) -> NdiTracker:
        """Connect; the probe is a wireless tool unless the options say otherwise, and a busy host is given time."""
        wired = self.twin.device.model.electromagnetic
        wanted = {} if wired else {"probe": str(self.folder / "probe.rom")}
        wanted |= {"deadline_ms": str(min(500 * self.clock.rate, 5000))} | options
        query = "&".join(f"{key}={value}" for key, value in wanted.items())
        tracker = open_tracker(f"{self.place}?{query}", self.clock)
        assert isinstance(tracker, NdiTracker)
        return tracker

    def rom(self, name: str) -> str:
        return str(self.folder / f"{name}.rom")

    def handle(self, main_type: int = PROBE) -> int:
        return next(h for h, port in self.twin.device.ports.items() if port.main_type == main_type)

    def faults(self, *names: str) -> None:
        """Exactly these faults are on from now on."""
        now_s = (self.clock.now_ns() - self.clock.origin_ns) / 1e9
        episodes = tuple(Episode(name, now_s) for name in names)
        self.twin.control = FaultControl(NDI_FAULTS, Schedule(episodes))

    show = faults

    def is_back(self) -> bool:
        """The device starts again, and the line comes back, on the twin's own clock."""
        return self.twin._since == {} and not self.twin.starting

    def true(self, pose: Pose, tool: str = "probe") -> Matrix4:
        """Where the tool was at the measurement."""
        return moving(tool, self.twin.device.frame_s(pose.sequence))


@contextmanager
def bench(
    folder: Path,
    model: Model = SPECTRA,
    rate: float = RATE,
    schedule: Schedule | None = None,
    track_hz: int | None = None,
    wired: tuple[str, ...] = (),
    freeze_tag: str | None = None,
) -> Iterator[Bench]:
    """rate: how much faster than real its time runs. wired: what hangs on the plugs."""
    clock, stop = HostClock(rate), Event()
    for name, main_type in (("probe", PROBE), ("reference", REFERENCE)):
        (folder / f"{name}.rom").write_bytes(make_rom(main_type))
    model = replace(model, freeze_tag=freeze_tag or model.freeze_tag)
    with TcpLine(0, clock) if model.network else PtyLine(folder / "tracker", clock) as line:
        device = CombinedApi(moving, model, track_hz, wired=wired)
        twin = NdiTwin(line, clock, device, FaultControl(NDI_FAULTS, schedule))
        thread = Thread(target=_serve, args=(twin, stop))
        thread.start()
        try:
            yield Bench(twin, line, clock, folder)
        finally:
            stop.set()
            thread.join()


def _serve(twin: NdiTwin, stop: Event) -> None:
    try:
        twin.run(stop)
    except (OSError, ValueError):
        assert stop.wait(10), "only an unplugged line may end the twin"


def poses(tracker: NdiTracker, count: int) -> list[Pose]:
    """The next ones; each within ten seconds of the clock, which may run faster than a busy host. Word that the counter
    stands still is none of them: a busy host may hold up the twin.
    """
    return [until(tracker, None, limit=10) for _ in range(count)]


def until(tracker: NdiTracker, status: PoseStatus | None, limit: int = 60, reason: str = "") -> Pose:
    """The next pose of this status and with this in its reason; None: of any, but that the counter stands still."""
    for _ in range(limit):
        pose = tracker.read(1.0)
        if pose is None:
            continue
        wanted = "stood still" not in pose.reason if status is None else pose.status is status
        if wanted and reason in pose.reason:
            return pose
    raise AssertionError(f"no pose came that is {status or 'new'} {reason}")


def _line(model: Model) -> Callable[[Path, float], AbstractContextManager[tuple[str, Bench]]]:
    """With four tools, whose replies take their time on a serial line."""

    @contextmanager
    def opened(folder: Path, rate: float) -> Iterator[tuple[str, Bench]]:
        with bench(folder, model, rate) as cart:
            probe, reference = cart.rom("probe"), cart.rom("reference")
            yield f"{cart.place}?probe={probe}&reference={reference}&tools={probe},{probe}", cart

    return opened


def _start(model: str, *roms: str) -> Callable[[Path], list[str]]:
    """roms: options of tool definitions, each with the name of its file."""

    def arguments(folder: Path) -> list[str]:
        line = ["--tcp", "0"] if model == "vega" else ["--pty", str(folder / "tracker")]
        tools = [word for rom in roms for word in (f"--{rom}", str(folder / f"{rom}.rom"))]
        return ["ndi", "--model", model, *line, *tools]

    return arguments


RIGS = (
    Rig("ndi", "ndi", "tracker", _start("polaris-vicra", "rom")),
    Rig("ndi-aurora", "ndi", "tracker", _start("aurora"), is_variant=True),
    Rig("ndi-witness", "ndi", "tracker", _start("polaris-vicra", "rom", "witness-rom"), is_variant=True),
    Rig("ndi+tcp", "ndi+tcp", "tracker", _start("vega", "rom")),
)
_SILENCES = ("no-reply", "slow", "unplug")
LINES = (Line("ndi", _line(SPECTRA), (*_SILENCES, "baud-mismatch")), Line("ndi+tcp", _line(VEGA), _SILENCES))
