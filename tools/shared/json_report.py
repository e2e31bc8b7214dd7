"""Provides the --json option, the same in every command: it prints JSON on standard output and nothing else there."""

import contextlib
import json
import sys
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import click

_Command = TypeVar("_Command", bound=Callable[..., Any])


def json_option(command: _Command) -> _Command:
    """Adds the switch --json, passed as as_json."""
    told = "print JSON and nothing else, null for what is not known; text goes to standard error"
    return click.option("--json", "as_json", is_flag=True, help=told)(command)


@contextlib.contextmanager
def text_aside(as_json: bool) -> Iterator[Callable[[object], None]]:
    """Yields a function that prints the JSON where it was requested; all other output then goes to standard error."""
    stdout = sys.stdout

    def write(report: object) -> None:
        if as_json:
            click.echo(json_of(report), file=stdout)

    with contextlib.redirect_stdout(sys.stderr if as_json else stdout):
        yield write


def json_of(report: object, indent: int | None = 2) -> str:
    """Returns ASCII JSON, independent of the locale. Raises ValueError for a number that is not finite."""
    return json.dumps(report, indent=indent, allow_nan=False)
