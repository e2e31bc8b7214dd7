"""Reports as JSON: on standard output, where text then goes to the other one, or as a file, whole or not at all."""

import contextlib
import json
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import click

from drivers.files.atomic_file import writing

STDOUT = Path("-")
_Command = TypeVar("_Command", bound=Callable[..., Any])


def json_option(command: _Command) -> _Command:
    """Adds --json [FILE], whose value comes as json_path: STDOUT without a file, as --json is of every command."""
    option = click.option(
        "--json",
        "json_path",
        is_flag=False,
        flag_value=str(STDOUT),
        metavar="[FILE]",
        type=click.Path(path_type=Path, allow_dash=True),
        callback=_no_recording,
        help="write the report there too; without FILE, or with -, print it, and the text on standard error",
    )
    return option(command)


_RECORDINGS = (".mha", ".mhd", ".nrrd", ".mcap", ".mp4", ".avi", ".mkv", ".webm", ".mov")
"""Suffixes of recordings, which a report must not be written over."""


def _no_recording(_: click.Context, __: click.Parameter, value: Path | None) -> Path | None:
    """What stands behind a --json without a file may be what is to be read, and must not be written over."""
    if value is not None and value.suffix.lower() in _RECORDINGS:
        raise click.BadParameter(f"'{value}' is no name of a report; put --json last, or write --json -")
    return value


@contextlib.contextmanager
def text_aside(json_path: Path | None) -> Iterator[Callable[[Mapping[str, object]], None]]:
    """Gives what writes the report. Meanwhile text goes to standard error where the report goes to standard output."""
    stdout = sys.stdout

    def write(report: Mapping[str, object]) -> None:
        if json_path == STDOUT:
            click.echo(json.dumps(report, indent=2, allow_nan=False), file=stdout)
        elif json_path is not None:
            write_json(json_path, report)

    with contextlib.redirect_stdout(sys.stderr if json_path == STDOUT else stdout):
        yield write


def file_of(json_path: Path | None) -> Path | None:
    """None where it goes to standard output."""
    return None if json_path == STDOUT else json_path


def write_json(path: Path, report: Mapping[str, object]) -> None:
    """Replace the file at path. Raises ConfigurationError, ValueError for a number that is not finite."""
    with writing(path) as stream:
        stream.write(json.dumps(report, indent=2, allow_nan=False).encode() + b"\n")
