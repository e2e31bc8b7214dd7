"""The unit and its companions by systemd's own judgement."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from probewatch.drivers.registry import drivers
from probewatch.tools.development.driver_pages import DROP_IN, drop_in

FOLDER = Path(__file__).parents[2] / "systemd"
UNIT = FOLDER / "probewatch.service"
BESIDE = FOLDER / "probewatch-openigtlink.service"
PAGE = FOLDER / "probewatch-page.service"
RECORDER, REPORT = FOLDER / "probewatch-recorder.service", FOLDER / "probewatch-report.service"
UNITS = sorted(FOLDER.glob("probewatch*.service"))
needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze (systemd)")
needs_udev = pytest.mark.skipif(shutil.which("udevadm") is None, reason="needs udevadm (udev)")


def said(*command: str) -> tuple[int, str]:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def settings(unit: Path = UNIT) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for line in unit.read_text().splitlines():
        name, equals, value = line.partition("=")
        if equals and not line.startswith("#"):
            found.setdefault(name, []).append(value)
    return found


@needs_systemd
@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_systemd_accepts_the_unit(unit: Path) -> None:
    assert said("systemd-analyze", "verify", str(unit)) == (0, "")


@needs_systemd
@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_the_unit_is_exposed_no_more_than_one_and_a_half(unit: Path) -> None:
    _, text = said("systemd-analyze", "security", "--offline=yes", "--no-pager", str(unit))
    if "unrecognized option" in text:
        pytest.skip("needs systemd-analyze security --offline (systemd 250)")
    exposure = re.search(r"exposure level for \S+: ([0-9.]+)", text)
    assert exposure is not None, text
    assert float(exposure[1]) <= 1.5, text


def test_it_is_never_left_silently_dead() -> None:
    unit = settings()
    assert unit["Type"] == ["notify"]
    assert unit["Restart"] == ["always"]
    assert unit["StartLimitIntervalSec"] == ["0"]
    assert unit["RestartPreventExitStatus"] == ["78"]
    assert float(unit["WatchdogSec"][0]) <= 5
    assert unit["WatchdogSignal"] == ["SIGKILL"]


@pytest.mark.parametrize("unit", [unit for unit in UNITS if unit != UNIT], ids=lambda unit: unit.name)
def test_whoever_looks_on_makes_way_for_the_service(unit: Path) -> None:
    beside = settings(unit)
    assert beside["CPUWeight"] == beside["CPUSchedulingPolicy"] == ["idle"]
    assert settings()["CPUWeight"] == ["500"]


def test_what_stands_beside_it_can_touch_nothing_and_is_reached_from_this_computer_alone() -> None:
    unit = settings(BESIDE)
    assert unit["PrivateDevices"] == ["yes"]
    assert "DeviceAllow" not in unit
    assert unit["IPAddressAllow"] == ["localhost"]
    assert unit["SocketBindAllow"] == ["tcp:18944"]
    assert "Requires" not in settings(UNIT), "the service needs nobody"


def test_the_page_is_a_user_of_its_own_without_devices_and_reached_from_this_computer_alone() -> None:
    unit = settings(PAGE)
    assert (unit["User"], unit["Group"]) == (["probewatch-page"], ["probewatch"])
    assert unit["PrivateDevices"] == ["yes"]
    assert unit["IPAddressAllow"] == ["localhost"]
    assert unit["SocketBindAllow"] == ["tcp:9780"]
    assert (unit["StateDirectory"], unit["StateDirectoryMode"]) == (["probewatch-page"], ["0750"])
    assert not {"DeviceAllow", "Requires", "BindsTo"} & unit.keys()


@pytest.mark.parametrize("unit", [RECORDER, REPORT], ids=lambda unit: unit.name)
def test_who_writes_of_it_has_no_device_no_network_and_a_folder_of_its_own(unit: Path) -> None:
    found = settings(unit)
    assert found["PrivateDevices"] == found["PrivateNetwork"] == ["yes"]
    assert found["RestrictAddressFamilies"] == ["AF_UNIX" if unit == RECORDER else "none"]
    assert found["User"] == found["StateDirectory"]
    assert found["OOMScoreAdjust"] == ["500"]
    assert not {"DeviceAllow", "Requires", "BindsTo"} & found.keys()


@needs_systemd
def test_systemd_accepts_the_timer() -> None:
    assert said("systemd-analyze", "verify", str(FOLDER / "probewatch-report.timer")) == (0, "")


@pytest.mark.parametrize(
    "unit", [unit for unit in UNITS if unit not in (UNIT, BESIDE, PAGE, RECORDER, REPORT)], ids=lambda unit: unit.name
)
def test_who_only_reads_the_status_has_no_device_and_a_user_of_its_own(unit: Path) -> None:
    lines = unit.read_text().splitlines()
    for line in ("User=probewatch-monitor", "PrivateDevices=yes", "DevicePolicy=closed", "OOMScoreAdjust=500"):
        assert line in lines, line
    assert not any(line.startswith(("DeviceAllow=", "Requires=", "BindsTo=")) for line in lines)


def test_only_the_devices_that_its_drivers_open() -> None:
    """Every kind of node that some driver names is permitted and open to the service's groups, and nothing else is."""
    assert settings()["DevicePolicy"] == ["closed"]
    assert "DeviceAllow" not in settings()
    assert DROP_IN.read_text() == drop_in(), "run make docs"
    targets = [target for driver in drivers().values() for target in driver.targets if target.allow]
    assert {entry.split()[0] for entry in settings(DROP_IN)["DeviceAllow"]} == {
        name for target in targets for name in target.allow
    }
    assert settings(DROP_IN).keys() == {"DeviceAllow"}
    assert {target.group for target in targets} == set(settings()["SupplementaryGroups"][0].split())


@needs_systemd
def test_systemd_reads_the_devices_beside_the_unit(tmp_path: Path) -> None:
    unit, beside = tmp_path / UNIT.name, tmp_path / DROP_IN.parent.name / DROP_IN.name
    beside.parent.mkdir()
    shutil.copy(UNIT, unit)
    beside.write_text(DROP_IN.read_text() + "DeviceAllow=nonsense rw\n")
    _, text = said("systemd-analyze", "verify", str(unit))
    assert "10-devices.conf" in text
    assert text.count("nonsense") == text.count("10-devices.conf:"), "what the drivers open is understood"


@pytest.mark.skipif(shutil.which("systemd-sysusers") is None, reason="needs systemd-sysusers (systemd)")
def test_users_and_folders_can_be_made(tmp_path: Path) -> None:
    (tmp_path / "etc").mkdir()
    code, text = said("systemd-sysusers", f"--root={tmp_path}", str(FOLDER / "probewatch.sysusers"))
    assert (code, "probewatch" in (tmp_path / "etc/passwd").read_text()) == (0, True), text
    groups = (tmp_path / "etc/group").read_text()
    assert re.search(r"^gpio:.*probewatch", groups, re.M)
    assert re.search(r"^probewatch:.*:probewatch-page$", groups, re.M)


@needs_udev
def test_udev_understands_the_rules() -> None:
    code, text = said("udevadm", "verify", str(FOLDER / "60-probewatch.rules"))
    if "Unknown" in text or "unrecognized" in text or "verify" not in said("udevadm", "--help")[1]:
        pytest.skip("needs udevadm verify (systemd 254)")
    assert code == 0, text
