"""Options that come in several commands are one kind: words are listed, and --json is the same switch everywhere."""

from collections.abc import Iterable

import click
import pytest

from probewatch.drivers.twins.faults import CART_FAULTS
from probewatch.drivers.twins.scene.trajectory import PROGRAMS
from probewatch.drivers.video.crop import FLIPS
from tests.support.answers import answered
from tests.support.commands import commands

WORDS = {"--inject": CART_FAULTS, "--orientation": FLIPS, "--program": PROGRAMS}
"""Options of free text behind which stands a list; a choice of click's lists its words by itself."""


@pytest.mark.parametrize("name", WORDS)
def test_help_lists_the_words(name: str) -> None:
    found = [
        (path, one.help or "")
        for path, command in commands()
        for one in command.params
        if isinstance(one, click.Option) and name in one.opts and not isinstance(one.type, click.Choice)
    ]
    assert found
    for path, told in found:
        assert all(word in told for word in WORDS[name]), path


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["replay", "x.mha", "--inject"], CART_FAULTS),
        (["log", "--event"], ["overload-ended", "recalibration given up"]),
        (["report", "--period"], ["one of day, week, month"]),
        (["simulate", "ndi", "--model"], ["aurora", "vega"]),
        (["calibration", "import", "x.xml", "--probe"], ["LeftImageToProbe"]),
    ],
)
def test_an_option_without_a_value_says_what_it_takes(words: list[str], told: Iterable[str]) -> None:
    answer = answered(*words)
    assert answer.returncode == 2
    assert f"Option '{words[-1]}' requires an argument: " in answer.stderr
    assert [one for one in told if one not in answer.stderr] == []


def test_json_is_one_switch_in_every_command() -> None:
    found = {
        path: (one.is_flag, one.help)
        for path, command in commands()
        for one in command.params
        if isinstance(one, click.Option) and "--json" in one.opts
    }
    assert len(found) > 6
    assert {is_flag for is_flag, _ in found.values()} == {True}
    assert len({told for _, told in found.values()}) == 1, found


def test_no_help_shows_format_codes() -> None:
    """`log --since` and `report --of` showed those of strptime."""
    told = {" ".join(path): command.get_help(click.Context(command)) for path, command in commands()}
    assert [path for path, text in told.items() if "%Y" in text] == []
    assert "--of YYYY-MM-DD" in told["report"]


def test_every_command_shows_how_it_is_called() -> None:
    """By its own help, or by that of the group it stands in."""
    helps = {path: f"{command.help} {command.epilog}" for path, command in commands()}
    shown = {path: f"{text} {helps.get(path[:-1], '')}" for path, text in helps.items()}
    without = {path for path, text in shown.items() if path and f"probewatch {' '.join(path)}" not in text}
    assert without <= {("simulate",)}, "its devices have examples of their own"
