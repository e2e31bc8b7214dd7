"""Provides the options that state what the file of a recording does not."""

from collections.abc import Callable
from typing import Any, TypeVar

import click

_Command = TypeVar("_Command", bound=Callable[..., Any])


def recording_options(of: str = "") -> Callable[[_Command], _Command]:
    """Adds --probe, --reference and --orientation. of: the files to which they apply, for the help of a command that
    takes others too.
    """
    prefix = f"of {of}: " if of else ""
    options = (
        click.option("--probe", help=f"{prefix}tool on the probe, as the transforms name it [Probe]"),
        click.option("--reference", help=f"{prefix}reference tool; Tracker for none [Reference, where recorded]"),
        click.option(
            "--orientation",
            help=f"{prefix}orientation of stored pictures, where the file does not state it: MF, MN, UF or UN",
        ),
    )

    def add(command: _Command) -> _Command:
        for option in reversed(options):
            command = option(command)
        return command

    return add
