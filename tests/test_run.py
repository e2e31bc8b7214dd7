"""`probewatch run` refuses what cannot work with one line and the right exit code; the service manager is told."""

import socket
import subprocess
from pathlib import Path

import pytest

from appliance.service.systemd_notify import Notifier
from tests.demo_cart import PROBEWATCH

GOOD = """
video.url = "sim:/tmp/nowhere/scanner"
tracker.url = "ndi:/tmp/nowhere/tracker"
output = [{ url = "relay:/tmp/nowhere/relay" }]
calibration.file = "probe.toml"
"""


def run(config: Path) -> subprocess.CompletedProcess[str]:
    command = [str(PROBEWATCH), "run", "--config", str(config)]
    return subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (GOOD + "[limits]\nscale_procent = 3\n", "did you mean 'scale_percent'?"),
        (GOOD.replace("sim:", "simm:"), "'simm:' is no known device kind"),
        (GOOD + "[limits", "line"),
        (GOOD, "probe.toml"),
    ],
)
def test_a_bad_configuration_is_one_line_and_exit_78(tmp_path: Path, text: str, part: str) -> None:
    config = tmp_path / "probewatch.toml"
    config.write_text(text)
    refused = run(config)
    assert refused.returncode == 78
    assert refused.stderr.count("\n") == 1
    assert part in refused.stderr
    assert "Traceback" not in refused.stderr


def test_a_configuration_that_is_not_there(tmp_path: Path) -> None:
    assert run(tmp_path / "none.toml").returncode == 78


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
