"""`probewatch reload`: a running service takes its changed configuration, or says why not."""

from pathlib import Path

import click

from appliance.config import load_config
from appliance.service.control_client import ControlClient


@click.command("reload")
@click.option(
    "--config",
    "config_file",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="the configuration that the service runs with",
)
def command(config_file: Path) -> None:
    """Let the running service take limits, times and language of its changed configuration.

    `systemctl reload probewatch` runs this. A file with a mistake, or one that changes devices, calibration or log,
    changes nothing; the service watches on with what it has.

    \b
    Exit code 0: taken. 69: no service answers. 75: only a restart can take the change. 78: the file has mistakes.
    """
    config = load_config(config_file)
    with ControlClient(config.control.socket) as client:
        client.reload()
    click.echo(f"the service watches with {config_file} as it is now")
