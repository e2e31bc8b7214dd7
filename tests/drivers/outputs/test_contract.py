"""What every alarm output promises, whatever drives it: one suite over every URL scheme that can be an output.

Boards answer behind a real pseudo-terminal and the player hands its sound to ALSA's file plug-in. A GPIO line and a
control line need a kernel device: the same promises are kept there by tests/cart/test_kernel_devices.py.
"""

import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.descriptor import Driver
from probewatch.drivers.device_api import AlarmOutput
from probewatch.drivers.errors import DeviceLost
from probewatch.drivers.registry import drivers, open_output
from tests.support.absent import absent_url
from tests.support.boards import running_board
from tests.support.polling import until
from tests.support.stopwatch import Stopwatch

CLOCK = HostClock()
SWITCHED_S = 2.0
"""How late a board without answers may switch on a busy machine."""


@dataclass
class Bench:
    """An output on a bench. url: what opens it. energised: what the device itself shows. pull: its plug."""

    url: str
    energised: Callable[[], bool]
    pull: Callable[[], object]


def _relay(folder: Path, stack: ExitStack, answers: bool) -> Bench:
    pulled = stack.enter_context(ExitStack())
    board = pulled.enter_context(running_board(folder / "relay", CLOCK, answers=answers))
    return Bench(f"relay:{folder}/relay", lambda: board.contacts[1], pulled.close)


def _tone(folder: Path, stack: ExitStack) -> Bench:
    heard = folder / "heard.raw"
    return Bench(f"tone:file:FILE={heard},FORMAT=raw", lambda: not _sounds(heard), lambda: None)


def _sounds(heard: Path) -> bool:
    """Whether the last tenth of a second handed to ALSA is more than silence."""
    return heard.exists() and any(heard.read_bytes()[-3200:])


BENCHES: dict[str, Callable[[Path, ExitStack], Bench]] = {
    "relay": lambda folder, stack: _relay(folder, stack, answers=True),
    "relay that is mute": lambda folder, stack: _relay(folder, stack, answers=False),
    "tone": _tone,
}
KERNEL = ("gpio", "serialpin")
"""Schemes whose device only a kernel can be: tests/cart/test_kernel_devices.py holds them to the same."""
OUTPUTS = [driver for driver in drivers().values() if driver.contact is not None]


@pytest.fixture(params=BENCHES)
def bench(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Bench]:
    if request.param == "tone" and shutil.which("aplay") is None:
        pytest.skip("aplay (alsa-utils) is not installed")
    with ExitStack() as stack:
        yield BENCHES[request.param](tmp_path, stack)


def hold(output: AlarmOutput, energised: bool, seconds: float = 0.4) -> None:
    """The service's writes, twenty a second."""
    end_ns = CLOCK.now_ns() + round(seconds * 1e9)
    while CLOCK.now_ns() < end_ns:
        output.write(energised)
        CLOCK.sleep_until(CLOCK.now_ns() + 50_000_000)


def test_every_scheme_of_an_output_is_held_by_this_suite() -> None:
    assert {driver.scheme for driver in OUTPUTS} == {name.split()[0] for name in BENCHES} | set(KERNEL)


def test_the_device_shows_what_was_written(bench: Bench) -> None:
    with open_output(bench.url, CLOCK) as output:
        for energised in (True, False, True):
            hold(output, energised)
            until(lambda wanted=energised: bench.energised() is wanted, SWITCHED_S)


def test_what_is_read_back_is_what_was_written_or_none(bench: Bench) -> None:
    with open_output(bench.url, CLOCK) as output:
        for energised in (True, False):
            output.write(energised)
            assert output.read_back() in (energised, None)


@pytest.mark.parametrize("error", [None, RuntimeError])
def test_leaving_the_context_de_energises(bench: Bench, error: type[Exception] | None) -> None:
    """A tone ends with its player; every contact is open."""
    with suppress(RuntimeError), open_output(bench.url, CLOCK) as output:
        hold(output, energised=True, seconds=0.1)
        if error is not None:
            raise error
    if bench.url.startswith("tone:"):
        with pytest.raises((DeviceLost, ValueError)):
            hold(output, energised=False)
    else:
        until(lambda: not bench.energised(), SWITCHED_S)


def test_a_write_holds_the_tick_up_for_less_than_its_command_lives(bench: Bench) -> None:
    """Commands live .25 s; the slowest write of an idle device must leave room for the next."""
    with open_output(bench.url, CLOCK) as output:
        output.write(True)
        slowest_s = 0.0
        for energised in (False, True) * 5:
            watch = Stopwatch()
            output.write(energised)
            slowest_s = max(slowest_s, watch.spent_s())
        assert slowest_s < 0.25


@pytest.mark.parametrize("bench", [kind for kind in BENCHES if kind != "tone"], indirect=True)
def test_a_device_that_is_gone_is_lost_with_a_place_and_a_remedy(bench: Bench) -> None:
    """ALSA's file cannot be unplugged; tests/drivers/outputs/test_tone.py ends the player."""
    with open_output(bench.url, CLOCK) as output:
        output.write(True)
        bench.pull()
        with pytest.raises(DeviceLost) as loss:
            hold(output, energised=True, seconds=3.0)
    assert loss.value.where
    assert loss.value.remedy


@pytest.mark.parametrize("driver", OUTPUTS, ids=lambda driver: driver.scheme)
def test_what_is_not_there_is_lost_with_a_place_and_a_remedy(driver: Driver) -> None:
    url = absent_url(driver)
    if url.startswith("tone:") and shutil.which("aplay") is None:
        pytest.skip("aplay (alsa-utils) is not installed")
    with pytest.raises(DeviceLost) as loss, open_output(url, CLOCK) as output:
        hold(output, energised=False, seconds=2.0)
    assert loss.value.where
    assert loss.value.remedy
