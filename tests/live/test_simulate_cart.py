"""`probewatch simulate cart` and `probewatch run` beside each other, each started as a person would."""

import signal
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from probewatch.appliance.configuration.config import load_config
from probewatch.appliance.service.control.client import ControlClient
from probewatch.drivers.errors import ProbewatchError
from tests.support.demo_cart import PROBEWATCH
from tests.support.polling import until

Program = subprocess.Popen[str]


@pytest.fixture
def programs() -> Iterator[ExitStack]:
    """Ends what the test has left."""
    with ExitStack() as left:
        yield left


def start(programs: ExitStack, *arguments: str | Path) -> Program:
    command = [str(PROBEWATCH), *map(str, arguments)]
    program = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    programs.callback(program.communicate)
    programs.callback(program.kill)
    return program


def state(socket: Path) -> str:
    try:
        with ControlClient(socket) as client:
            return str(client.status()["state"])
    except ProbewatchError:
        return ""


@pytest.mark.alone
def test_the_service_beside_it_reaches_monitoring(tmp_path: Path, programs: ExitStack) -> None:
    file = tmp_path / "elsewhere" / "cart.toml"
    file.parent.mkdir()
    cart = start(programs, "simulate", "cart", "--write", file, "--folder", tmp_path / "parts")
    assert cart.stderr is not None
    assert f"probewatch run --config {file}" in cart.stderr.readline()
    service = start(programs, "run", "--config", file)
    socket = load_config(file).control.socket
    until(lambda: state(socket) == "monitoring", 60, 0.2, lambda: state(socket))
    service.send_signal(signal.SIGTERM)
    assert service.wait(20) == 0
    cart.send_signal(signal.SIGINT)
    assert cart.wait(20) == 0


def test_without_a_file_the_configuration_is_all_that_is_printed(tmp_path: Path, programs: ExitStack) -> None:
    cart = start(programs, "simulate", "cart", "--seed", "7")
    assert cart.stdout is not None
    lines = [cart.stdout.readline()]
    while not lines[-1].startswith("recorder.socket"):
        lines.append(cart.stdout.readline())
    file = tmp_path / "cart.toml"
    file.write_text("".join(lines))
    config = load_config(file)
    folder = config.control.socket.parent
    assert "SIMULATED" in lines[0]
    assert (config.video.url, config.calibration.file) == (f"sim:{folder}/scanner", folder / "probe.toml")
    cart.send_signal(signal.SIGTERM)
    assert (cart.wait(20), cart.stdout.read()) == (0, "")
    assert not folder.exists(), "nothing is left behind"


def test_a_misspelt_fault_is_refused_with_its_line_and_a_right_one_is_told(tmp_path: Path, programs: ExitStack) -> None:
    folder = tmp_path / "parts"
    cart = start(programs, "simulate", "cart", "--write", tmp_path / "cart.toml", "--folder", folder)
    assert cart.stderr is not None
    assert "ready" in cart.stderr.readline()
    file = folder / "scanner.json"
    for text, said in (
        ('[\n  "depth",\n  "flip-latreal"\n]', f"{file}, line 3: 'flip-latreal' is not a known fault. Did you mean"),
        ('["bend-marker"]', "the tracker shows it"),
        ('["depth"]', "scanner: shows depth"),
        ("", "scanner: shows no fault"),
    ):
        (new := tmp_path / "new").write_text(text)
        new.replace(file)
        assert said in cart.stderr.readline()
    (new := tmp_path / "new").write_text('["lose-traker"]')
    new.replace(folder / "polaris.json")
    assert "polaris: refused, and nothing changes" in cart.stderr.readline()
    cart.send_signal(signal.SIGINT)
    assert cart.wait(20) == 0
