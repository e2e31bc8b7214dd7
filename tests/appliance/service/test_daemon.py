"""The whole service in simulated time: what it tells, its references, and its devices that are lost and come back."""

import contextlib
import hashlib
import io
import re
import signal
import socket
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from datetime import timedelta
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from probewatch.appliance.service.control.status_fields import STATUS
from probewatch.appliance.storage.alarm_chain import read_log
from probewatch.appliance.storage.calibration_file import read_calibration, write_calibration
from probewatch.appliance.storage.image_to_probe import image_to_probe
from probewatch.appliance.types import Verdict, VerdictKind
from probewatch.drivers.samples import Sample
from tests.support.answers import Answer, answered
from tests.support.demo_cart import PROBEWATCH
from tests.support.simulated_cart import SimulatedCart
from tests.support.stand_in_daemon import TrustingLine

ALARM_S = 2.0
MANUAL = Path(__file__).parents[3] / "docs" / "control.md"


def test_status_tells_everything(monitoring: SimulatedCart) -> None:
    status = monitoring.until(lambda: (now := monitoring.status())["fps"]["tracker"] > 1 and now)
    assert (status["state"], status["fault"], status["energised"]) == ("monitoring", None, True)
    assert status["verdict"] == "OK"
    assert 0 <= status["verification_age_s"] < 1
    assert {check["name"]: check["verdict"] for check in status["devices"]}["video presence"] == "OK"
    assert status["counters"]["frames"] > 0
    assert status["lost"] == {}
    rows = re.findall(r"^\| `([a-z_]+)` \|.*\| (.*) \|$", MANUAL.read_text().split("## Status")[1], re.M)
    assert status.keys() == {name for name, _ in rows} == {field.name for field in STATUS}
    for field in STATUS:
        assert not field.parts or list(status[field.name]) == [part.name for part in field.parts]
    assert list(status["counters"]) == re.findall(r"`([a-z_]+)`", dict(rows)["counters"])
    assert set(status["tick"]) == set(re.findall(r"`([a-z0-9_]+)`", dict(rows)["tick"]))
    assert set(status["log"]) == set(re.findall(r"`([a-z_]+)`", dict(rows)["log"]))
    assert set(status["reference"]) == set(re.findall(r"`([a-z0-9_]+)`", dict(rows)["reference"]))


def test_status_and_log_name_what_the_verdicts_rest_on(monitoring: SimulatedCart) -> None:
    status = monitoring.status()
    assert status["text"] == "SIMULATED · Calibration verified"
    assert status["simulated"] == [f"sim:{monitoring.folder / 'scanner'}"]
    entries = read_log(monitoring.alarms).entries
    begun = [entry.data for entry in entries if entry.event == "started"][-1]
    assert begun["software"] == status["software"] == version("probewatch")
    sha256 = hashlib.sha256(monitoring.config.read_bytes()).hexdigest()
    assert begun["configuration"] == status["configuration"] == {"file": str(monitoring.config), "sha256": sha256}
    content = (monitoring.folder / "probe.toml").read_bytes()
    assert begun["reference"]["sha256"] == hashlib.sha256(content).hexdigest() == status["reference"]["sha256"]
    assert begun["simulated"] == status["simulated"]
    assert all(entry.data["simulated"] for entry in entries if entry.event == "state")


def restarted(cart: SimulatedCart) -> dict[str, Any]:
    cart.end_daemon()
    cart.start_daemon()
    return cart.wait_for("monitoring", 60)


def calibration(cart: SimulatedCart, *words: object) -> Answer:
    with cart.served():
        return answered("calibration", *words, "--socket", cart.socket)


def moved(cart: SimulatedCart, file: Path, by_mm: float) -> Path:
    """The cart's calibration with another elevational offset."""
    old = read_calibration(cart.folder / "probe.toml")
    write_calibration(file, replace(old, offset_mm=old.offset_mm + np.array([0, 0, by_mm])), {})
    return file


@pytest.fixture(autouse=True)
def nobody_types(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO())


def test_a_new_reference_outlives_a_restart_and_can_be_gone_back_from(
    monitoring: SimulatedCart, tmp_path: Path
) -> None:
    """With the commands that a technician has."""
    first = monitoring.status()["reference"]
    new = moved(monitoring, tmp_path / "new.toml", 1)
    used = calibration(monitoring, "use", new)
    assert used.returncode == 0, used.stderr
    assert "moved by 1.00 mm" in used.stdout
    new.unlink()
    after = restarted(monitoring)["reference"]
    assert (after["number"], after["origin"]) == (first["number"] + 1, "file")
    asked = calibration(monitoring, "back", first["number"])
    assert (asked.returncode, asked.stderr.count("\n")) == (75, 1)
    assert "needs a person to accept it" in asked.stderr
    assert monitoring.status()["state"] == "monitoring", "nothing was begun"
    back = calibration(monitoring, "back", first["number"], "--yes")
    assert back.returncode == 0, back.stderr
    now = restarted(monitoring)["reference"]
    assert (now["origin"], now["sha256"]) == (f"went back to {first['number']}", first["sha256"])
    changes = [one.data for one in read_log(monitoring.alarms).entries if one.event == "reference"]
    assert [one["reference"]["number"] for one in changes[-2:]] == [after["number"], now["number"]]


