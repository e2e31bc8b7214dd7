"""The service as a process of its own: signals, and the real line, on simulated devices that speak real bytes.

What it does beyond that is in tests/appliance/service, in simulated time.
"""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from probewatch.appliance.types import Fault
from tests.support.demo_cart import Cart
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
    """A scanner of 15 Hz: rendering and registering 30 is more than two slow processors do, beside another test."""
    with Cart(tmp_path, fps=15.0) as cart:
        checks = {check["name"]: check for check in cart.wait_for("monitoring", 40)["checks"]}
        assert {check["fault"] for check in checks.values()} <= {*Fault}
        assert checks["polarity"]["verdict"] == "OK"
        assert checks["scale-lateral"]["ratio"] < 1
        yield cart
        states = {event["state"] for event in cart.daemon.said if event["event"] == "state"}
        assert not {"halt", "recalibration requested"} & states


@pytest.mark.alone
def test_the_real_line_verifies_and_a_killed_one_alarms(real: Cart) -> None:
    killed_s = time.monotonic()
    os.kill(real.estimator_pid(), signal.SIGKILL)
    real.open_contact(killed_s, ALARM_S)
    real.wait_for("not verified", 15)
