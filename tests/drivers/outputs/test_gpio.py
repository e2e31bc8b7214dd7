"""The GPIO output: its URL here, its order of calls on a stand-in of gpiod; the kernel's own chip is in tests/cart."""

import errno
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import gpiod
import pytest
from gpiod.line import Direction, Value

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError, DeviceLost
from probewatch.drivers.registry import open_output

CLOCK = HostClock(rate=20.0)
CHIP = "gpio:/dev/null"


class Chip:
    """Keeps what was asked of it. stuck: levels do not follow. sensed: what an input reads."""

    def __init__(self) -> None:
        self.config: dict[object, gpiod.LineSettings] = {}
        self.levels: dict[object, Value] = {}
        self.log: list[object] = []
        self.stuck, self.sensed, self.gone = False, Value.INACTIVE, False

    def request_lines(self, path: str, consumer: str, config: dict[object, gpiod.LineSettings]) -> "Chip":
        self.config = config
        self.levels = {line: settings.output_value for line, settings in config.items()}
        return self

    def set_value(self, line: object, value: Value) -> None:
        if self.gone:
            raise OSError(errno.ENODEV, "No such device")
        self.log.append(value)
        if not self.stuck:
            self.levels[line] = value

    def get_value(self, line: object) -> Value:
        return self.sensed if self.config[line].direction is Direction.INPUT else self.levels[line]

    def release(self) -> None:
        self.log.append("released")


class OpenedChip:
    def __init__(self, path: str) -> None: ...
    def __enter__(self) -> "OpenedChip":
        return self

    def __exit__(self, *_: object) -> None: ...
    def get_info(self) -> SimpleNamespace:
        return SimpleNamespace(label="bench", num_lines=8)


@pytest.fixture
def chip(monkeypatch: pytest.MonkeyPatch) -> Iterator[Chip]:
    made = Chip()
    monkeypatch.setattr(gpiod, "request_lines", made.request_lines)
    monkeypatch.setattr(gpiod, "Chip", OpenedChip)
    return made


def test_the_line_is_inactive_when_taken_and_before_it_is_released(chip: Chip) -> None:
    with open_output(f"{CHIP}?line=3", CLOCK) as output:
        assert chip.config[3].output_value is Value.INACTIVE
        assert not chip.config[3].active_low
        output.write(True)
        assert output.read_back() is True
    assert chip.log == [Value.ACTIVE, Value.INACTIVE, "released"]


def test_active_low_is_left_to_the_kernel(chip: Chip) -> None:
    with open_output(f"{CHIP}?line=relay&active=low", CLOCK):
        assert chip.config["relay"].active_low


def test_a_line_that_does_not_follow_is_lost(chip: Chip) -> None:
    with open_output(f"{CHIP}?line=3", CLOCK) as output:
        chip.stuck = True
        with pytest.raises(DeviceLost, match="the line did not follow, it stays inactive"):
            output.write(True)


def test_the_contact_wired_back_is_what_counts(chip: Chip) -> None:
    with open_output(f"{CHIP}?line=3&sense=4&sense_active=low", CLOCK) as output:
        assert chip.config[4].active_low
        with pytest.raises(DeviceLost, match="the contact did not follow, it stays inactive"):
            output.write(True)
        chip.sensed = Value.ACTIVE
        output.write(True)
        with pytest.raises(DeviceLost, match="the contact did not follow, it stays active"):
            output.write(False)


def test_an_unplugged_chip_is_lost_and_can_be_left(chip: Chip) -> None:
    with open_output(f"{CHIP}?line=3", CLOCK) as output:
        chip.gone = True
        with pytest.raises(DeviceLost, match="failed"):
            output.write(True)
    assert chip.log == ["released"]


def test_a_heartbeat_alternates_while_writes_come(chip: Chip) -> None:
    with open_output(f"{CHIP}?line=3&heartbeat=5", CLOCK) as output:
        for _ in range(6):
            output.write(True)
            CLOCK.sleep_until(CLOCK.now_ns() + 100_000_000)
        output.write(False)
    assert chip.log[:-2] == [Value.ACTIVE, Value.INACTIVE] * 3 + [Value.INACTIVE]


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError(errno.EBUSY, ""), "in use by another program"),
        (OSError(errno.EACCES, ""), "no permission"),
        (OSError(errno.ENOENT, ""), "no such line"),
        (ValueError("9"), "no such line"),
        (OSError(errno.EIO, "Input/output error"), "failed"),
    ],
)
def test_refusals_say_what_to_do(chip: Chip, monkeypatch: pytest.MonkeyPatch, error: Exception, words: str) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(gpiod, "request_lines", refuse)
    with pytest.raises(DeviceLost, match=words) as refusal:
        open_output(f"{CHIP}?line=9", CLOCK)
    assert refusal.value.remedy
    assert "line 9" in refusal.value.where


def test_an_absent_chip_is_lost() -> None:
    with pytest.raises(DeviceLost, match="no such GPIO chip"):
        open_output("gpio:/dev/no-such-chip?line=1", CLOCK)


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("", "names no line"),
        ("?line=1&level=low", "unknown option 'level'"),
        ("?line=1&active=down", "active=down is not known"),
        ("?line=1&sense=1", "the same line"),
        ("?line=1&heartbeat=9", "heartbeat=9 is not a rate"),
    ],
)
def test_a_url_that_can_never_work_is_refused(query: str, words: str) -> None:
    opener: Callable[[], object] = lambda: open_output(f"gpio:/dev/gpiochip0{query}", CLOCK)  # noqa: E731
    with pytest.raises(ConfigurationError, match=words):
        opener()