def test_a_far_reference_needs_a_person_and_more_than_little_motion(monitoring: SimulatedCart, tmp_path: Path) -> None:
    """The trusting line shows no parameter, which is enough for a reference that is near."""
    far = moved(monitoring, tmp_path / "far.toml", 30)
    declined = calibration(monitoring, "use", far)
    assert declined.returncode == 75
    assert "moved by 30.00 mm" in declined.stdout
    assert monitoring.status()["energised"], "nothing was begun"
    taken = calibration(monitoring, "use", far, "--yes", "--wait", 1)
    assert taken.returncode == 75
    assert "offset-elevational" in taken.stderr
    assert not monitoring.status()["energised"]
    monitoring.kill_daemon()
    monitoring.start_daemon()
    status = monitoring.wait_for("not verified")
    assert (status["reference"]["number"], status["energised"]) == (2, False)
    monitoring.until(lambda: "offset-elevational" in monitoring.status().get("reference_waits", ""))


def test_a_device_set_without_a_size_waits_for_the_first_picture(monitoring: SimulatedCart, tmp_path: Path) -> None:
    monitoring.end_daemon()
    rows = image_to_probe(read_calibration(tmp_path / "probe.toml")).ravel()
    matrix = " ".join(repr(float(number)) for number in rows)
    transform = f'<Transform From="Image" To="Probe" Matrix="{matrix}"/>'
    (tmp_path / "set.xml").write_text(f"<P><CoordinateDefinitions>{transform}</CoordinateDefinitions></P>")
    monitoring.config.write_text(monitoring.config.read_text().replace("probe.toml", "set.xml"))
    monitoring.alarms.rename(tmp_path / "of the other reference")
    monitoring.scanner.plugged = False
    monitoring.start_daemon()
    monitoring.run(2)
    assert "no picture has come yet" in monitoring.status()["reference_waits"]
    monitoring.scanner.plugged = True
    reference = monitoring.wait_for("monitoring")["reference"]
    assert reference["image_size_px"] == [640, 480]
    assert reference["file"] == str(tmp_path / "set.xml")


def test_an_edited_calibration_file_is_named_in_the_status(cart: SimulatedCart) -> None:
    file = cart.folder / "probe.toml"
    file.write_bytes(file.read_bytes() + b"# edited\n")
    with cart.client() as client:
        client.reload()
    status = cart.until(lambda: (now := cart.status())["calibration_changed"] and now)
    assert status["calibration_changed"] == f"{file} was changed, and is not in force"
    cart.until(lambda: "Configured calibration is not in force" in cart.status()["notices"])


@pytest.mark.parametrize(("overdue", "closed"), [("advise", True), ("expires", False)])
def test_a_date_of_the_calibration_that_passes_is_told_once_and_opens_the_contact_if_so_configured(
    tmp_path: Path, overdue: str, closed: bool
) -> None:
    """The calendar is set forward by a year, which is said as well."""
    more = f'calibration.due_days = 365\ncalibration.overdue = "{overdue}"\n'
    with SimulatedCart(tmp_path, more=more) as cart:
        cart.monitoring()
        assert cart.status()["reference_overdue"] is None
        cart.utc += timedelta(days=366)
        cart.run(3)
        status = cart.status()
        assert status["reference_overdue"]
        assert status["energised"] is cart.contact() is closed
        assert closed or "reference: " in status["reason"] or "expired" in status["reference_waits"]
        said = [entry for entry in read_log(cart.alarms).entries if entry.event in ("calibration date", "wall-clock")]
        assert sorted(entry.event for entry in said) == ["calibration date", "wall-clock"]
        assert next(entry.data["by_s"] for entry in said if entry.event == "wall-clock") == 366 * 86400


class MovedLine(TrustingLine):
    """Shows everything while the probe moves, and says OK of it from then on, as at rest."""

    moving = True
    shown_ns: int | None = None

    def __init__(self, *settings: Any) -> None:
        super().__init__(*settings)
        self._wanted = lambda: ""

    def step(self, sample: Sample) -> tuple[Verdict, ...]:
        self.shown_ns = sample.stamp.t_ns if MovedLine.moving else self.shown_ns
        kind = VerdictKind.NOT_VERIFIED if self.shown_ns is None else VerdictKind.OK
        return tuple(replace(one, kind=kind, verified_ns=self.shown_ns) for one in super().step(sample))


