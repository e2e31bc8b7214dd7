"""A thousand clients of the control socket that do what no client should, before the whole service in simulated time.

That they slow no tick is shown in real time: tests/live/test_exhaustion.py, and the floods of docs/failures.md.
"""

import contextlib
import os
import random
import socket
from pathlib import Path

import pytest

from probewatch.drivers.errors import ProbewatchError
from tests.support.simulated_cart import SimulatedCart

WITH_FILE = ("propose-calibration", "end-recalibration")
HOSTILE_BODIES = (
    ', "seconds": 1e999',
    ', "file": "/dev/zero"',
    ', "file": 7',
    ', "reason": [1]',
    ', "reason": "\\ud800 \\ud800"',
)
CROWD, AT_ONCE = 200, 8


def connected(path: Path) -> socket.socket:
    link = socket.socket(socket.AF_UNIX)
    link.connect(str(path))
    link.setblocking(False)
    return link


def hostile(path: Path, chance: random.Random) -> socket.socket:
    """One client that has said what no client should."""
    link, kind = connected(path), chance.randrange(5)
    with contextlib.suppress(OSError):
        if kind == 0:
            link.send(chance.randbytes(chance.randrange(1, 3000)) + b"\n")
        elif kind == 1:
            link.send(b"x" * 100_000)
        elif kind == 2:
            link.send(b'{"v": 1, "do": "sta')
        elif kind == 3:
            do = chance.choice(
                ["status", "acknowledge", "reload", "pause-audio", "audio-off", *WITH_FILE, "?", "\\ud800"]
            )
            body = chance.choice(["", *HOSTILE_BODIES, f', "file": "{path.with_name("pipe")}"'])
            link.send(f'{{"v": 1, "do": "{do}"{body}}}\n'.encode() * chance.randrange(1, 20))
    return link


def test_a_thousand_hostile_inputs_change_nothing(monitoring: SimulatedCart) -> None:
    """Half of them wait for the first byte of an answer; two hundred others say nothing all the while."""
    before, began_s, chance = monitoring.status(), monitoring.now_s(), random.Random(5)
    os.mkfifo(monitoring.socket.with_name("pipe"))
    with contextlib.ExitStack() as stack:
        for _ in range(CROWD):
            stack.enter_context(connected(monitoring.socket))
        for _ in range(1000 // AT_ONCE):
            links = [hostile(monitoring.socket, chance) for _ in range(AT_ONCE)]
            for link in links[::2]:
                link.close()
            monitoring.tick()
            monitoring.tick()
            for link in links[1::2]:
                with contextlib.suppress(OSError):
                    link.recv(1)
                link.close()
    after = monitoring.status()
    with monitoring.client() as client:
        client.audio_on()
    assert (after["state"], after["fault"], after["energised"]) == ("monitoring", None, True)
    assert monitoring.said(event="state")[-1]["state"] == "monitoring"
    assert monitoring.switched(began_s) == []
    assert after["counters"]["device_losses"] == before["counters"]["device_losses"]
    assert after["counters"]["dropped_clients"] > before["counters"]["dropped_clients"]


@pytest.mark.parametrize("do", ["propose-calibration", "end-recalibration", "reload"])
def test_a_file_whose_mistake_cannot_be_quoted_is_refused_and_ends_nothing(
    monitoring: SimulatedCart, tmp_path: Path, do: str
) -> None:
    """A member of the group names the file; the exception ended the service."""
    file = tmp_path / "long.toml"
    file.write_text(f'format = "probewatch-calibration"\nversion = 1\nimage_size_px = [0x{"f" * 4000}, 480]\n')
    if do == "reload":
        monitoring.config.write_text(monitoring.config.read_text() + f"limits.offset_mm = 0x{'f' * 4000}\n")
    with monitoring.client() as client:
        if do == "end-recalibration":
            client.begin_recalibration()
        with pytest.raises(ProbewatchError, match="a whole number of more than 63 bits"):
            client._ask(do=do, **({} if do == "reload" else {"file": str(file)}))
    assert monitoring.contact() is (do != "end-recalibration")
