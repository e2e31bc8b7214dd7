"""Every command in a page is understood by the program that it names, and is run by a test or marked as not."""

import re
import shlex
import tomllib
from pathlib import Path

import click
import pytest

from probewatch.tools.cli import probewatch

ROOT = Path(__file__).parents[2]
PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")))
LISTED = tomllib.loads((ROOT / "tests" / "rules" / "page-commands.toml").read_text(encoding="utf-8"))
_PROGRAMS = "probewatch|make|sudo|apt|pip|systemctl|ssh-keygen|python|while|touch|curl"
_COMMAND = re.compile(rf"^(?:\d+\. |\$ )?((?:{_PROGRAMS}) .*)$")
_SPAN = re.compile(r"(?<!`)`(?:sudo )?((?:probewatch|make) [^`]+)`")
_STANDS_FOR = re.compile(r"[…\[\]|(]")
"""Of what a page says of a command's form and not as a command."""


def in_blocks(page: Path) -> list[str]:
    """Commands of the page's blocks, without prompt and comment."""
    found, inside = [], False
    for line in page.read_text(encoding="utf-8").replace("\\\n", " ").splitlines():
        if re.match(r"\s*(?:\d+\. )?```", line):
            inside = not inside
        elif inside and (said := _COMMAND.match(line.strip())):
            found.append(" ".join(re.split(r"\s+#\s", said[1])[0].split()))
    return found


def in_text(page: Path) -> list[str]:
    """Commands within sentences."""
    found = (" ".join(one.split()) for one in _SPAN.findall(page.read_text(encoding="utf-8")))
    return [one for one in found if not _STANDS_FOR.search(one)]


def calls(command: str) -> list[str]:
    """Of the two programs, what a line calls of them."""
    return re.findall(r"(?:probewatch|make) [^;]*", command)


def refused(call: str) -> str:
    """Why the program does not understand this; empty where it does. Values are not looked at."""
    program, *words = shlex.split(call)
    if program == "make":
        targets = re.findall(r"^([a-z0-9-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M)
        unknown = [word for word in words if "=" not in word and word not in targets]
        return f"no target {unknown}" if unknown else ""
    command: click.Command = probewatch
    with click.Context(probewatch, info_name="probewatch") as context:
        while isinstance(command, click.Group) and words and not words[0].startswith("-"):
            name, *words = words
            inner = command.get_command(context, name)
            if inner is None:
                return f"no command {name}"
            command = inner
        try:
            command.make_parser(click.Context(command, info_name=program)).parse_args(words)
        except click.UsageError as error:
            return error.format_message()
    return ""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_is_understood(page: Path) -> None:
    said = [*in_blocks(page), *in_text(page)]
    wrong = {call: why for one in said for call in calls(one) if (why := refused(call))}
    assert not wrong


def test_a_command_that_is_none_is_seen() -> None:
    assert refused("make supper")
    assert refused("probewatch dine")
    assert refused("probewatch status --wacth")
    assert refused("probewatch calibration lend")
    assert not refused("probewatch calibration list")


def test_every_command_of_a_block_is_run_by_a_test_or_marked_as_not() -> None:
    said = {one for page in PAGES for one in in_blocks(page)}
    run, without = LISTED["run"], LISTED["not"]
    assert not run.keys() & without.keys()
    assert said == run.keys() | without.keys()


@pytest.mark.parametrize(("command", "test"), LISTED["run"].items())
def test_the_test_that_is_named_calls_the_command(command: str, test: str) -> None:
    text = (ROOT / test).read_text(encoding="utf-8")
    for call in calls(command):
        program, name, *_ = call.split()
        assert program == "make" or re.search(rf"\b{re.escape(name)}\b", text), f"{test} does not call {name}"
