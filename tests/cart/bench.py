"""What the tests do to either machine: configure the service, start twins, follow its state and its journal."""

import json
import subprocess
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe
from probewatch.drivers.twins.ndi.tool_definitions import make_rom
from probewatch.drivers.twins.scene.world import World
from probewatch.tools.simulators.whole_cart import TWINS
from tests.cart.guest import Ended
from tests.support.polling import until

UNIT = "probewatch.service"
CONFIG = "/etc/probewatch/probewatch.toml"
SEED = 3
RELAY, LAMP = 0, 1
"""Lines of the simulated GPIO chip."""
CONTACT = "gpio:/dev/gpiochip0?line=relay"
LONGER_TIMEOUTS = (
    "[supervisor]\nself_test_s = 120\nstarting_s = 120\nestimator_silence_ms = 5000\noutput_silence_ms = 5000\n"
)
"""Of a service under emulation, which starts for half a minute. Not measured beyond that it suffices."""


class Machine(Protocol):
    """Container or Guest. look_s: how often its state may be asked for without slowing it down."""

    look_s: float

    def sh(self, script: str, check: bool = True, timeout_s: float = 60.0) -> Ended: ...
    def put(self, path: str, text: str) -> None: ...


def configure(
    machine: Machine, video: str, tracker: str, outputs: Iterable[str], more: str = "", shrunk: int = 1
) -> None:
    """A whole configuration, with the true calibration of the simulated world. outputs: URLs, or `URL SIGNAL`.

    shrunk: so many pixels of the simulated scanner, in each direction, are one of the picture that arrives.
    """
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "calibration.toml"
        larger = np.diag([shrunk, shrunk, 1.0, 1.0])
        larger[:2, 3] = (shrunk - 1) / 2
        truth = calibration_from_image_to_probe(World(SEED).image_to_probe @ larger, (640 // shrunk, 480 // shrunk))
        write_calibration(place, truth, {"source": "the truth of the simulated world"})
        machine.put("/etc/probewatch/calibration.toml", place.read_text())
    rom = make_rom().hex()
    machine.sh(f"python3 -c \"open('/etc/probewatch/probe.rom','wb').write(bytes.fromhex('{rom}'))\"")
    urls = "".join(_output(*entry.split(" ")) for entry in outputs)
    machine.put(
        CONFIG,
        f'configured = true\n[video]\nurl = "{video}"\n[tracker]\nurl = "{tracker}"\n{urls}'
        f'[calibration]\nfile = "calibration.toml"\n{more}',
    )


def _output(url: str, signal: str = "contact") -> str:
    return f'[[output]]\nurl = "{url}"\nsignal = "{signal}"\n'


def show(machine: Machine, name: str) -> str:
    """One property of the unit."""
    return machine.sh(f"systemctl show --property={name} --value {UNIT}").out.strip()


def wait_status(machine: Machine, words: str | tuple[str, ...], deadline_s: float) -> float:
    """Until the unit's status text begins with one of the words; seconds waited. AssertionError after the deadline."""
    began_s = time.monotonic()
    wanted = tuple(f"StatusText={one}" for one in ((words,) if isinstance(words, str) else words))

    def shown() -> list[str]:
        return machine.sh(f"systemctl show --property=ActiveState,StatusText {UNIT}").out.splitlines()

    def reached() -> bool:
        lines = shown()
        return "ActiveState=active" in lines and any(line.startswith(wanted) for line in lines)

    until(reached, deadline_s, machine.look_s, lambda: f"{shown()}, not {words}\n{log_tail(machine)}")
    return time.monotonic() - began_s


def journal(machine: Machine, unit: str = UNIT, *matches: str) -> list[dict[str, Any]]:
    """Entries of a unit, the oldest first."""
    text = machine.sh(f"journalctl -u {unit} -o json --no-pager {' '.join(matches)}").out
    return [json.loads(line) for line in text.splitlines() if line.startswith("{")]


def device_events(machine: Machine, role: str) -> tuple[int, int]:
    """(how often the device was lost, how often it came back), by the journal."""
    found = [entry.get("PROBEWATCH_EVENT") for entry in journal(machine, UNIT, f"PROBEWATCH_DEVICE={role}")]
    return found.count("device lost"), found.count("device back")


def await_device_events(machine: Machine, role: str, lost: int, back: int, deadline_s: float) -> None:
    """Until the journal has exactly so many of each."""
    until(
        lambda: device_events(machine, role) == (lost, back),
        deadline_s,
        machine.look_s,
        lambda: f"{role} lost and back {device_events(machine, role)}, not {(lost, back)}\n{log_tail(machine)}",
    )


def gpio(machine: Machine, number: int = RELAY) -> int:
    """Level of a line of the simulated chip, as the line's own side sees it."""
    return int(machine.sh(f"cat /sys/devices/platform/gpio-sim.*/gpiochip*/sim_gpio{number}/value").out)


def await_gpio(machine: Machine, number: int, level: int, deadline_s: float) -> float:
    """Seconds until the line has that level."""
    began_s = time.monotonic()
    otherwise = f"line {number} stays {1 - level}"
    until(lambda: gpio(machine, number) == level, deadline_s, 0.2, lambda: f"{otherwise}\n{log_tail(machine)}")
    return time.monotonic() - began_s


def log_tail(machine: Machine, lines: int = 25) -> str:
    return machine.sh(f"journalctl -u {UNIT} -n {lines} --no-pager -o short-monotonic", check=False).out


class HostTwins:
    """The scanner and tracker twins as processes of this host, for the machine's plugs."""

    def __init__(self, folder: Path, fps: float, lead_s: float, rate: float = 1.0) -> None:
        """lead_s: how much ahead of the poses the pictures are sent, for the time that they spend in the loop.
        rate: seconds of the cart in a second. fps: pictures in a second of the cart.
        """
        self.scanner, self.tracker = folder / "scanner", folder / "tracker"
        origin_ns = time.monotonic_ns()
        shifted = str(origin_ns - round(lead_s * 1e9))
        common = ("--rate", str(rate), "--seed", str(SEED))
        self._parts = [
            self._start("scanner", "--socket", str(self.scanner), "--fps", str(fps), "--origin-ns", shifted, *common),
            self._start("polaris", "--pty", str(self.tracker), "--origin-ns", str(origin_ns), *common),
        ]
        for part in self._parts:
            assert part.stdout is not None
            assert json.loads(part.stdout.readline())["ready"]

    @staticmethod
    def _start(name: str, *options: str) -> "subprocess.Popen[str]":
        return subprocess.Popen([*TWINS[name], *options], stdout=subprocess.PIPE, text=True)

    def __enter__(self) -> "HostTwins":
        return self

    def __exit__(self, *_: object) -> None:
        for part in self._parts:
            part.kill()
            part.communicate()
