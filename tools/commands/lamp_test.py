"""`probewatch lamp-test`: tests lamps and tone."""

from pathlib import Path

import click

from probewatch.appliance.service.control.client import ControlClient
from probewatch.tools.german.translation import told
from probewatch.tools.shared.named_cart import socket_option
from probewatch.tools.shared.spoken import language_of, say


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
        status = client.status()
    outputs, language = status["outputs"], language_of(status)
    shown = [output for output in outputs if output["signal"] != "contact"]
    if not shown:
        click.echo(say("no lamps", language))
        return
    click.echo(say("lamps", language))
    for output in shown:
        lost = f"  {told('does not answer', language)}" if output["energised"] is None else ""
        click.echo(f"  {output['signal']:8} {output['url']}{lost}")
