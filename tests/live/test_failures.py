"""Walks the table of docs/failures.md on a simulated cart: kill, stop or starve one part, see contact and state."""

import contextlib
import os
import re
import signal
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from probewatch.appliance.service.control.allowance import BURST
from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.storage.alarm_chain import read_log, segments
from tests.support.demo_cart import Cart
from tests.support.polling import until
from tests.support.signals import family, stop

PAGE = Path(__file__).parents[2] / "docs" / "failures.md"
_TWINS = {"scanner": "scanner", "tracker": "polaris", "alarm output": "relay_board"}


@dataclass(frozen=True)
class Row:
    """contact_s: None where the table promises nothing; keeps: the contact must stay closed."""

    part: str
    what: str
    contact_s: float | None
    keeps: bool
    state: str
    fault: str | None
    within_s: float


def rows() -> list[Row]:
    cells = [re.split(r" *\| *", line.strip("| \n")) for line in PAGE.read_text().splitlines() if line.startswith("| ")]
    return [_row(*row) for row in cells[1:] if "*cart*" not in row[1]]


def _row(part: str, what: str, contact: str, state: str, within: str, recovery: str) -> Row:
    named = re.fullmatch(r"([a-z ]+?)(?: \((.*)\))?", state)
    assert named is not None
    seconds = re.fullmatch(r"([\d.]+) s", contact)
    contact_s = None if seconds is None else float(seconds[1])
    return Row(part, what, contact_s, "stays closed" in contact, named[1], named[2], float(within.removesuffix(" s")))


Undo = Callable[[], None]


def kill_twin(cart: Cart, part: str) -> Undo:
    cart.kill_twin(_TWINS[part])
    return lambda: cart.start_twin(_TWINS[part])


def stop_twin(cart: Cart, part: str) -> Undo:
    pids = family(cart.twins[_TWINS[part]].process.pid)
    return stop(pids)


def kill_estimator(cart: Cart, part: str) -> Undo:
    os.kill(cart.estimator_pid(), signal.SIGKILL)
    return lambda: None


def stop_estimator(cart: Cart, part: str) -> Undo:
    return stop([cart.estimator_pid()])


def late_board(cart: Cart, part: str) -> Undo:
    """Deaf while the service starts, so that it does not answer when it is first asked; then it hangs once more."""
    assert cart.daemon is not None
    cart.daemon.end()
    listen = stop_twin(cart, part)
    cart.start_daemon()
    until(cart.status, 10)
    time.sleep(1)
    listen()
    cart.wait_for("monitoring")
    until(cart.contact)
    time.sleep(2)
    return stop_twin(cart, part)


def fill_disk(cart: Cart, part: str) -> Undo:
    make_room = cart.fill_disk()
    with ControlClient(cart.socket) as client:
        client.test_lamps()
    until(lambda: cart.status()["notices"], 5)
    assert cart.status()["tick"]["p99_ms"] < 200
    return make_room


def silence_disk(cart: Cart, part: str) -> Undo:
    """The log's file becomes a pipe that nobody reads: who opens it waits in the kernel, as on a disk that is dead."""
    folder = cart.folder / "alarms"
    segment = segments(folder)[-1]
    until(lambda: cart.status()["log"]["waiting"] == 0)
    kept, pipe = folder / "kept", folder / "pipe"
    segment.rename(kept)
    os.mkfifo(segment)
    with ControlClient(cart.socket) as client:
        client.test_lamps()
    until(lambda: cart.status()["notices"], 5)
    assert str(segment) in cart.status()["log"]["failing"], "the file is named"

    def answer() -> None:
        segment.rename(pipe)
        kept.rename(segment)
        os.close(os.open(pipe, os.O_RDONLY | os.O_NONBLOCK))
        until(lambda: cart.status()["log"]["waiting"] == 0)
        assert read_log(folder).damages == ()

    return answer


def flood_socket(cart: Cart, part: str) -> Undo:
    for _ in range(20):
        with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX) as link:
            link.settimeout(0.1)
            link.connect(str(cart.socket))
            link.sendall(b'{"v": 1, "do": "status"}\n' * 4000)
    return lambda: None


def flood_log(cart: Cart, part: str) -> Undo:
    """Whatever writes to the log, as fast as it is answered, until it is refused."""
    before = cart.status()["log"]["entries"]
    with ControlClient(cart.socket) as client, pytest.raises(ControlRefused, match="has asked too often"):
        _begin_and_abort(client, 1000)
    until(lambda: cart.status()["log"]["waiting"] == 0)
    assert cart.status()["log"]["entries"] - before < 4 * BURST

    def restart() -> None:
        """Else the tests that follow would have to wait for their allowance."""
        cart.daemon.end()
        cart.start_daemon()

    return restart


def _begin_and_abort(client: ControlClient, times: int) -> None:
    for _ in range(times):
        client.begin_recalibration()
        client.abort_recalibration()


def name_pipe(cart: Cart, part: str) -> Undo:
    """Who opens it waits for a writer, for ever; again and again."""
    cart.config.rename(kept := cart.folder / "kept.toml")
    os.mkfifo(cart.config)
    with ControlClient(cart.socket) as client:
        for _ in range(20):
            with pytest.raises(ControlRefused, match=f"{cart.config}: .*it is a pipe"):
                client.reload()

    def answer() -> None:
        kept.replace(cart.config)
        with ControlClient(cart.socket) as client:
            client.reload()

    return answer


def pause_service(cart: Cart, part: str) -> Undo:
    assert cart.daemon is not None
    go_on = stop([cart.daemon.process.pid])
    time.sleep(2)
    go_on()
    return lambda: None


def kill_halted_service(cart: Cart, part: str) -> Undo:
    assert cart.daemon is not None
    cart.say("polarity")
    cart.wait_for("halt")
    until(lambda: cart.status()["log"]["waiting"] == 0)
    cart.daemon.end(kill=True)
    cart.say(None)
    cart.start_daemon()

    def acknowledge() -> None:
        with ControlClient(cart.socket) as client:
            client.acknowledge()

    return acknowledge


ACTIONS: dict[tuple[str, str], Callable[[Cart, str], Undo]] = {
    **{(part, "killed"): kill_twin for part in _TWINS},
    **{(part, "stopped"): stop_twin for part in _TWINS},
    ("alarm output", "hangs at the start, and again later"): late_board,
    ("estimator", "killed"): kill_estimator,
    ("estimator", "stopped"): stop_estimator,
    ("log disk", "full"): fill_disk,
    ("log disk", "does not answer"): silence_disk,
    ("control client", "floods the socket"): flood_socket,
    ("control client", "floods the alarm log"): flood_log,
    ("control client", "names a pipe in place of a file"): name_pipe,
    ("service", "stopped, then goes on"): pause_service,
    ("service", "killed while halted"): kill_halted_service,
}


def test_the_table_and_this_test_know_the_same_failures() -> None:
    assert {(row.part, row.what) for row in rows()} == set(ACTIONS)


@pytest.mark.parametrize("row", rows(), ids=lambda row: f"{row.part} {row.what}")
def test_one_part_fails(cart: Cart, row: Row) -> None:
    cart.wait_for("monitoring")
    until(cart.contact)
    began_s = time.monotonic()
    undo = ACTIONS[row.part, row.what](cart, row.part)
    try:
        if row.contact_s is not None:
            cart.open_contact(began_s, row.contact_s)
        status = cart.wait_for(row.state, row.within_s)
        assert status["fault"] == row.fault
        assert not row.keeps or cart.contact(began_s) is None, "the contact stays as it is"
    finally:
        undo()
    cart.wait_for("monitoring", 30)
