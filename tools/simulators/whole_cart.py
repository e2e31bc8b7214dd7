"""Runs a cart on one machine: scanner, tracker and relay board as twins, and the service, each its own process; where
it is wanted, an OpenIGTLink server between the first two and the service.
"""

import json
import os
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.service.host.child_process import ONE_THREAD
from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.closable import Closable
from probewatch.drivers.errors import DeviceLost, ProbewatchError
from probewatch.drivers.files.atomic_file import replacing
from probewatch.drivers.twins.faults import PICTURE_FAULTS, Schedule
from probewatch.drivers.twins.scene.surroundings import RIGID
from probewatch.drivers.twins.scene.world import World
from probewatch.tools.simulators.run_with_parent import with_parent

Event = dict[str, Any]

_PROBEWATCH = [sys.executable, "-P", "-c", "from probewatch.tools.cli import main; main()"]
TWINS = {
    "scanner": [*_PROBEWATCH, "simulate", "scanner"],
    "polaris": [*_PROBEWATCH, "simulate", "ndi", "--model", "polaris-spectra"],
    "relay_board": [*_PROBEWATCH, "simulate", "relay"],
}
"""Commands that start each twin."""
SERVER = "server"
"""Name of the OpenIGTLink server among the twins."""
_READY_S = 30.0
"""Seconds that a part may take to serve: it loads its libraries beside three others. Less gives up on busy machines."""
_END_S = 10.0
"""Seconds between SIGTERM and SIGKILL: the service waits up to 2 s for a disk, and 1 s for each device that hangs."""
_LAST_LINES = 8
"""Lines of the log of a part that ended by itself: the end of a traceback, and a few lines before it."""
_DEADLINE_MS = 250.0
_LONGEST_DEADLINE_MS = 5000.0
"""`deadline_ms` of the tracker in real time, longer on a cart that is faster, and the most that it takes
(docs/trackers.md): a little more than the default, 200, as the tracker shares the processors with the scanner.
"""


def status_of(socket: Path) -> Event:
    """Returns the status of the service behind this control socket; empty while it does not answer."""
    try:
        with ControlClient(socket) as client:
            return client.status()
    except ProbewatchError:
        return {}


