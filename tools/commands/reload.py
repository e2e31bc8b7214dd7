"""`probewatch reload`: makes the service read its changed configuration file."""

from pathlib import Path

import click

from probewatch.appliance.service.control.client import ControlClient
from probewatch.tools.german.translation import told
from probewatch.tools.shared.named_cart import cart_language, socket_option


@click.command()
@socket_option
def command(control_socket: Path) -> None:
    """Have the running service take its changed configuration file; `systemctl reload probewatch` does this.

    Limits, times and the language of the alarm texts change while it watches. A file that is invalid, or that changes
    devices, the calibration or paths, is refused whole, and the service goes on as before: those need
    `systemctl restart probewatch`.

    \b
    Example:
      probewatch reload

    \b
    Exit code 0: taken. 69: no service answers. 75: refused; stderr says why.
    78: the service is not configured, or cannot use its configuration.
    """
    with ControlClient(control_socket) as client:
        client.reload()
    click.echo(told("the service has taken its configuration", cart_language()))
