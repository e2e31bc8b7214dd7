"""Which service the operator's commands speak to."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

_Command = TypeVar("_Command", bound=Callable[..., Any])


def socket_option(command: _Command) -> _Command:
    """Adds --socket, whose value comes as control_socket."""
    option = click.option(
        "--socket",
        "control_socket",
        type=click.Path(path_type=Path),
        default=Path("/run/probewatch/control"),
        show_default=True,
        help="control socket of the service, [control] socket of its configuration",
    )
    return option(command)