class Part:
    """Represents one process. said: its JSON lines with `heard_s` (host, s) added. noise: lines that are not JSON.

    It is in a process group of its own, so Ctrl-C in the terminal reaches it only through end().
    """

    def __init__(self, name: str, command: list[str]) -> None:
        self.name = name
        self.said: list[Event] = []
        self.noise: list[str] = []
        self._last: deque[str] = deque(maxlen=_LAST_LINES)
        self.process = subprocess.Popen(
            with_parent(*command),
            text=True,
            errors="replace",
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=os.environ | ONE_THREAD,
            process_group=0,
        )
        self._reader = threading.Thread(target=self._read, name=name, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._last.append(line.rstrip())
            try:
                self.said.append({**json.loads(line), "heard_s": time.monotonic()})
            except (ValueError, TypeError):
                self.noise.append(line)

    def find(self, since_s: float = 0.0, **fields: object) -> Event | None:
        """Returns the first line with these fields heard after since_s."""
        for event in tuple(self.said):
            if event["heard_s"] >= since_s and fields.items() <= event.items():
                return event
        return None

    def require(self) -> None:
        """Raises DeviceLost with the last lines of its log when the process has ended by itself."""
        code = self.process.poll()
        if code is None:
            return
        self._reader.join(1)
        how = f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
        log = "".join(f"\n    {line}" for line in self._last) or " nothing"
        raise DeviceLost(f"{self.name} {how}; its last lines:{log}", "simulated cart")

    def end(self, kill: bool = False) -> int:
        """Ends the process by SIGTERM, or SIGKILL where it ignores that or kill is set, and returns its exit code."""
        if self.process.poll() is None:
            (self.process.kill if kill else self.process.terminate)()
        try:
            code = self.process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            code = self.process.wait()
        self._reader.join(5)
        if self.process.stdout is not None and not self._reader.is_alive():
            self.process.stdout.close()
        return code


@dataclass(frozen=True, slots=True)
class CartSettings:
    """Holds the settings of a cart. seed: that of the world. rate: seconds of the cart per second. served: whether
    scanner and tracker come through an OpenIGTLink server, as behind PLUS. fps: pictures per second of the cart.
    tissue: what is scanned (`surroundings`).
    """

    seed: int = 1
    rate: float = 1.0
    served: bool = False
    fps: float = 30.0
    tissue: str = RIGID


class NotReady(DeviceLost):
    """Reports that a part which is alive did not come up, or did not answer, in time."""


class SimulatedDevices(Closable):
    """Runs the devices, everything under `folder`; leaving the context ends every process. Time 0 is the creation of
    this object.

    pause: waits for a number of seconds; what it raises ends the start. twins: the processes, once started. config: the
    configuration of a service that fits them, also as config_text. tank: while this file exists, the probe is held over
    a cross-wire in water.
    """

    def __init__(
        self, folder: Path, settings: CartSettings | None = None, pause: Callable[[float], None] = time.sleep
    ) -> None:
        self.folder, self.settings, self._pause = folder, settings or CartSettings(), pause
        self.clock = HostClock(self.settings.rate, time.monotonic_ns())
        self.socket = folder / "control"
        self.config = folder / "probewatch.toml"
        self.tank = folder / "tank"
        self.config_text = ""
        self.twins: dict[str, Part] = {}
        self._devices: dict[str, str] = {}
        self._port = 0

    def __enter__(self) -> Self:
        try:
            self._start()
        except BaseException:
            self.close()
            raise
        return self

    def _start(self) -> None:
        for name in TWINS:
            self.launch_twin(name)
        image_to_probe = World(self.settings.seed).image_to_probe
        calibration = replace(calibration_from_image_to_probe(image_to_probe, (640, 480)), simulated=True)
        write_calibration(self.folder / "probe.toml", calibration, {"source": "the truth of the simulated world"})
        urls = {name: self.await_twin(name) for name in TWINS}
        if self.settings.served:
            self._devices = urls
            self.launch_twin(SERVER)
            urls = urls | dict.fromkeys(("scanner", "polaris"), self.await_twin(SERVER))
        self.config_text = self._configuration(urls)
        self.config.write_text(self.config_text)

    def close(self) -> None:
        """Ends every process."""
        for part in self.twins.values():
            part.end()

    def now_s(self) -> float:
        """Returns the time of the cart, s."""
        return (self.clock.now_ns() - self.clock.origin_ns) / 1e9

    def launch_twin(self, name: str) -> None:
        """Starts the process; await_twin waits until it serves."""
        if name == SERVER:
            self._launch_server()
            return
        place = self.folder / name
        scanned = ["--fps", str(self.settings.fps), "--tissue", self.settings.tissue]
        options = {
            "scanner": ["--socket", str(place), "--control", f"{place}.json", *scanned],
            "polaris": ["--pty", str(place), "--rom", str(self.folder / "probe.rom"), "--control", f"{place}.json"],
            "relay_board": ["--pty", str(place)],
        }[name]
        world = ["--seed", str(self.settings.seed), "--tank", str(self.tank)] if name != "relay_board" else []
        self.twins[name] = Part(name, [*TWINS[name], *options, *self._time(), *world])

    def _launch_server(self) -> None:
        """Starts the server, again at the port that it had."""
        control = ["--control", str(self.folder / f"{SERVER}.json")]
        devices = ["--video", self._devices["scanner"], "--tracker", self._devices["polaris"]]
        command = [*_PROBEWATCH, "simulate", "openigtlink", "--tcp", str(self._port), *devices, *control]
        self.twins[SERVER] = Part(SERVER, [*command, *self._time()])

    def _time(self) -> list[str]:
        return ["--origin-ns", str(self.clock.origin_ns), "--rate", str(self.settings.rate)]

    def kill_twin(self, name: str) -> None:
        """Kills a twin, as when its power fails. The name of its pseudo-terminal is removed first: the kernel gives the
        number of a closed one to the next process that asks, and the service would open another cart's device by it.
        """
        place = self.folder / name
        if place.is_symlink():
            place.unlink()
        self.twins[name].end(kill=True)

    def await_twin(self, name: str) -> str:
        """Returns the URL under which a twin serves. Raises DeviceLost when it ends or hangs before it is ready."""
        twin = self.twins[name]
        deadline_s = time.monotonic() + _READY_S
        while (ready := twin.find(ready=True)) is None:
            twin.require()
            if time.monotonic() > deadline_s:
                what = f"{name} is not ready after {_READY_S:g} s"
                raise NotReady(what, "simulated cart", "Try again when the machine is less busy")
            self._pause(0.01)
        if name == SERVER:
            self._port = int(str(ready["url"]).partition("?")[0].rpartition(":")[2])
        return str(ready["url"])

    def show_faults(self, schedule: Schedule) -> None:
        """Makes each twin show its own of these faults from now on, and no others; within 50 ms of the cart's time."""
        pictures = tuple(one for one in schedule.episodes if one.fault in PICTURE_FAULTS)
        others = tuple(one for one in schedule.episodes if one.fault not in PICTURE_FAULTS)
        for name, episodes in (("scanner", pictures), ("polaris", others)):
            with replacing(self.folder / f"{name}.json") as file:
                file.write(Schedule(episodes).to_json().encode())

    def require_alive(self) -> None:
        """Raises DeviceLost naming the part that has ended by itself, with the last lines of its log."""
        for part in self.twins.values():
            part.require()

    def _configuration(self, urls: dict[str, str]) -> str:
        """Returns the configuration, with absolute paths, so that the text may be put anywhere. The tracker's deadline
        runs on the cart's clock, which may be faster than the machine.
        """
        deadline_ms = min(max(1.0, self.settings.rate) * _DEADLINE_MS, _LONGEST_DEADLINE_MS)
        return (
            f'video.url = "{urls["scanner"]}"\n'
            f'tracker.url = "{urls["polaris"]}&deadline_ms={deadline_ms:g}"\n'
            f'output = [{{ url = "{urls["relay_board"]}" }}]\n'
            f'calibration.file = "{self.folder / "probe.toml"}"\n'
            f'control.socket = "{self.socket}"\n'
            f'alarm.folder = "{self.folder / "alarms"}"\n'
        )


class SimulatedCart(SimulatedDevices):
    """Runs the devices and the service between them. daemon: its process, once started."""

    daemon: Part | None = None

    def _start(self) -> None:
        super()._start()
        self.start_daemon()

    def close(self) -> None:
        """Ends the service first, so that it opens the contact on a relay board that still listens."""
        if self.daemon is not None:
            self.daemon.end()
        super().close()

    def start_daemon(self) -> None:
        """Starts the service on the configuration that has been written."""
        rate = ["--clock-rate", str(self.settings.rate), "--clock-origin-ns", str(self.clock.origin_ns)]
        self.daemon = Part("service", [*_PROBEWATCH, "run", "--config", str(self.config), *rate])

    def require_alive(self) -> None:
        """Raises DeviceLost naming the part that has ended by itself, with the last lines of its log."""
        super().require_alive()
        if self.daemon is not None:
            self.daemon.require()

    def status(self) -> Event:
        """Returns what the service reports; empty while it does not answer."""
        return status_of(self.socket)

    def acknowledge(self) -> bool:
        """Acknowledges the alarm, and returns whether the service granted it."""
        try:
            with ControlClient(self.socket) as client:
                client.acknowledge()
        except ControlRefused:
            return False
        return True
