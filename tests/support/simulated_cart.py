"""The whole service in one process and on one clock that the test moves: what takes a minute of a cart takes a moment.

Everything of the service is the real thing, put together by its own composition root: tick, supervisor, control socket,
alarm log, references, reload, the threads of the devices, the rings and the estimator's loop. Its relay board is
simulated behind a pseudo-terminal, so that the real driver switches it by real bytes. In place of other processes and
of hardware stand the estimator's loop, in this process, and a scanner and a tracker that hand over samples.

Nothing here shows how fast the service is, nor what a killed process leaves behind: tests/live does.
"""

import io
import json
import select
import shutil
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
import structlog

from probewatch.appliance.configuration.config import load_config
from probewatch.appliance.core.line import Line
from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.service.control.deadline_worker import DeadlineWorker
from probewatch.appliance.service.control.references import References
from probewatch.appliance.service.control.rights import Onlookers
from probewatch.appliance.service.control.server import ControlRefused, ControlServer
from probewatch.appliance.service.daemon import SOONEST_NS, Daemon, Surroundings
from probewatch.appliance.service.devices.cart_devices import Openers
from probewatch.appliance.service.estimator.loop import MakeLine
from probewatch.appliance.service.host.log import configure, get_log
from probewatch.appliance.service.host.pressure import Pressure
from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.appliance.supervision.supervisor import TICK_NS
from probewatch.drivers.registry import open_output
from probewatch.drivers.samples import Frame, Pose, PoseStatus, Stamp
from probewatch.drivers.twins.faults import FUTURE_S, Schedule, blank_image, pose_time_s, spoil_pose
from probewatch.drivers.twins.ndi.measurement import ONE_IN
from probewatch.drivers.twins.relay_board import Change
from probewatch.drivers.twins.scene.trajectory import USUAL_PROGRAM
from probewatch.drivers.twins.scene.world import World, WorldSettings
from tests.support.boards import running_board
from tests.support.manual_clock import SteppedClock, TimelessClock
from tests.support.polling import until
from tests.support.service_parts import ERR_NS, LOOK_MS, Device, EstimatorHere
from tests.support.sessions import kept
from tests.support.stand_in_daemon import TrustingLine

SIZE_PX = (640, 480)
FPS, POSES_HZ = 10, 20
"""A line that trusts every picture sees no more in more of them."""
_TIMEOUT_S = 30.0
"""Of real time for which the service waits for a file: its own tenth of a second is what a busy computer may exceed."""
_SERVED_S = 0.25
"""Of the cart's time that passes with each request of a program that knows nothing of this clock: some ticks."""

_T = TypeVar("_T")
Event = dict[str, Any]


