"""The service as a process of its own: signals, and the real line, on simulated devices that speak real bytes.

What it does beyond that is in tests/appliance/service, in simulated time.
"""

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from appliance.service.control.client import ControlClient
from appliance.storage.calibration_file import read_calibration, write_calibration
from appliance.types import Fault
from tests.support.demo_cart import PROBEWATCH, Cart
from tests.support.polling import until

ALARM_S = 2.0


@pytest.fixture
def monitoring(cart: Cart) -> Cart:
    cart.wait_for("monitoring")
    until(cart.contact)
    return cart


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_stop_leaves_the_contact_open_and_exits_clean(monitoring: Cart, number: signal.Signals) -> None:
    stopped_s = time.monotonic()
    estimator = monitoring.estimator_pid()
    monitoring.daemon.process.send_signal(number)
    assert monitoring.daemon.end() == 0
    monitoring.open_contact(stopped_s, 1)
    assert not Path(f"/proc/{estimator}").exists()
    assert not monitoring.socket.exists()
    assert monitoring.daemon.noise == [], "the log is JSON lines and nothing else"
    monitoring.start_daemon()


def test_a_hangup_reloads_the_configuration(monitoring: Cart) -> None:
    text = monitoring.config.read_text()
    try:
        monitoring.config.write_text(text + 'alarm.language = "de"\n')
        monitoring.daemon.process.send_signal(signal.SIGHUP)
        until(lambda: monitoring.status()["text"] == "SIMULIERT · Kalibrierung bestätigt")
    finally:
        monitoring.config.write_text(text)
    monitoring.daemon.process.send_signal(signal.SIGHUP)
    until(lambda: monitoring.status()["text"] == "SIMULATED · Calibration verified")


@pytest.fixture
def real(tmp_path: Path) -> Iterator[Cart]:
    with Cart(tmp_path) as cart:
        checks = {check["name"]: check for check in cart.wait_for("monitoring", 40)["checks"]}
        assert {check["fault"] for check in checks.values()} <= {*Fault}
        assert checks["polarity"]["verdict"] == "OK"
        assert checks["scale-lateral"]["ratio"] < 1
        yield cart
        states = {event["state"] for event in cart.daemon.said if event["event"] == "state"}
        assert not {"halt", "recalibration requested"} & states


def test_the_real_line_verifies_and_a_killed_one_alarms(real: Cart) -> None:
    killed_s = time.monotonic()
    os.kill(real.estimator_pid(), signal.SIGKILL)
    real.open_contact(killed_s, ALARM_S)
    real.wait_for("not verified", 15)


@pytest.mark.slow
@pytest.mark.parametrize("part", ["estimator", "scanner", "polaris"])
def test_the_real_line_verifies_again_after_every_loss(real: Cart, part: str) -> None:
    killed_s = time.monotonic()
    if part == "estimator":
        os.kill(real.estimator_pid(), signal.SIGKILL)
    else:
        real.kill_twin(part)
    real.open_contact(killed_s, ALARM_S)
    if part != "estimator":
        real.start_twin(part)
    real.wait_for("monitoring", 60)


def calibration(*arguments: object) -> "subprocess.CompletedProcess[str]":
    command = [str(PROBEWATCH), "calibration", *(str(argument) for argument in arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, stdin=subprocess.DEVNULL)


@pytest.mark.slow
def test_a_far_reference_opens_the_contact_until_all_of_it_is_shown(real: Cart, tmp_path: Path) -> None:
    """The real line: 30 mm off in ζ never closes it; the way back closes it once the tilts and ζ are shown."""
    right = read_calibration(real.folder / "probe.toml")
    wrong = tmp_path / "wrong.toml"
    write_calibration(wrong, replace(right, offset_mm=right.offset_mm + np.array([0, 0, 30])), {})
    began_s = time.monotonic()
    taken = calibration("use", wrong, "--yes", "--wait", 40, "--socket", real.socket)
    assert taken.returncode == 75
    said = [event for event in real.twins["relay_board"].said if event["heard_s"] > began_s]
    assert not any(event.get("energised") for event in said)
    with ControlClient(real.socket) as client:
        client.abort_recalibration()
    until(lambda: "offset-elevational" in (real.status().get("reference_waits") or ""))
    status = real.wait_for("monitoring", 180)
    assert (status["reference"]["origin"], status["reference_waits"]) == ("went back to 1", None)
    shown = {check["name"] for check in status["checks"] if check["verdict"] == "OK"}
    assert "offset-elevational" in shown
