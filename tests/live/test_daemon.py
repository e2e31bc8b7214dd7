"""The service as a process of its own, on simulated devices that speak real bytes."""

import contextlib
import hashlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from appliance.service.control.client import ControlClient
from appliance.service.control.server import ControlRefused
from appliance.storage.alarm_chain import read_log
from appliance.storage.calibration_file import image_to_probe, read_calibration, write_calibration
from appliance.types import Fault
from tests.support.demo_cart import PROBEWATCH, Cart
from tests.support.polling import until

ALARM_S = 2.0
MANUAL = Path(__file__).parents[2] / "docs" / "control.md"


@pytest.fixture(scope="module", autouse=True)
def manager(tmp_path_factory: pytest.TempPathFactory) -> Iterator[socket.socket]:
    """The service manager's notification socket, which whatever starts after it inherits."""
    path = tmp_path_factory.mktemp("systemd") / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager, pytest.MonkeyPatch.context() as patch:
        manager.bind(str(path))
        manager.setblocking(False)
        patch.setenv("NOTIFY_SOCKET", str(path))
        yield manager


def notifications(manager: socket.socket) -> list[str]:
    """What the service manager was told since the last call."""
    said: list[str] = []
    with contextlib.suppress(BlockingIOError):
        while True:
            said.append(manager.recv(4096).decode())
    return said


@pytest.fixture
def monitoring(cart: Cart) -> Cart:
    cart.wait_for("monitoring")
    until(cart.contact)
    return cart


def test_status_tells_everything(monitoring: Cart) -> None:
    status = until(lambda: (now := monitoring.status())["fps"]["tracker"] > 1 and now)
    assert (status["state"], status["fault"], status["energised"]) == ("monitoring", None, True)
    assert status["verdict"] == "OK"
    assert 0 <= status["verification_age_s"] < 1
    assert {check["name"]: check["verdict"] for check in status["devices"]}["video presence"] == "OK"
    assert status["counters"]["frames"] > 0
    assert status["lost"] == {}
    rows = re.findall(r"^\| `([a-z_]+)` \|.*\| (.*) \|$", MANUAL.read_text().split("## Status")[1], re.M)
    assert status.keys() == {name for name, _ in rows}
    assert list(status["counters"]) == re.findall(r"`([a-z_]+)`", dict(rows)["counters"])
    assert set(status["tick"]) == set(re.findall(r"`([a-z0-9_]+)`", dict(rows)["tick"]))
    assert set(status["log"]) == set(re.findall(r"`([a-z_]+)`", dict(rows)["log"]))
    assert set(status["reference"]) == set(re.findall(r"`([a-z0-9_]+)`", dict(rows)["reference"]))


def test_status_and_log_name_what_the_verdicts_rest_on(monitoring: Cart) -> None:
    status = monitoring.status()
    assert status["text"] == "SIMULATED · Calibration verified"
    assert status["simulated"] == [f"sim:{monitoring.folder / 'scanner'}"]
    entries = read_log(monitoring.folder / "alarms").entries
    begun = [entry.data for entry in entries if entry.event == "started"][-1]
    assert begun["software"] == status["software"] == version("probewatch")
    sha256 = hashlib.sha256(monitoring.config.read_bytes()).hexdigest()
    assert begun["configuration"] == status["configuration"] == {"file": str(monitoring.config), "sha256": sha256}
    content = (monitoring.folder / "probe.toml").read_bytes()
    assert begun["reference"]["sha256"] == hashlib.sha256(content).hexdigest() == status["reference"]["sha256"]
    assert begun["simulated"] == status["simulated"]
    assert all(entry.data["simulated"] for entry in entries if entry.event == "state")


def restarted(cart: Cart) -> dict[str, Any]:
    assert cart.daemon.end() == 0
    cart.start_daemon()
    return cart.wait_for("monitoring", 60)


