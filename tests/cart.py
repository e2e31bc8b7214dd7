"""A whole cart on one machine: the three device twins and the service, each a process of its own."""

import json
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from appliance.calibration_file import calibration_from_image_to_probe, write_calibration
from appliance.control import ControlClient
from drivers.errors import ProbewatchError
from drivers.twins.world import World
from tests.polling import until

PROBEWATCH = Path(sys.executable).parent / "probewatch"
Event = dict[str, Any]


class Talker:
    """A process that says JSON lines on stdout or stderr; said holds them with `heard_s` added."""

    def __init__(self, command: list[str], stream: str) -> None:
        pipes = {stream: subprocess.PIPE}
        self.process = subprocess.Popen(command, text=True, **pipes)  # type: ignore[call-overload]
        self.said: list[Event] = []
        self.noise: list[str] = []
        self._pipe = getattr(self.process, stream)
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        for line in self._pipe:
            try:
                self.said.append({**json.loads(line), "heard_s": time.monotonic()})
            except ValueError:
                self.noise.append(line)

    def find(self, since_s: float = 0.0, **fields: object) -> Event | None:
        """First line with these fields heard after since_s."""
        for event in tuple(self.said):
            if event["heard_s"] >= since_s and fields.items() <= event.items():
                return event
        return None

    def end(self, kill: bool = False) -> int:
        """Exit code after SIGTERM, or SIGKILL."""
        if self.process.poll() is None:
            (self.process.kill if kill else self.process.terminate)()
        code = self.process.wait(10)
        self._reader.join(5)
        self._pipe.close()
        return code


class Cart:
    """Twins under folder; leave the context to end everything. trusting: see tests.stand_in_daemon."""

    def __init__(self, folder: Path, seed: int = 3, trusting: bool = False) -> None:
        self._folder, self._trusting, self._seed = folder, trusting, seed
        self.origin_ns = time.monotonic_ns()
        self.socket = folder / "control"
        self.config = folder / "probewatch.toml"
        self.twins: dict[str, Talker] = {}
        self.daemon: Talker

    def __enter__(self) -> Self:
        for name in ("scanner", "polaris", "relay_board"):
            self.start_twin(name)
        image_to_probe = World(self._seed).image_to_probe
        calibration = calibration_from_image_to_probe(image_to_probe, (640, 480))
        write_calibration(self._folder / "probe.toml", calibration, {"source": "the simulated world"})
        self._write_config()
        self.start_daemon()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.daemon.end()
        for twin in self.twins.values():
            twin.end()

    def start_twin(self, name: str) -> None:
        place = self._folder / name
        options = {
            "scanner": ["--socket", str(place)],
            "polaris": ["--pty", str(place), "--rom", str(self._folder / "probe.rom")],
            "relay_board": ["--pty", str(place)],
        }[name]
        common = ["--origin-ns", str(self.origin_ns), "--seed", str(self._seed)]
        self.twins[name] = Talker([sys.executable, "-m", f"drivers.twins.{name}", *options, *common], "stdout")
        until(lambda: self.twins[name].find(ready=True))

    def start_daemon(self) -> None:
        real = [str(PROBEWATCH), "run", "--config", str(self.config)]
        stand_in = [sys.executable, "-m", "tests.stand_in_daemon", str(self.config)]
        self.daemon = Talker(stand_in if self._trusting else real, "stderr")

    def status(self) -> Event:
        """Empty while the service does not answer."""
        try:
            with ControlClient(self.socket) as client:
                return client.status()
        except ProbewatchError:
            return {}

    def estimator_pid(self) -> int:
        """Of the service's one child."""
        pid = self.daemon.process.pid
        return int(Path(f"/proc/{pid}/task/{pid}/children").read_text().split()[0])

    def wait_for(self, state: str, deadline_s: float = 20.0) -> Event:
        def look() -> Event:
            status = self.status()
            return status if status.get("state") == state else {}

        return until(look, deadline_s)

    def contact(self, since_s: float = 0.0) -> bool | None:
        """What the relay board did last since then."""
        events = [event for event in self.twins["relay_board"].said if "energised" in event]
        return events[-1]["energised"] if events and events[-1]["heard_s"] >= since_s else None

    def open_contact(self, since_s: float, within_s: float) -> None:
        """AssertionError unless the relay board opened within that time."""
        until(lambda: self.contact(since_s) is False, within_s)

    def _write_config(self) -> None:
        urls = {name: twin.said[0]["url"] for name, twin in self.twins.items()}
        self.config.write_text(
            f"""
            video.url = "{urls["scanner"]}"
            tracker.url = "{urls["polaris"]}"
            output = [{{ url = "{urls["relay_board"]}" }}]
            calibration.file = "probe.toml"
            control.socket = "{self.socket}"
            """
        )
