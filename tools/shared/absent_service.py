"""Reports at the start of a command that runs beside the service that no service answers yet."""

from pathlib import Path

import click

from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.service.control.starting import NoService
from probewatch.drivers.errors import ProbewatchError
from probewatch.tools.shared.named_cart import start_of

_ANSWER_S = 1.0
"""Seconds for the service to answer: twenty ticks. Longer only delays the start of the command."""


def warn_if_absent(control: Path) -> None:
    """Prints on stderr why no service answers at its control socket. The command goes on and waits for one."""
    try:
        with ControlClient(control, _ANSWER_S) as client:
            client.status()
    except NoService as error:
        click.echo(
            f"{error.where}: {error.what}. {start_of(control)}. Until it answers, this program runs without it",
            err=True,
        )
    except ProbewatchError as error:
        click.echo(f"{error}. Until it answers, this program runs without it", err=True)
