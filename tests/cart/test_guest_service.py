"""The service on the emulated machine: its GPIO line, its wall clock, its hardware watchdog.

The line under test is the red lamp's, which is energised, and so dark, while nothing red is to be shown: it needs no
verified calibration, which takes long under emulation, and is dropped by whatever drops the contact.
"""

import json
import re
import time
from collections.abc import Iterator

import pytest

from tests.cart.bench import (
    CONTACT,
    LAMP,
    LONGER_TIMEOUTS,
    RELAY,
    UNIT,
    await_gpio,
    configure,
    gpio,
    journal,
    show,
    wait_status,
)
from tests.cart.guest import PYTHON, SCRIPTS, Guest
from tests.cart.image import Image
from tests.support.polling import until

START_S = 150.0
WATCHDOG_S = 5.0
HOLD = "/sys/module/gpio_sim_cart/parameters/hold"
"""gpio-sim as built by tests.cart.image."""
RED = "gpio:/dev/gpiochip0?line=lamp red"


@pytest.fixture(scope="module")
def machine(guest_image: Image, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guest]:
    """Running, waiting for a scanner and a tracker that are not there."""
    with Guest(guest_image, tmp_path_factory.mktemp("guest")) as guest:
        guest.restore()
        guest.put_scripts()
        configure(guest, "sim:/run/no-scanner", "ndi:/dev/ttyUSB0", [CONTACT, RED], LONGER_TIMEOUTS)
        guest.sh("systemctl start probewatch", timeout_s=START_S)
        yield guest


def after_signal(guest: Guest, signal: int, seconds: float) -> float | None:
    """Milliseconds from the signal to the line's fall, measured in the guest; None if not within `seconds`."""
    pid = show(guest, "MainPID")
    look = f"{PYTHON} {SCRIPTS}/line.py after {signal} {pid} {seconds} 1"
    return json.loads(guest.sh(look, timeout_s=seconds + START_S).out)


def test_a_killed_daemon_drops_its_line_within_250_ms(machine: Guest) -> None:
    await_gpio(machine, LAMP, 1, START_S)
    before = show(machine, "MainPID")
    low_ms = after_signal(machine, 9, 5)
    print(f"SIGKILL: line low after {low_ms} ms")
    assert low_ms is not None
    assert low_ms < 250
    await_gpio(machine, LAMP, 1, START_S)
    assert show(machine, "MainPID") != before


def test_a_stopped_daemon_loses_its_line_within_the_watchdogs_time(machine: Guest) -> None:
    await_gpio(machine, LAMP, 1, START_S)
    low_ms = after_signal(machine, 19, 30)
    print(f"SIGSTOP: line low after {low_ms} ms, WatchdogSec={WATCHDOG_S:g}")
    assert low_ms is not None
    assert low_ms < (WATCHDOG_S + 1.0) * 1e3
    await_gpio(machine, LAMP, 1, START_S)


def test_a_chip_that_holds_its_level_is_released_by_the_unit(machine: Guest) -> None:
    """As many real controllers do. What it takes is the start of Python, here under emulation."""
    await_gpio(machine, LAMP, 1, START_S)
    machine.sh(f"echo 1 >{HOLD}")
    try:
        low_ms = after_signal(machine, 9, START_S)
    finally:
        machine.sh(f"echo 0 >{HOLD}")
    print(f"SIGKILL with a chip that holds its level: line low after {low_ms} ms")
    assert low_ms is not None
    await_gpio(machine, LAMP, 1, START_S)


def test_steps_of_the_wall_clock_disturb_nothing(machine: Guest) -> None:
    await_gpio(machine, LAMP, 1, START_S)
    before = show(machine, "MainPID")
    for step in ("+1 hour", "-2 hours", "+1 hour"):
        machine.sh(f"date -s '{step}' >/dev/null")
        for _ in range(5):
            assert gpio(machine, LAMP) == 1
            time.sleep(0.3)
    assert show(machine, "MainPID") == before
    assert show(machine, "ActiveState") == "active"
    said = journal(machine, UNIT, "PROBEWATCH_EVENT='wall clock stepped'")
    assert [round(float(entry["PROBEWATCH_BY_S"]) / 3600) for entry in said][-3:] == [1, -2, 1]


def test_a_hung_kernel_is_reset_by_the_hardware_and_the_alarm_is_on_again(machine: Guest) -> None:
    """The last test of this machine. A panic that does not reboot is as dead as a kernel can be."""
    await_gpio(machine, LAMP, 1, START_S)
    machine.sh("sync")
    checks, began_s = _file_system_checks(machine), time.monotonic()
    machine.begin("sleep 0.5; echo c >/proc/sysrq-trigger")
    until(lambda: _file_system_checks(machine) > checks, 90, 0.2, lambda: f"no reset: {machine.console()[-800:]}")
    reset_s = time.monotonic() - began_s
    machine.await_agent()
    print(f"kernel panic: reset and at the file system check after {reset_s:.1f} s")
    wait_status(machine, ("waiting", "self-test", "device lost", "not verified"), START_S)
    assert gpio(machine, RELAY) == 0


def _file_system_checks(machine: Guest) -> int:
    """How often one was said on the console: once for each boot."""
    return len(re.findall(r"clean,|recovering journal", machine.console()))