def test_after_the_computer_slept_only_new_motion_verifies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No time passes meanwhile by the clock of all ages: the contact closed for minutes on what a night before had
    shown.
    """
    with SimulatedCart(tmp_path, MovedLine) as cart:
        cart.monitoring()
        monkeypatch.setattr(MovedLine, "moving", False)
        cart.run(5)
        assert cart.contact()
        woke_s, cart.slept_s = cart.now_s(), 8 * 3600.0
        cart.open_contact(woke_s, 0.1)
        cart.run(5)
        assert [closed for _, closed in cart.switched(woke_s)] == [False]
        assert cart.status()["state"] == "not verified"
        monkeypatch.setattr(MovedLine, "moving", True)
        cart.monitoring()
        (slept,) = (entry.data for entry in read_log(cart.alarms).entries if entry.event == "slept")
        assert slept["for_s"] == 8 * 3600


@pytest.mark.parametrize(
    ("device", "fault", "role"), [("scanner", "video-lost", "video"), ("tracker", "tracker-lost", "tracker")]
)
@pytest.mark.parametrize("how", ["gone", "silent"])
def test_a_lost_device_alarms_and_recovers_by_itself(
    monitoring: SimulatedCart, device: str, fault: str, role: str, how: str
) -> None:
    lost, began_s = getattr(monitoring, device), monitoring.now_s()
    setattr(lost, "plugged" if how == "gone" else "sends", False)
    monitoring.open_contact(began_s, ALARM_S)
    assert monitoring.wait_for("device lost", ALARM_S)["fault"] == fault
    monitoring.run(4)
    lost.plugged = lost.sends = True
    monitoring.monitoring()
    said = [event["event"] for event in monitoring.said(device=role)]
    assert said == ["device lost", "device back"], "said once each"


def test_a_killed_estimator_alarms_and_recovers_by_itself(monitoring: SimulatedCart) -> None:
    began_s = monitoring.now_s()
    monitoring.kill_estimator()
    monitoring.open_contact(began_s, ALARM_S)
    status = monitoring.wait_for("monitoring")
    assert monitoring.said(event="state", state="internal fault", fault="estimator-silent")
    count = status["counters"]["estimator_restarts"]
    assert status["estimator"] == f"killed by SIGKILL, restart {count}"
    assert monitoring.said(event="estimator ended", how="killed by SIGKILL", restart=count)


@pytest.fixture
def manager(tmp_path_factory: pytest.TempPathFactory) -> Iterator[socket.socket]:
    """The service manager's notification socket; ask for it before the cart."""
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


def test_the_service_manager_is_told_ready_and_fed_by_every_tick(manager: socket.socket, cart: SimulatedCart) -> None:
    cart.run(0.2)
    first, *_ = notifications(manager)
    assert first.startswith("READY=1\nWATCHDOG=1\n")
    cart.run(0.5)
    assert 5 <= len([said for said in notifications(manager) if "WATCHDOG=1" in said]) <= 16


def test_the_service_manager_is_told_how_the_estimator_ended(manager: socket.socket, monitoring: SimulatedCart) -> None:
    notifications(manager)
    monitoring.kill_estimator(signal.SIGSEGV)
    words = "STATUS=internal fault: Verification has stopped (estimator killed by SIGSEGV, restart "
    monitoring.until(lambda: any(words in said for said in notifications(manager)), ALARM_S)
    monitoring.wait_for("monitoring")
    notifications(manager)
    monitoring.run(0.2)
    said = notifications(manager)[-1]
    assert "estimator" not in said
    assert said.endswith(" · SIMULATED")


def test_a_killed_relay_board_is_an_output_failure_and_comes_back(
    manager: socket.socket, monitoring: SimulatedCart
) -> None:
    monitoring.kill_board()
    status = monitoring.wait_for("device lost", ALARM_S + 1)
    assert (status["fault"], status["energised"]) == ("output-failed", False)
    assert any("relay:" in name for name in status["lost"])
    notifications(manager)
    monitoring.run(0.3)
    assert notifications(manager) == [], "without a completed output write the watchdog is not fed"
    began_s = monitoring.now_s()
    monitoring.start_board()
    monitoring.wait_for("monitoring")
    monitoring.until(lambda: monitoring.contact(began_s))


def test_a_second_service_is_refused_in_one_line(monitoring: SimulatedCart) -> None:
    command = [str(PROBEWATCH), "run", "--config", str(monitoring.config)]
    second = subprocess.run(command, capture_output=True, text=True, timeout=20, check=False)
    assert second.returncode == 69
    assert second.stderr.count("\n") == 1
    assert "another probewatch service is running" in second.stderr
    assert monitoring.status()["state"] == "monitoring"
