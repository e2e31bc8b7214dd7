"""The service under real systemd at full speed: killed, stopped, starved of its disk, and whether it comes back."""

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.cart.bench import UNIT, journal, show, wait_status
from tests.cart.cart_in_container import await_contact, contact, main_pid, start_service, start_twins
from tests.cart.container import Container
from tests.cart.image import Image, run
from tests.support.polling import until

STATE = "/var/lib/probewatch"
WATCHDOG_S = 5.0
VERIFY_S = 90.0
UNDEAD_S = 25.0
"""Until the unit's release command has run after a service that cannot die: WatchdogSec, 1 s, TimeoutStopSec=15."""


@pytest.fixture(scope="module")
def running(container_image: Image, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Container]:
    """One cart for all that it survives."""
    with Container(container_image, tmp_path_factory.mktemp("cart")) as machine:
        start_twins(machine)
        start_service(machine)
        yield machine


@pytest.fixture
def cart(running: Container) -> Container:
    """Verified, its contact closed."""
    wait_status(running, "monitoring", VERIFY_S)
    await_contact(running, True, 5)
    return running


def test_a_killed_daemon_opens_the_contact_and_comes_back(cart: Container) -> None:
    """The relay board holds its contact without the service, so this is the time of the unit's release command."""
    before, killed_s = main_pid(cart), time.monotonic()
    cart.sh(f"kill -KILL {before}")
    opened_s = await_contact(cart, False, 10) - killed_s
    print(f"SIGKILL: relay board open after {opened_s:.2f} s")
    assert opened_s < 3.0
    wait_status(cart, "monitoring", VERIFY_S)
    assert main_pid(cart) != before


def test_a_stopped_daemon_is_killed_by_the_watchdog(cart: Container) -> None:
    before, stopped_s = main_pid(cart), time.monotonic()
    cart.sh(f"kill -STOP {before}")
    opened_s = await_contact(cart, False, 30) - stopped_s
    print(f"SIGSTOP: relay board open after {opened_s:.2f} s, WatchdogSec={WATCHDOG_S:g}")
    assert opened_s < WATCHDOG_S + 1.0 + 2.0, "a board that holds its contact waits for the release command as well"
    wait_status(cart, "monitoring", VERIFY_S)
    assert main_pid(cart) != before


def test_a_killed_estimator_alarms_and_is_started_again_alone(cart: Container) -> None:
    pid, restarts = main_pid(cart), show(cart, "NRestarts")
    child = cart.sh(f"pgrep -P {pid}").out.split()[0]
    killed_s = time.monotonic()
    cart.sh(f"kill -KILL {child}")
    opened_s = await_contact(cart, False, 10) - killed_s
    print(f"estimator SIGKILL: contact open after {opened_s:.2f} s")
    assert opened_s < 1.0 + 0.5, "one second, and the time of the kill command itself"
    (said,) = journal(cart, UNIT, "PROBEWATCH_EVENT='estimator ended'")
    assert (said["PROBEWATCH_HOW"], said["PROBEWATCH_RESTART"], said["PRIORITY"]) == ("killed by SIGKILL", "1", "3")
    wait_status(cart, "monitoring", VERIFY_S)
    assert main_pid(cart) == pid
    assert show(cart, "NRestarts") == restarts


def test_an_unplugged_tracker_and_scanner_are_lost_once_and_back_once(cart: Container) -> None:
    for twin, role in (("polaris", "tracker"), ("scanner", "video")):
        since = cart.sh("date +%s").out.strip()
        cart.sh(f"kill -STOP $(systemctl show -P MainPID twin-{twin})")
        stopped_s = time.monotonic()
        opened_s = await_contact(cart, False, 10) - stopped_s
        print(f"{twin} silent: contact open after {opened_s:.2f} s")
        assert opened_s < 3.0
        time.sleep(4)
        cart.sh(f"kill -CONT $(systemctl show -P MainPID twin-{twin})")
        wait_status(cart, "monitoring", VERIFY_S)
        events = [e["PROBEWATCH_EVENT"] for e in journal(cart, UNIT, f"PROBEWATCH_DEVICE={role}", f"--since=@{since}")]
        assert events.count("device lost") == events.count("device back") <= 1


@pytest.mark.parametrize("how", ["full", "read-only"])
def test_without_room_for_its_state_it_goes_on_watching(cart: Container, how: str) -> None:
    """The state folder becomes a file system of its own, then full or read-only: for the running service as well."""
    options = "size=256k,mode=750,uid=probewatch,gid=probewatch"
    cart.sh(f"systemctl stop {UNIT} && mount -t tmpfs -o {options} tmpfs /var/lib/probewatch")
    try:
        cart.sh(f"systemctl start {UNIT}")
        wait_status(cart, "monitoring", VERIFY_S)
        if how == "full":
            cart.sh("dd if=/dev/zero of=/var/lib/probewatch/ballast bs=4k", check=False)
        else:
            cart.sh(
                f"mount -o remount,ro /var/lib/probewatch; nsenter -t {main_pid(cart)} -m mount -o remount,ro "
                "/var/lib/probewatch"
            )
        pid, since = main_pid(cart), cart.sh("date +%s").out.strip()
        cart.sh("kill -STOP $(systemctl show -P MainPID twin-polaris)")
        await_contact(cart, False, 10)
        cart.sh("kill -CONT $(systemctl show -P MainPID twin-polaris)")
        wait_status(cart, "monitoring", VERIFY_S)
        assert main_pid(cart) == pid
        said = cart.sh(f"journalctl -u {UNIT} --since=@{since} --no-pager -o cat -p warning").out.lower()
        assert ("no space" if how == "full" else "read-only") in said, said
    finally:
        cart.sh(f"systemctl stop {UNIT}; umount /var/lib/probewatch; systemctl start {UNIT}")


