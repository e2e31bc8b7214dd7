"""`probewatch run` refuses what cannot work with one line and the right exit code; the service manager is told."""

import socket
import subprocess
from pathlib import Path

import pytest

from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.service.host.systemd_notify import Notifier
from probewatch.drivers.errors import DeviceLost
from tests.support.answers import answered
from tests.support.demo_cart import PROBEWATCH
from tests.support.polling import until
from tests.support.stores import PLUS, configuration, log, place, settled, started

__all__ = ["log"]
pytestmark = pytest.mark.usefixtures("log")

GOOD = """
video.url = "sim:/tmp/nowhere/scanner"
tracker.url = "ndi:/tmp/nowhere/tracker"
output = [{ url = "relay:/tmp/nowhere/relay" }]
calibration.file = "probe.toml"
"""


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (GOOD + "[limits]\nscale_procent = 3\n", "Did you mean 'scale_percent'?"),
        (GOOD.replace("sim:", "simm:"), "'simm:' is not a known device kind"),
        (GOOD + "[limits", "line"),
        (GOOD, "probe.toml"),
    ],
)
def test_a_bad_configuration_is_one_line_and_exit_78(tmp_path: Path, text: str, part: str) -> None:
    config = tmp_path / "probewatch.toml"
    config.write_text(text)
    refused = answered("run", "--config", config)
    assert refused.returncode == 78
    assert refused.stderr.count("\n") == 1
    assert part in refused.stderr
    assert "Traceback" not in refused.stderr


def test_a_configuration_that_is_not_there(tmp_path: Path) -> None:
    """Asked of the program itself, as the service manager starts it."""
    missing = [str(PROBEWATCH), "run", "--config", str(tmp_path / "none.toml")]
    assert subprocess.run(missing, capture_output=True, timeout=30, check=False).returncode == 78


def test_the_service_manager_hears_ready_once_and_the_watchdog_every_time(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        notifier = Notifier(str(tmp_path / "notify"))
        notifier.alive("monitoring")
        notifier.alive("warning")
        notifier.close()
        said = [manager.recv(4096).decode() for _ in range(3)]
    assert said == ["READY=1\nWATCHDOG=1\nSTATUS=monitoring", "WATCHDOG=1\nSTATUS=warning", "STOPPING=1"]


def test_a_deaf_service_manager_delays_nothing(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        notifier = Notifier(str(tmp_path / "notify"))
        for _ in range(1000):
            notifier.alive("monitoring")
        notifier.close()
        manager.setblocking(False)
        assert manager.recv(4096).startswith(b"READY=1")


def test_a_plus_device_set_is_a_reference_and_waits_for_a_picture(tmp_path: Path) -> None:
    (tmp_path / "probe.xml").write_text(PLUS)
    config = tmp_path / "probewatch.toml"
    folders = f'control.socket = "{tmp_path}/control"\nalarm.folder = "state"\n'
    config.write_text(GOOD.replace("probe.toml", "probe.xml") + folders)
    with subprocess.Popen([str(PROBEWATCH), "run", "--config", str(config)], stderr=subprocess.PIPE) as service:
        try:
            with until(lambda: reached(tmp_path / "control"), 20) as client:
                status = client.status()
        finally:
            service.terminate()
        service.communicate(timeout=20)
    assert service.returncode == 0
    assert (status["reference"], status["energised"]) == (None, False)
    assert status["reference_waits"] == "no picture has come yet, whose size the device set does not state"


def reached(path: Path) -> ControlClient | None:
    try:
        return ControlClient(path)
    except DeviceLost:
        return None


def test_a_damaged_store_of_references_is_one_line_and_exit_78(tmp_path: Path) -> None:
    config = configuration(tmp_path, more=f'control.socket = "{tmp_path}/control"\n')
    settled(started(config))
    (place(config) / "history.json").write_text("{}")
    refused = answered("run", "--config", tmp_path / "probewatch.toml")
    assert (refused.returncode, refused.stderr.count("\n")) == (78, 1)
    assert "state/references/history.json: cannot be understood" in refused.stderr
    assert "probewatch calibration reset" in refused.stderr
    folder, socket = place(config).parent, tmp_path / "control"
    reset = answered("calibration", "reset", "--yes", "--folder", folder, "--socket", socket)
    assert (reset.returncode, reset.stderr) == (0, ""), "what the refused service has left stands in nobody's way"
