"""`probewatch recalibrate` with a simulated scan beside the whole service in simulated time."""

import signal
import subprocess
from pathlib import Path

import pytest

from probewatch.appliance.storage.alarm_chain import read_log
from tests.support.answers import answered
from tests.support.demo_cart import PROBEWATCH
from tests.support.polling import until
from tests.support.simulated_cart import SimulatedCart, WorldCart


def requests(cart: SimulatedCart) -> list[str]:
    return [line["request"] for line in cart.said(event="request granted")]


def whole_recalibration(cart: SimulatedCart, duration_s: int) -> None:
    """Contact open while it scans; file; verified; contact closed."""
    began_s, before = cart.now_s(), len(cart.said(event="state"))
    with cart.served():
        done = answered("recalibrate", "--config", cart.config, "--simulated", "--duration", duration_s)
    assert done.returncode == 0, done.stderr
    assert "the service has verified the new calibration and monitors again" in done.stdout
    (new,) = cart.folder.glob("probe-20*Z.toml")
    assert "it is in force, also after a restart" in done.stdout
    assert cart.status()["reference"]["file"] == str(new)
    states = [line["state"] for line in cart.said(event="state")[before:]]
    assert states == ["recalibrating", "monitoring"]
    assert requests(cart) == ["begin_recalibration", "end_recalibration"]
    cart.until(lambda: cart.contact(began_s))
    opened_s = [t_s for t_s, closed in cart.switched(began_s) if not closed]
    assert len(opened_s) == 1
    assert opened_s[0] - began_s < 1


@pytest.mark.thorough
def test_the_service_recalibrates_and_monitors_again(monitoring: SimulatedCart) -> None:
    whole_recalibration(monitoring, 11)


@pytest.mark.slow
def test_the_real_line_verifies_the_new_calibration(tmp_path: Path) -> None:
    with WorldCart(tmp_path) as cart:
        whole_recalibration(cart.monitoring(60), 20)


def test_a_refused_scan_leaves_the_old_calibration_in_force(monitoring: SimulatedCart) -> None:
    with monitoring.served():
        done = answered("recalibrate", "--config", monitoring.config, "--simulated", "--duration", 1)
    assert (done.returncode, done.stderr.count("probewatch: ")) == (65, 1), done.stderr
    assert requests(monitoring)[-1] == "abort_recalibration"
    assert monitoring.said(event="recalibration given up") == [], "it says itself that it ends"
    monitoring.wait_for("monitoring")
    assert monitoring.status()["reference"]["number"] == 1
    assert list(monitoring.folder.glob("probe-*")) == []


def test_an_interrupted_scan_leaves_the_old_calibration_in_force(monitoring: SimulatedCart) -> None:
    command = [PROBEWATCH, "recalibrate", "--config", monitoring.config, "--simulated", "--duration", "600"]
    with (
        monitoring.served(),
        subprocess.Popen(command, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process,
    ):
        until(lambda: any(one.event == "request" for one in read_log(monitoring.alarms).entries), 60)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.splitlines()[-1] == "probewatch: stopped: nothing was changed, reference 1 is in force, as before"
    assert requests(monitoring) == ["begin_recalibration", "abort_recalibration"]
    assert monitoring.said(event="recalibration given up") == [], "it says itself that it ends"
    monitoring.wait_for("monitoring")
    assert monitoring.status()["reference"]["number"] == 1
