"""The square wave for a watchdog relay, made by the writes."""

import pytest

from probewatch.drivers.descriptor import Given
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.outputs.heartbeat import HEARTBEAT, Heartbeat, heartbeat_from

TICK_NS = 50_000_000


def wave(beat: Heartbeat, commands: list[bool], start_ns: int = 10**12) -> list[bool]:
    return [beat.level(command, start_ns + n * TICK_NS) for n, command in enumerate(commands)]


def given(**options: str) -> Given:
    return Given((HEARTBEAT,), options, "gpio:/dev/x")


def test_without_a_heartbeat_the_level_is_the_command() -> None:
    commands = [True, True, False, True, False, False]
    assert wave(heartbeat_from(given()), commands) == commands


@pytest.mark.parametrize(("rate", "ticks"), [("0.5", 20), ("1", 10), ("2", 5), ("5", 2)])
def test_the_wave_has_equal_halves_of_the_period_asked_for(rate: str, ticks: int) -> None:
    levels = wave(heartbeat_from(given(heartbeat=rate)), [True] * 4 * ticks)
    assert levels == ([True] * ticks + [False] * ticks) * 2


def test_jitter_of_the_ticks_does_not_change_the_period() -> None:
    beat = heartbeat_from(given(heartbeat="2"))
    levels = [beat.level(True, 10**12 + n * TICK_NS + (n * 7 % 5 - 2) * 5_000_000) for n in range(40)]
    assert levels == ([True] * 5 + [False] * 5) * 4


def test_de_energised_is_low_at_once_and_the_wave_begins_again() -> None:
    beat = heartbeat_from(given(heartbeat="1"))
    levels = wave(beat, [True] * 3 + [False] * 30 + [True] * 3)
    assert levels == [True] * 3 + [False] * 30 + [True] * 3


def test_a_flickering_command_is_not_faster_than_the_wave() -> None:
    levels = wave(heartbeat_from(given(heartbeat="1")), [True, False] * 10)
    assert sum(levels) == 2


def test_when_writes_stop_the_wave_stands_still() -> None:
    beat = heartbeat_from(given(heartbeat="5"))
    beat.level(True, 10**12)
    assert beat.level(True, 10**12 + 20 * 10**9) is False, "one step at the next write, none in between"


@pytest.mark.parametrize("text", ["0", "0.4", "5.1", "fast", "nan", "-1"])
def test_a_rate_out_of_range_is_refused(text: str) -> None:
    with pytest.raises(ConfigurationError, match=r"0\.5 to 5 Hz"):
        heartbeat_from(given(heartbeat=text))
