"""`probewatch ack`: acknowledges the alarm."""

from pathlib import Path

import click

from appliance.service.control.client import ControlClient
from appliance.service.control.server import ControlRefused
from appliance.supervision.alarms import ACKNOWLEDGED, NOT_NOW
from tools.shared.named_cart import socket_option


@click.command()
@socket_option
@click.option("--bump", is_flag=True, help="record instead that the tracker's position sensor was checked after a bump")
def command(control_socket: Path, bump: bool) -> None:
    """Acknowledge the alarm: it falls silent now.

    HALT and RECALIBRATION REQUESTED end once it is acknowledged AND the calibration has been verified again, in either
    order. A fault that comes again, or another one, sounds again. Who acknowledged what is in the alarm log.

    \b
    Example:
      probewatch ack

    \b
    Exit code 0: done. 69: no service answers. 75: there is nothing to acknowledge.
    """
    with ControlClient(control_socket) as client:
        if bump:
            client.clear_bump()
            click.echo(
                "recorded: the tracker's position sensor was checked; an alert of a bump, if there was one, ends"
            )
            return
        click.echo(f"acknowledged · {_acknowledged(client)}")
        status = client.status()
        click.echo(f"now · {status['state']}: {status['reason']}")
        if status["latched"] is not None and not status["acknowledged"]:
            click.echo("this is another alarm; it has not been acknowledged yet")
        elif status["latched"] is not None:
            click.echo("it ends once the calibration is verified again: move the probe over tissue, or recalibrate")


def _acknowledged(client: ControlClient) -> str:
    """Returns what was acknowledged. Raises ControlRefused."""
    try:
        return client.acknowledge()
    except ControlRefused as error:
        if error.what.startswith(NOT_NOW):
            raise ControlRefused(f"there is nothing to acknowledge: {error.what}") from None
        if error.what == ACKNOWLEDGED:
            raise ControlRefused(f"already {ACKNOWLEDGED}") from None
        raise
