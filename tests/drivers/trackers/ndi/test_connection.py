"""The first attempt to connect succeeds, whatever state the tracker, its line and the last program left behind."""

import os
import random
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
import serial

from probewatch.drivers.samples import PoseStatus
from probewatch.drivers.trackers.ndi.wire import Command, encode_command
from probewatch.drivers.twins.ndi.combined_api import Mode
from probewatch.drivers.twins.ndi.models import AURORA, MODELS, SPECTRA, VEGA, Model
from probewatch.drivers.twins.pty_line import PtyLine
from probewatch.drivers.twins.tcp_line import TcpLine
from tests.support.polling import until as wait_until
from tests.support.simulated_ndi import Bench, bench, until

_LISTEN_S = 0.3


def speak(cart: Bench, baud: int, *lines: bytes) -> None:
    """What another program did to the device before us; it goes away in the middle, without a word."""
    if isinstance(cart.line, TcpLine):
        with socket.create_connection(("127.0.0.1", cart.line.port), _LISTEN_S) as connection:
            for line in lines:
                connection.sendall(line)
                with suppress(TimeoutError):
                    connection.recv(4096)
        return
    with serial.Serial(str(cart.folder / "tracker"), baud, timeout=_LISTEN_S) as port:
        for line in lines:
            port.write(line)
            if line.endswith(b"\r"):
                port.read_until(b"\r")


def command(text: str) -> bytes:
    name, _, arguments = text.partition(" ")
    return encode_command(Command(name, arguments))


def leave_powered_on(cart: Bench) -> None:
    cart.twin.device.reset()


def leave_at_115200(cart: Bench) -> None:
    speak(cart, 9600, command("INIT"), command("COMM 50000"))


def leave_at_an_odd_speed(cart: Bench) -> None:
    speak(cart, 9600, command("INIT"), command("COMM 30000"))


def leave_tracking(cart: Bench) -> None:
    with cart.open() as tracker:
        until(tracker, PoseStatus.OK)
        tracker._session.stop = lambda: None  # type: ignore[method-assign]
    assert cart.twin.device.mode is Mode.TRACKING


def leave_ports_enabled(cart: Bench) -> None:
    with cart.open() as tracker:
        until(tracker, PoseStatus.OK)
    assert any(port.enabled for port in cart.twin.device.ports.values())


def leave_handles(cart: Bench) -> None:
    speak(cart, 9600, command("INIT"), *[command("PHRQ *********1****")] * 5)


def leave_half_a_command(cart: Bench) -> None:
    speak(cart, 9600, b"PVWR:0A0040000102")


def leave_a_reply_under_way(cart: Bench) -> None:
    """Garbage in the host's buffer, and the second half of a reply still coming."""
    if isinstance(cart.line, PtyLine):
        os.write(cart.line._master, bytes(range(1, 256)) + b"\xc4\xa5\xff\xff")
    speak(cart, 9600, command("VER 4")[:-1] + b"\rBEEP 1\r")


def leave_a_reset_pending(cart: Bench) -> None:
    cart.twin.reset()
    wait_until(lambda: cart.twin._boot_ns is not None)


STATES = [
    leave_powered_on,
    leave_at_115200,
    leave_at_an_odd_speed,
    leave_tracking,
    leave_ports_enabled,
    leave_handles,
    leave_half_a_command,
    leave_a_reply_under_way,
    leave_a_reset_pending,
]
NETWORK_STATES = [leave_tracking, leave_handles, leave_half_a_command, leave_a_reset_pending]


def connect_once(cart: Bench) -> None:
    with cart.open() as tracker:
        assert until(tracker, PoseStatus.OK).matrix is not None
        wireless = [port for port in cart.twin.device.ports.values() if not port.socket]
        assert len(wireless) == (not cart.twin.device.model.electromagnetic), "left-over handles are freed"


@pytest.mark.parametrize("leave", STATES)
def test_first_connection_succeeds_from_every_state(tmp_path: Path, leave: Callable[[Bench], None]) -> None:
    with bench(tmp_path, SPECTRA, rate=8.0) as cart:
        leave(cart)
        connect_once(cart)


@pytest.mark.parametrize("leave", NETWORK_STATES)
def test_first_connection_over_the_network(tmp_path: Path, leave: Callable[[Bench], None]) -> None:
    """A boot is waited for in true time: the second that connecting leaves it must outlast a busy computer's pauses."""
    with bench(tmp_path, VEGA, rate=1.0 if leave is leave_a_reset_pending else 4.0) as cart:
        leave(cart)
        connect_once(cart)


def test_first_connection_to_plugs_left_enabled(tmp_path: Path) -> None:
    with bench(tmp_path, AURORA, rate=8.0, wired=("probe", "reference")) as cart:
        leave_tracking(cart)
        connect_once(cart)


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS.values(), ids=lambda model: model.name)
def test_25_of_25_first_connections_from_random_states(model: Model, tmp_path: Path) -> None:
    """One to three things that others did, in any order; four models make a hundred."""
    choose = random.Random(model.name)
    states = NETWORK_STATES if model.network else STATES
    with bench(tmp_path, model, rate=5.0, wired=("probe",) * model.electromagnetic) as cart:
        for _ in range(25):
            for leave in choose.sample(states, choose.randint(1, 3)):
                with suppress(AssertionError, OSError):  # what one program leaves may keep the next from speaking
                    leave(cart)
            time.sleep(choose.uniform(0, 0.2))
            connect_once(cart)
            if choose.random() < 0.5:
                leave_tracking(cart)
