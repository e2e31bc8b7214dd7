"""`probewatch status`: shows what the service sees now."""

import contextlib
import sys
import time
from pathlib import Path

import click
from rich.console import Console
from rich.live import Live

from probewatch.appliance.service.control.client import ControlClient
from probewatch.tools.shared.json_report import json_of, json_option
from probewatch.tools.shared.named_cart import socket_option
from probewatch.tools.shared.status_view import Status, StatusView, one_line

_EVERY_S = 0.25
"""Seconds between two pictures of `--watch`, which is seen as motion; less would only take time from the ticks."""
_LINE_EVERY_S = 1.0
"""Seconds between two lines of `--watch` into a pipe: the pace of a reader, and 20 ticks of the service."""
_EXIT = {"OK": 0, "NOT_VERIFIED": 3, "FAULT": 1}
"""Exit code for each verdict; 2 is that of a wrong command line."""


@click.command()
@socket_option
@click.option("--watch", is_flag=True, help="redraw four times a second until Ctrl-C; into a pipe, a line a second")
@json_option
def command(control_socket: Path, watch: bool, as_json: bool) -> None:
    """What the service sees now: state, age of the last verification, every check with its share of the limit.

    A bar that reaches its end has reached the limit; the cells beside it are the last eight seconds.
    The JSON is that of docs/control.md; with --watch it is one a line.

    \b
    Examples:
      probewatch status
      probewatch status --watch
      probewatch status --config cart.toml --json

    \b
    Exit code 0: verified, the contact is closed. 1: alarm. 3: not verified. 69: no service answers.
    78: the service is not configured, or cannot use its configuration.
    """
    with ControlClient(control_socket) as client:
        if watch:
            with contextlib.suppress(KeyboardInterrupt):
                _watch(client, as_json)
            return
        status = client.status()
    if as_json:
        click.echo(json_of(status))
    else:
        Console(file=sys.stdout, highlight=False).print(StatusView().picture(status))
    sys.exit(_EXIT[_verdict(status)])


def _verdict(status: Status) -> str:
    if status["energised"]:
        return "OK"
    return "NOT_VERIFIED" if status["priority"] == "low" else "FAULT"


def _watch(client: ControlClient, as_json: bool) -> None:
    """Redraws the status until the service ends."""
    if as_json or not sys.stdout.isatty():
        while True:
            status = client.status()
            click.echo(json_of(status, None) if as_json else one_line(status))
            time.sleep(_LINE_EVERY_S)
    view = StatusView()
    with Live(refresh_per_second=1 / _EVERY_S, screen=True) as live:
        while True:
            live.update(view.picture(client.status()))
            time.sleep(_EVERY_S)
