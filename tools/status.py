"""`probewatch status`: what the service sees now."""

import json
import sys
import time
from pathlib import Path

import click
from rich.console import Console
from rich.live import Live

from appliance.service.control_client import ControlClient
from tools.service_socket import socket_option
from tools.status_view import Status, StatusView

_EVERY_S = 0.25
_EXIT = {"OK": 0, "NOT_VERIFIED": 3, "FAULT": 1}


@click.command(short_help="what the service sees now; --watch keeps it on the screen")
@socket_option
@click.option("--watch", is_flag=True, help="redraw four times a second until Ctrl-C")
@click.option("--json", "as_json", is_flag=True, help="print the status as JSON, as docs/control.md describes it")
def command(control_socket: Path, watch: bool, as_json: bool) -> None:
    """What the service sees now: state, age of the last verification, every check with its share of the limit.

    A bar that reaches its end has reached the limit; the cells beside it are the last eight seconds.

    \b
    Exit code 0: verified, the contact is closed. 1: alarm. 3: not verified. 69: no service answers.
    78: the service is not configured, or cannot use its configuration.
    """
    if watch:
        _watch(control_socket)
        return
    with ControlClient(control_socket) as client:
        status = client.status()
    if as_json:
        click.echo(json.dumps(status, ensure_ascii=False, indent=2))
    else:
        Console(file=sys.stdout, highlight=False).print(StatusView().picture(status))
    sys.exit(_EXIT[_verdict(status)])


def _verdict(status: Status) -> str:
    if status["energised"]:
        return "OK"
    return "NOT_VERIFIED" if status["priority"] == "low" else "FAULT"


def _watch(control_socket: Path) -> None:
    view = StatusView()
    with (
        Live(refresh_per_second=1 / _EVERY_S, screen=sys.stdout.isatty()) as live,
        ControlClient(control_socket) as client,
    ):
        try:
            while True:
                live.update(view.picture(client.status()))
                time.sleep(_EVERY_S)
        except KeyboardInterrupt:
            return