@contextmanager
def silent_disk(cart: Container) -> Iterator[Callable[[], None]]:
    """The state folder becomes an ext4 of its own; calling what this gives freezes it: the kernel lets who writes there
    wait, for ever and deaf to every signal, as it does on a dead disk or a share whose server is gone.
    """
    disk = Path(cart.log.name).with_name("state.img")
    run("truncate", "--size=32M", str(disk))
    run("mke2fs", "-q", "-t", "ext4", str(disk))
    loop = run("losetup", "--find", "--show", str(disk)).strip()
    node = "/dev/state-disk"
    cart.sh(f"systemctl stop {UNIT}; rm -f {node}; mknod {node} b 7 {loop.removeprefix('/dev/loop')}")
    cart.sh(f"mount {node} {STATE} && chown probewatch: {STATE} && systemctl start {UNIT}")
    try:
        wait_status(cart, "monitoring", VERIFY_S)
        yield lambda: cart.sh(f"fsfreeze --freeze {STATE}")
    finally:
        cart.sh(f"fsfreeze --unfreeze {STATE}", check=False)
        cart.sh(f"systemctl stop {UNIT}; umount {STATE}")
        run("losetup", "--detach", loop)
        cart.sh(f"systemctl start {UNIT}")


def test_a_disk_that_does_not_answer_takes_no_alarm_away(cart: Container) -> None:
    with silent_disk(cart) as freeze:
        pid, since = main_pid(cart), cart.sh("date +%s").out.strip()
        freeze()
        for closed, sign in ((False, "STOP"), (True, "CONT")):
            began_s = time.monotonic()
            cart.sh(f"kill -{sign} $(systemctl show -P MainPID twin-polaris)")
            took_s = await_contact(cart, closed, 10 if not closed else VERIFY_S) - began_s
            print(f"silent disk, tracker {sign}: contact {'closed' if closed else 'open'} after {took_s:.2f} s")
        assert main_pid(cart) == pid
        said = f"journalctl -u {UNIT} --since=@{since} --no-pager -o cat -p warning"
        hangs = re.compile(rf"what={STATE}/alarm(s-\d+\.jsonl|-memory\.json) has not answered for")
        until(lambda: hangs.search(cart.sh(said).out), 10, cart.look_s, lambda: cart.sh(said).out)
        cart.sh(f"fsfreeze --unfreeze {STATE}")
        until(lambda: "has not answered" not in cart.sh("probewatch status --json").out, 10, cart.look_s)
        verified = cart.sh(f"probewatch log {STATE} --verify").out
        assert "the chain is whole" in verified


def test_a_service_that_dies_while_its_disk_does_not_answer_opens_the_contact(cart: Container) -> None:
    """A thread of it cannot die before the disk answers, so that systemd, too, waits for it; its devices do not."""
    with silent_disk(cart) as freeze:
        freeze()
        before = main_pid(cart)
        cart.sh("probewatch lamp-test")
        until(lambda: "has not answered" in cart.sh("probewatch status --json", check=False).out, 10, cart.look_s)
        killed_s = time.monotonic()
        cart.sh(f"kill -KILL {before}")
        opened_s = await_contact(cart, False, UNDEAD_S) - killed_s
        print(f"silent disk, SIGKILL: relay board open after {opened_s:.2f} s")
        cart.sh(f"fsfreeze --unfreeze {STATE}")
        until(lambda: main_pid(cart) not in (0, before), UNDEAD_S, cart.look_s)
        wait_status(cart, "monitoring", VERIFY_S)


def test_the_alarm_log_names_who_asked_and_each_user_has_an_allowance(cart: Container) -> None:
    for name in ("anna", "bert"):
        cart.sh(f"useradd --groups probewatch {name}")
    asked = cart.sh("for i in $(seq 31); do runuser -u anna -- probewatch lamp-test; done", check=False).out
    assert "anna has asked too often (30 at once, then one in 60 s); wait" in asked
    cart.sh("runuser -u bert -- probewatch lamp-test")
    said = until(lambda: (log := cart.sh("probewatch log --event request --last 31").out) and "bert" in log and log, 10)
    assert [said.count(f"lamp-test by {name}, process") for name in ("anna", "bert")] == [30, 1]


def test_it_stops_in_order(cart: Container) -> None:
    began_s = time.monotonic()
    cart.sh(f"systemctl stop {UNIT}")
    assert contact(cart)[0] is False
    assert time.monotonic() - began_s < 10
    assert show(cart, "Result") == "success"