class SimulatedCart:
    """A cart under `folder`; leave the context to end it. make_line: of the estimator; by default one that says OK of
    every picture, or what `say` tells it. more: of the configuration.

    now_s: the cart's time since it was made. lateness_s: by how much each tick comes too late. pressure: share of the
    time for which programs wait for the processor, as the kernel tells it. utc: the calendar's time at the cart's 0.
    slept_s: for how long the computer has slept so far.
    """

    def __init__(self, folder: Path, make_line: MakeLine | None = None, seed: int = 3, more: str = "") -> None:
        self.folder, self.seed, self._more = folder, seed, more
        self.config, self.socket = folder / "probewatch.toml", folder / "control"
        self.clock = SteppedClock()
        self._origin_ns = self.clock.now_ns()
        self._make_line = make_line or self._trusting
        self.scanner = Device(self.clock, round(1e9 / FPS), self.picture)
        self.tracker = Device(self.clock, round(1e9 / POSES_HZ), self.pose)
        self.lateness_s = self.pressure = self.slept_s = 0.0
        self.utc = datetime.now(UTC)
        self._fault = ""
        self.changes: list[Change] = []
        self.daemon: Daemon | None = None
        self._pressed_us = 0
        self._log = io.StringIO()
        self._board_runs, self._service_runs = ExitStack(), ExitStack()
        self._due_ns = self._ticked_ns = self.clock.now_ns()

    def __enter__(self) -> Self:
        self._write_files()
        try:
            self.start_board()
            self.start_daemon()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """The service first, so that it opens the contact on a board that still listens."""
        self.end_daemon()
        self._board_runs.close()

    # What the cart is made of

    def _write_files(self) -> None:
        calibration = replace(calibration_from_image_to_probe(World(self.seed).image_to_probe, SIZE_PX), simulated=True)
        write_calibration(self.folder / "probe.toml", calibration, {"source": "the truth of the simulated world"})
        (self.folder / "proc" / "pressure").mkdir(parents=True)
        self._tell_pressure()
        self.config.write_text(
            f'video.url = "sim:{self.folder / "scanner"}"\n'
            f'tracker.url = "ndi:{self.folder / "polaris"}?deadline_ms=250"\n'
            f'output = [{{ url = "relay:{self.folder / "relay_board"}" }}]\n'
            f'calibration.file = "{self.folder / "probe.toml"}"\n'
            f'control.socket = "{self.socket}"\n'
            f'alarm.folder = "{self.alarms}"\n'
            f"feed.offered = false\n{self._more}"
        )

    @property
    def alarms(self) -> Path:
        """Folder of the alarm log."""
        return self.folder / "alarms"

    def picture(self, t_ns: int, number: int) -> Frame:
        return Frame(Stamp(t_ns, ERR_NS), number, _PICTURE)

    def pose(self, t_ns: int, number: int) -> Pose:
        return Pose(Stamp(t_ns, ERR_NS), number, np.eye(4), 0.1, PoseStatus.OK)

    def _trusting(self, *settings: Any) -> TrustingLine:
        return TrustingLine(*settings, lambda: self._fault)

    def start_board(self) -> None:
        """The relay board is plugged in."""
        link, clock = self.folder / "relay_board", TimelessClock(told_ns=self.clock.told_ns)
        self._board_runs.enter_context(running_board(link, clock, on_change=self.changes.append))

    def kill_board(self) -> None:
        """As when its power fails."""
        self._board_runs.close()

    def start_daemon(self) -> None:
        """The service, on the configuration that has been written."""
        config, timeout_s = load_config(self.config), _TIMEOUT_S
        around = Surroundings(
            Openers(self.scanner.opened, self.tracker.opened, open_output),
            lambda: Pressure(self.folder / "proc", self.folder / "no groups"),
            lambda: DeadlineWorker(timeout_s),
            self._wall_ns,
            lambda: (round(self.slept_s * 1e9), round(self.slept_s * 1e9)),
        )
        with ExitStack() as running:
            running.callback(structlog.reset_defaults)
            running.enter_context(configure("debug", self._log))
            references = References(config, lambda: datetime.fromtimestamp(self._wall_ns() / 1e9, UTC), self.clock)
            stale_ns = config.supervisor.timeouts().stale_ns
            self.estimator = EstimatorHere(self._make_line, config.limits, stale_ns, self.clock)
            running.callback(self.estimator.close)
            onlookers = Onlookers.of(config).all
            self.control = running.enter_context(ControlServer(self.socket, config.control.group, onlookers))
            running.callback(self.clock.let_go, False)
            self.daemon = running.enter_context(
                Daemon(config, self.config, references, self.estimator, self.clock, self.control, around)
            )
            running.callback(self.clock.let_go, True)
            self._service_runs = running.pop_all()
        self._due_ns = self._ticked_ns = self.clock.now_ns()
        self._settle()

    def end_daemon(self) -> None:
        """As SIGTERM ends it."""
        self._service_runs.close()
        self.daemon = None

    def kill_daemon(self) -> None:
        """SIGKILL, as far as the disk can tell: what an orderly end writes is taken back."""
        kept = self.folder / "kept"
        shutil.copytree(self.alarms, kept)
        self.end_daemon()
        shutil.rmtree(self.alarms)
        kept.rename(self.alarms)

    # Time

    def now_s(self) -> float:
        return (self.clock.now_ns() - self._origin_ns) / 1e9

    def run(self, seconds: float) -> None:
        """Let so much of the cart's time pass."""
        end_ns = self.clock.now_ns() + round(seconds * 1e9)
        while self._next_ns() <= end_ns:
            self._go_on()
        self.clock.move(end_ns)

    def tick(self) -> None:
        """To the end of the next tick."""
        before_ns = self._ticked_ns
        while self._ticked_ns == before_ns:
            self._go_on()

    def until(self, look: Callable[[], _T], within_s: float = 20.0) -> _T:
        """First true value of look(), asked after each tick; AssertionError after so much of the cart's time."""
        end_s = self.now_s() + within_s
        while not (found := look()):
            assert self.now_s() < end_s, f"after {within_s:g} s: {self.status()}"
            self.tick()
        return found

    def _next_ns(self) -> int:
        return max(self.clock.now_ns(), round(min(self._due_ns, self.clock.next_ns())))

    def _go_on(self) -> None:
        """To the next moment at which something is due, and through it."""
        assert self.daemon is not None
        self.clock.move(self._next_ns())
        self._settle()
        now_ns = self.clock.now_ns()
        if self.estimator.here is not None:
            self.estimator.here.compute()
        if self.estimator.has_spoken and not self.lateness_s:
            self._due_ns = min(self._due_ns, max(now_ns, self._ticked_ns + SOONEST_NS))
        if now_ns >= self._due_ns:
            self._tell_pressure()
            self._ticked_ns = self.daemon.step()
            self._due_ns = self._ticked_ns + TICK_NS + round(self.lateness_s * 1e9)
            self._settle()

    def _settle(self) -> None:
        assert self.daemon is not None
        self.clock.settle(self.daemon.threads)

    def _wall_ns(self) -> int:
        return round(self.utc.timestamp() * 1e9) + self.clock.now_ns() - self._origin_ns

    def _tell_pressure(self) -> None:
        """As /proc/pressure does; what is open stays the same file."""
        pressed_us = round(self.pressure * (self.clock.now_ns() - self._ticked_ns) / 1e3)
        if self.daemon is not None and not pressed_us:
            return
        self._pressed_us += pressed_us
        for name in ("cpu", "memory"):
            text = f"some avg10=0.00 avg60=0.00 avg300=0.00 total={self._pressed_us:020d}\n"
            with (self.folder / "proc" / "pressure" / name).open("r+" if self.daemon else "w") as file:
                file.write(text)

    # What a person does and sees

    @contextmanager
    def client(self) -> Iterator[ControlClient]:
        """A client of the control socket, for each of whose requests the service ticks once."""
        with ControlClient(self.socket) as client:
            client._lines = _Ticking(self, client._lines)  # type: ignore[assignment]
            yield client

    @contextmanager
    def served(self, each_s: float = _SERVED_S) -> Iterator[None]:
        """While programs ask that know nothing of this clock: so much time passes with each request."""
        ending = threading.Event()
        with ThreadPoolExecutor(1) as pool:
            serving = pool.submit(self._serve, ending, each_s)
            try:
                yield
            finally:
                ending.set()
            serving.result()

    def _serve(self, ending: threading.Event, each_s: float) -> None:
        while not ending.is_set():
            if self._asked():
                self.run(each_s)

    def _asked(self) -> bool:
        """Whether somebody wants something of the control socket, now or within a moment."""
        asking, control = select.poll(), self.control
        for link in (control._listener, *(client.link for client in (*control._silent, *control._clients))):
            asking.register(link, select.POLLIN)
        return bool(asking.poll(LOOK_MS))

    def status(self) -> Event:
        with self.client() as client:
            return client.status()

    def acknowledge(self) -> bool:
        """Whether the service granted it."""
        try:
            with self.client() as client:
                client.acknowledge()
        except ControlRefused:
            return False
        return True

    def say(self, fault: str | None) -> None:
        """What the trusting line is to say from now on; None is OK again."""
        self._fault = fault or ""

    def wait_for(self, state: str, within_s: float = 20.0) -> Event:
        """The status in that state; AssertionError unless it was entered within so much of the cart's time."""
        return self.until(lambda: (now := self.status())["state"] == state and now, within_s)

    def monitoring(self, within_s: float = 20.0) -> Self:
        """Once it monitors and its contact is closed."""
        self.wait_for("monitoring", within_s)
        self.until(self.contact)
        return self

    def contact(self, since_s: float = 0.0) -> bool | None:
        """What the relay board did last since then; None: nothing."""
        switched = self.switched(since_s)
        return switched[-1][1] if switched else None

    def switched(self, since_s: float = 0.0) -> list[tuple[float, bool]]:
        """(s of the cart, whether the contact closed) of every change since then, as the board tells."""
        times = [((one["t_ns"] - self._origin_ns) / 1e9, bool(one["energised"])) for one in self.changes]
        return [(t_s, energised) for t_s, energised in times if t_s >= since_s]

    def open_contact(self, since_s: float, within_s: float) -> None:
        """AssertionError unless the board opened within that time."""
        self.until(lambda: self.contact(since_s) is False, within_s + since_s - self.now_s() + TICK_NS / 1e9)
        after_s = next(t_s for t_s, energised in self.switched(since_s) if not energised) - since_s
        assert after_s <= within_s, f"the contact opened after {after_s:.2f} s"

    def kill_estimator(self, number: int = signal.SIGKILL) -> None:
        """A signal ends it."""
        assert self.estimator.here is not None
        self.estimator.here.send_signal(number)

    def said(self, **fields: object) -> list[Event]:
        """The service's log up to now: lines with these fields."""
        mark = f"all up to {len(self._log.getvalue())}"
        get_log().info(mark)
        until(lambda: mark in self._log.getvalue())
        lines = [json.loads(line) for line in self._log.getvalue().splitlines() if line.endswith("}")]
        return [line for line in lines if fields.items() <= line.items() and "all up to" not in line["event"]]


