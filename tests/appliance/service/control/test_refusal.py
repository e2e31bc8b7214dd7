"""A service that does not watch says why to whoever asks: not configured, refused, not running, or not one's to ask."""

import os
import stat
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from probewatch.appliance.service.control.refusal import leave, why_silent, withdraw
from probewatch.appliance.service.control.server import ControlServer
from probewatch.drivers.errors import ConfigurationError, ProbewatchError
from probewatch.tools.commands import ack, log, status
from tests.support.answers import answered
from tests.support.polling import until
from tests.support.simulated import PROBEWATCH

CONFIG = """
configured = {configured}
video.url = "sim:/tmp/nowhere/scanner"
tracker.url = "ndi:/tmp/nowhere/tracker"
output = [{{ url = "relay:/tmp/nowhere/relay" }}]
calibration.file = "probe.toml"
control.socket = "{socket}"
"""
NOBODY = 65534


def config(folder: Path, configured: str) -> Path:
    file = folder / "probewatch.toml"
    file.write_text(CONFIG.format(configured=configured, socket=folder / "control"))
    return file


def test_status_of_an_unconfigured_service_says_what_to_edit(tmp_path: Path) -> None:
    file, socket = config(tmp_path, "false"), tmp_path / "control"
    with subprocess.Popen([*PROBEWATCH, "run", "--config", str(file)], stderr=subprocess.DEVNULL) as service:
        try:
            until(lambda: why_silent(socket))
            shown = answered("status", "--socket", socket)
        finally:
            service.terminate()
    assert shown.returncode == 78
    assert f"{file}: the service does not watch, since 20" in shown.stderr
    assert "not configured yet. Run: probewatch configure " in shown.stderr


@pytest.mark.parametrize("command", [["status"], ["status", "--json"], ["ack"], ["lamp-test"]])
def test_every_question_to_a_refused_service_is_answered_with_its_reason(tmp_path: Path, command: list[str]) -> None:
    assert answered("run", "--config", config(tmp_path, "true")).returncode == 78
    shown = answered(*command, "--socket", tmp_path / "control")
    assert shown.returncode == 78
    assert f"{tmp_path}/probe.toml: the service does not watch" in shown.stderr
    assert "cannot be read: No such file" in shown.stderr
    assert f"; then probewatch run --config {tmp_path}/probewatch.toml" in shown.stderr, "the unit's is another cart"


def test_a_mistake_in_the_file_does_not_hide_where_people_ask(tmp_path: Path) -> None:
    file = config(tmp_path, "true")
    file.write_text(file.read_text() + "limits.scale_procent = 3\n")
    assert answered("run", "--config", file).returncode == 78
    shown = answered("status", "--socket", tmp_path / "control")
    assert "line 8: [limits] scale_procent is not known. Did you mean 'scale_percent'?" in shown.stderr


def test_the_refusal_is_for_the_group_and_goes_with_the_next_service(tmp_path: Path) -> None:
    file, socket = config(tmp_path, "true"), tmp_path / "control"
    leave(file, ConfigurationError("is wrong", "here", "Mend it"))
    (left,) = (path for path in tmp_path.iterdir() if path != file)
    assert stat.S_IMODE(left.stat().st_mode) == 0o640
    assert "is wrong" in str(why_silent(socket))
    withdraw(socket)
    assert why_silent(socket) is None


@pytest.mark.parametrize("text", [b"", b"[" * 9000, b"{}", b"[1]", b"\xff"])
def test_a_damaged_refusal_counts_as_none(tmp_path: Path, text: bytes) -> None:
    (tmp_path / "control.refusal").write_bytes(text)
    shown = answered("status", "--socket", tmp_path / "control")
    assert shown.returncode == 69
    assert "no service answers (No such file or directory). Start it: probewatch run --config FILE" in shown.stderr


@contextmanager
def stranger(closed: Path) -> Iterator[None]:
    """This process may not enter the folder meanwhile."""
    own = os.geteuid()
    closed.chmod(0)
    try:
        if own == 0:
            os.seteuid(NOBODY)
        yield
    finally:
        os.seteuid(own)
        closed.chmod(0o700)


@pytest.mark.parametrize("command", [status.command, ack.command, log.command])
def test_who_has_no_right_to_ask_is_told_the_one_line(tmp_path: Path, command: click.Command) -> None:
    (tmp_path / "alarms").mkdir()
    words = [str(tmp_path / "alarms")] if command is log.command else ["--socket", str(tmp_path / "control")]
    with ControlServer(tmp_path / "control"), stranger(tmp_path):
        refusal = CliRunner().invoke(command, words).exception
    assert isinstance(refusal, ProbewatchError)
    assert "sudo usermod -aG probewatch " in refusal.remedy


def test_the_manual_names_the_same_line() -> None:
    manual = Path(__file__).parents[4] / "docs" / "cart.md"
    assert "sudo usermod -aG probewatch " in manual.read_text()


def test_the_unit_keeps_the_folder_of_the_refusal() -> None:
    unit = (Path(__file__).parents[4] / "systemd" / "probewatch.service").read_text()
    assert "RuntimeDirectoryPreserve=yes" in unit.splitlines()
