"""`probewatch release` opens contacts that nobody holds any more; the service before it is configured."""

import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.twins.pty_line import PtyLine
from probewatch.drivers.twins.relay_board import RelayBoard
from tests.support.answering import Answering
from tests.support.answers import answered

PROBEWATCH = Path(sys.executable).parent / "probewatch"
CLOCK = HostClock()


def written(folder: Path, *outputs: str, head: str = "") -> Path:
    urls = "".join(f'[[output]]\nurl = "{url}"\n' for url in outputs)
    path = folder / "probewatch.toml"
    path.write_text(
        f'{head}video.url = "sim:/x"\ntracker.url = "ndi:/dev/x"\n{urls}[calibration]\nfile = "probe.toml"\n'
    )
    return path


@contextmanager
def board_that_holds(link: Path) -> Iterator[RelayBoard]:
    """A relay board whose contact is closed, and stays so until it is told otherwise."""
    stop = threading.Event()
    with PtyLine(link, CLOCK) as line:
        board = RelayBoard(line, CLOCK)
        board.contacts[1] = True
        thread = threading.Thread(target=board.run, args=(stop,))
        thread.start()
        try:
            yield board
        finally:
            stop.set()
            thread.join()


def test_a_contact_that_its_board_holds_closed_is_opened(tmp_path: Path) -> None:
    with board_that_holds(tmp_path / "relay") as board:
        released = answered("release", "--config", written(tmp_path, f"relay:{tmp_path}/relay"))
    assert (released.returncode, released.stderr) == (0, "")
    assert board.contacts == {1: False}


def test_one_that_is_not_there_is_named_and_does_not_keep_the_others_closed(tmp_path: Path) -> None:
    with board_that_holds(tmp_path / "relay") as board:
        config = written(tmp_path, "relay:/dev/no-such", f"relay:{tmp_path}/relay")
        released = answered("release", "--config", config)
    assert released.returncode == 69
    assert "/dev/no-such" in released.stderr
    assert board.contacts == {1: False}


def test_what_a_running_service_holds_is_left_to_it_and_that_is_told(tmp_path: Path) -> None:
    config = written(tmp_path, "relay:/dev/no-such", head=f'control.socket = "{tmp_path}/control"\n')
    said = f"a service runs at {tmp_path}/control and holds its outputs: it opens them itself when it ends"
    assert said not in answered("release", "--config", config).stderr
    with Answering(tmp_path / "control"):
        released = answered("release", "--config", config)
    assert (released.returncode, said in released.stderr) == (69, True), released
    first, second = released.stderr.splitlines()
    assert said in first, "it came after the remedy to close the program that holds the port"
    assert "/dev/no-such" in second
    assert "Plug the cable in" not in second


def test_an_unconfigured_service_is_alive_not_verified_and_says_why(tmp_path: Path) -> None:
    config = written(tmp_path, "relay:/dev/no-such", head="configured = false\n")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(20)
        environment = os.environ | {"NOTIFY_SOCKET": str(tmp_path / "notify")}
        with subprocess.Popen(
            [PROBEWATCH, "run", "--config", config], env=environment, stderr=subprocess.PIPE
        ) as service:
            said = [manager.recv(4096).decode() for _ in range(2)]
            service.send_signal(signal.SIGTERM)
            assert service.wait(10) == 0
    assert said[0].startswith("READY=1\nWATCHDOG=1\nSTATUS=not verified, alarm on: not configured yet.")
    assert str(config) in said[0]
    assert said[1].startswith("WATCHDOG=1")


def test_it_ends_to_be_started_again_once_it_is_configured(tmp_path: Path) -> None:
    config = written(tmp_path, "relay:/dev/no-such", head="configured = false\n")
    with subprocess.Popen([PROBEWATCH, "run", "--config", config], stderr=subprocess.PIPE, text=True) as service:
        assert service.stderr is not None
        assert "not configured" in service.stderr.readline()
        written(tmp_path, "relay:/dev/no-such")
        assert service.wait(20) == 0
