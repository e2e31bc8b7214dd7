"""`probewatch lamp-test`: tests lamps and tone."""

from pathlib import Path

import click

from appliance.service.control.client import ControlClient
from tools.shared.named_cart import socket_option


@click.command()
@socket_option
def command(control_socket: Path) -> None:
    """Light every lamp and sound the tone for five seconds. The contact stays as it is.

    \b
    Example:
      probewatch lamp-test
    """
    with ControlClient(control_socket) as client:
        client.test_lamps()
        outputs = client.status()["outputs"]
    shown = [output for output in outputs if output["signal"] != "contact"]
    if not shown:
        click.echo("this service has no lamp and no tone, only the contact; see [[output]] in its configuration")
        return
    click.echo("for five seconds these must light up or sound:")
    for output in shown:
        click.echo(f"  {output['signal']:8} {output['url']}")