class WorldCart(SimulatedCart):
    """A cart whose real line sees the simulated world, at a scanner's and a tracker's usual rates: a second of it takes
    most of a second to compute.

    faults: what scanner and tracker show from now on, at seconds of the cart.
    """

    def __init__(self, folder: Path, seed: int = 1, more: str = "") -> None:
        super().__init__(folder, Line, seed, more)
        self.world = kept(seed, USUAL_PROGRAM, settings=WorldSettings(*SIZE_PX))
        self.scanner.period_ns, self.tracker.period_ns = round(1e9 / 30), round(1e9 / 60)
        self.faults, self._shown = Schedule(), frozenset[str]()

    def picture(self, t_ns: int, number: int) -> Frame:
        t_s = (t_ns - self._origin_ns) / 1e9
        active, before = self.faults.active(t_s), self._shown
        self._shown = active
        image = self.world.frame(t_s, number, active)
        if "flicker-blank" in active and number % 2:
            image = blank_image(image.shape, number)
        ahead_ns = round(FUTURE_S * 1e9) if "future-stamp" in active - before else 0
        return Frame(Stamp(t_ns + ahead_ns, ERR_NS), number, image)

    def pose(self, t_ns: int, number: int) -> Pose:
        t_s = (t_ns - self._origin_ns) / 1e9
        active = self.faults.active(t_s)
        if "missing" in active or ("sparse-poses" in active and number % ONE_IN):
            return Pose(Stamp(t_ns, ERR_NS), number, None, 0.1, PoseStatus.MISSING)
        measured = self.world.measured_pose(pose_time_s(t_s, active), number)
        return Pose(Stamp(t_ns, ERR_NS), number, spoil_pose(measured, active), 0.1, PoseStatus.OK)


class _Ticking:
    """The lines of a client, before each of which the service ticks."""

    def __init__(self, cart: SimulatedCart, lines: Any) -> None:
        self._cart, self._lines = cart, lines

    def next(self, timeout_s: float) -> bytes:
        self._cart.tick()
        line: bytes = self._lines.next(timeout_s)
        return line


_PICTURE = np.full((SIZE_PX[1], SIZE_PX[0]), 90, np.uint8)