def calibration(*arguments: object) -> "subprocess.CompletedProcess[str]":
    command = [str(PROBEWATCH), "calibration", *(str(argument) for argument in arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, stdin=subprocess.DEVNULL)


def test_a_new_reference_outlives_a_restart_and_can_be_gone_back_from(monitoring: Cart, tmp_path: Path) -> None:
    """With the commands that a technician has."""
    first = monitoring.status()["reference"]
    old = read_calibration(monitoring.folder / "probe.toml")
    new = tmp_path / "new.toml"
    write_calibration(new, replace(old, offset_mm=old.offset_mm + np.array([0, 0, 1])), {})
    used = calibration("use", new, "--socket", monitoring.socket)
    assert used.returncode == 0, used.stderr
    assert "moved by 1.00 mm" in used.stdout
    new.unlink()
    after = restarted(monitoring)["reference"]
    assert (after["number"], after["origin"]) == (first["number"] + 1, "recalibration")
    asked = calibration("back", first["number"], "--socket", monitoring.socket)
    assert (asked.returncode, asked.stderr.count("\n")) == (75, 1)
    assert "needs a person to accept it" in asked.stderr
    assert monitoring.status()["state"] == "monitoring", "nothing was begun"
    back = calibration("back", first["number"], "--yes", "--socket", monitoring.socket)
    assert back.returncode == 0, back.stderr
    now = restarted(monitoring)["reference"]
    assert (now["origin"], now["sha256"]) == (f"went back to {first['number']}", first["sha256"])
    changes = [one.data for one in read_log(monitoring.folder / "alarms").entries if one.event == "reference"]
    assert [one["reference"]["number"] for one in changes[-2:]] == [after["number"], now["number"]]


def test_a_far_reference_needs_a_person_and_more_than_little_motion(tmp_path: Path) -> None:
    """The stand-in line shows no parameter, which is enough for a reference that is near."""
    with Cart(tmp_path, trusting=True) as cart:
        cart.wait_for("monitoring")
        old = read_calibration(tmp_path / "probe.toml")
        far = tmp_path / "far.toml"
        write_calibration(far, replace(old, offset_mm=old.offset_mm + np.array([0, 0, 30])), {})
        declined = calibration("use", far, "--socket", cart.socket)
        assert declined.returncode == 75
        assert "moved by 30.00 mm" in declined.stdout
        assert cart.status()["energised"], "nothing was begun"
        taken = calibration("use", far, "--yes", "--wait", 2, "--socket", cart.socket)
        assert taken.returncode == 75
        assert "offset-elevational" in taken.stderr
        assert not cart.status()["energised"]
        cart.daemon.end(kill=True)
        cart.start_daemon()
        status = cart.wait_for("not verified")
        assert (status["reference"]["number"], status["energised"]) == (2, False)
        until(lambda: "offset-elevational" in cart.status().get("reference_waits", ""))


def test_a_device_set_without_a_size_waits_for_the_first_picture(tmp_path: Path) -> None:
    with Cart(tmp_path, trusting=True) as cart:
        cart.wait_for("monitoring")
        assert cart.daemon.end() == 0
        rows = image_to_probe(read_calibration(tmp_path / "probe.toml")).ravel()
        matrix = " ".join(repr(float(number)) for number in rows)
        transform = f'<Transform From="Image" To="Probe" Matrix="{matrix}"/>'
        (tmp_path / "set.xml").write_text(f"<P><CoordinateDefinitions>{transform}</CoordinateDefinitions></P>")
        cart.config.write_text(cart.config.read_text().replace("probe.toml", "set.xml"))
        (tmp_path / "alarms").rename(tmp_path / "of the other reference")
        cart.start_daemon()
        reference = cart.wait_for("monitoring")["reference"]
        assert reference["image_size_px"] == [640, 480]
        assert reference["file"] == str(tmp_path / "set.xml")


def test_an_edited_calibration_file_is_named_in_the_status(cart: Cart) -> None:
    file = cart.folder / "probe.toml"
    whole = file.read_bytes()
    try:
        file.write_bytes(whole + b"# edited\n")
        with ControlClient(cart.socket) as client:
            client.reload()
        status = until(lambda: (now := cart.status())["calibration_changed"] and now)
        assert status["calibration_changed"] == f"{file} was changed, and is not in force"
        until(lambda: "Configured calibration is not in force" in cart.status()["notices"])
    finally:
        file.write_bytes(whole)


@pytest.mark.parametrize(
    ("twin", "fault", "role"), [("scanner", "video-lost", "video"), ("polaris", "tracker-lost", "tracker")]
)
def test_a_killed_device_alarms_and_recovers_by_itself(monitoring: Cart, twin: str, fault: str, role: str) -> None:
    killed_s = time.monotonic()
    monitoring.kill_twin(twin)
    monitoring.open_contact(killed_s, ALARM_S)
    assert monitoring.wait_for("device lost", ALARM_S)["fault"] == fault
    monitoring.start_twin(twin)
    overloaded = monitoring.wait_for("monitoring")["load"]["overloaded_s"] is not None
    said = [event for event in monitoring.daemon.said if event["heard_s"] > killed_s and event.get("device") == role]
    counted = overloaded and not said  # then only the first loss of an overload is said
    assert counted or [event["event"] for event in said] == ["device lost", "device back"], "said once each"


def test_a_killed_estimator_alarms_and_recovers_by_itself(monitoring: Cart) -> None:
    killed_s = time.monotonic()
    os.kill(monitoring.estimator_pid(), signal.SIGKILL)
    monitoring.open_contact(killed_s, ALARM_S)
    until(lambda: monitoring.daemon.find(killed_s, event="state", state="internal fault", fault="estimator-silent"))
    status = monitoring.wait_for("monitoring")
    count = status["counters"]["estimator_restarts"]
    assert status["estimator"] == f"killed by SIGKILL, restart {count}"
    assert monitoring.daemon.find(killed_s, event="estimator ended", how="killed by SIGKILL", restart=count)


def test_a_stopped_estimator_alarms(monitoring: Cart) -> None:
    stopped_s = time.monotonic()
    pid = monitoring.estimator_pid()
    os.kill(pid, signal.SIGSTOP)
    try:
        monitoring.open_contact(stopped_s, ALARM_S)
    finally:
        os.kill(pid, signal.SIGCONT)


def test_the_service_manager_is_told_ready_and_fed_by_every_tick(monitoring: Cart, manager: socket.socket) -> None:
    first, *_ = notifications(manager)
    assert first.startswith("READY=1\nWATCHDOG=1\n")
    time.sleep(0.5)
    assert 5 <= len([said for said in notifications(manager) if "WATCHDOG=1" in said]) <= 12


def test_the_service_manager_is_told_how_the_estimator_ended(monitoring: Cart, manager: socket.socket) -> None:
    notifications(manager)
    os.kill(monitoring.estimator_pid(), signal.SIGSEGV)
    words = "STATUS=internal fault: Verification has stopped (estimator killed by SIGSEGV, restart "
    until(lambda: any(words in said for said in notifications(manager)), ALARM_S)
    monitoring.wait_for("monitoring")
    notifications(manager)
    said = until(lambda: notifications(manager))[-1]
    assert "estimator" not in said
    assert said.endswith(" · SIMULATED")


def test_a_killed_relay_board_is_an_output_failure_and_comes_back(monitoring: Cart, manager: socket.socket) -> None:
    killed_s = time.monotonic()
    monitoring.kill_twin("relay_board")
    status = monitoring.wait_for("device lost", ALARM_S + 1)
    assert (status["fault"], status["energised"]) == ("output-failed", False)
    assert any("relay:" in name for name in status["lost"])
    notifications(manager)
    time.sleep(0.3)
    assert notifications(manager) == [], "without a completed output write the watchdog is not fed"
    monitoring.start_twin("relay_board")
    monitoring.wait_for("monitoring")
    until(lambda: monitoring.contact(killed_s))


def test_recalibration_over_the_control_socket(monitoring: Cart, tmp_path: Path) -> None:
    good = monitoring.config.with_name("probe.toml")
    with ControlClient(monitoring.socket) as client:
        with pytest.raises(ControlRefused, match="not possible while monitoring"):
            client.acknowledge()
        began_s = time.monotonic()
        client.begin_recalibration()
        monitoring.open_contact(began_s, 1)
        with pytest.raises(ControlRefused, match=r"missing\.toml"):
            client.end_recalibration(tmp_path / "missing.toml")
        assert client.status()["state"] == "recalibrating"
        client.end_recalibration(good)
    monitoring.wait_for("monitoring")
    assert monitoring.daemon.find(began_s, event="request granted", request="end_recalibration")


def test_aborted_recalibration_is_verified_again(monitoring: Cart) -> None:
    with ControlClient(monitoring.socket) as client:
        client.begin_recalibration()
        client.abort_recalibration()
        assert client.status()["state"] in {"not verified", "monitoring"}
    monitoring.wait_for("monitoring")


def test_a_second_recalibration_is_refused_by_name_and_ends_nothing_when_it_leaves(monitoring: Cart) -> None:
    """Of another process, which also tries to end what it did not begin; the first one goes on and ends its own."""
    asked = [{"v": 1, "do": f"{do}-recalibration", "hold_s": 20, "number": 1} for do in ("begin", "end", "abort")]
    script = (
        f"import socket; link = socket.socket(socket.AF_UNIX); link.connect({str(monitoring.socket)!r})\n"
        "lines = link.makefile('rw')\n"
        f"for line in {[json.dumps(one) for one in asked]!r}:\n"
        "    print(line, file=lines, flush=True); print(lines.readline(), end='')"
    )
    with ControlClient(monitoring.socket) as client:
        client.begin_recalibration(20)
        second = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=20, check=True)
        for line in second.stdout.splitlines():
            assert f"process {os.getpid()} has recalibrated for " in json.loads(line).get("error", ""), line
        left_ns = client.status()["t_ns"]
        until(lambda: client.status()["t_ns"] > left_ns + 200_000_000)
        status = client.status()
        assert (status["state"], status["recalibration"]["yours"]) == ("recalibrating", True)
        client.abort_recalibration()
    monitoring.wait_for("monitoring")


def test_a_second_service_is_refused_in_one_line(monitoring: Cart) -> None:
    command = [str(PROBEWATCH), "run", "--config", str(monitoring.config)]
    second = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
    assert second.returncode == 69
    assert second.stderr.count("\n") == 1
    assert "another probewatch service is running" in second.stderr
    assert monitoring.status()["state"] == "monitoring"


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
