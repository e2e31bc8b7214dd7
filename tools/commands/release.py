"""`probewatch release`: de-energises every alarm output when the service has ended."""

import sys
from pathlib import Path

import click

from probewatch.appliance.configuration.config import load_config
from probewatch.appliance.service.control.client import ControlClient
from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError, DeviceLost, ProbewatchError
from probewatch.drivers.registry import open_output
from probewatch.tools.shared.named_cart import required_config

_ANSWER_S = 1.0
"""Seconds for a running service to accept the connection: twenty ticks. Longer only delays the end of the unit."""


@click.command("release")
@required_config("the configuration that lists the outputs")
def command(config_file: Path) -> None:
    """De-energise every alarm output of the configuration, for devices that hold their level without the service.

    The service's unit runs this after every end. A running service holds its outputs, so they are left to it.
    Exit code 69 when an output could not be reached.

    \b
    Example:
      probewatch release --config /etc/probewatch/probewatch.toml
    """
    config = load_config(config_file)
    unreached = [problem for output in config.output if (problem := _release(output.url))]
    served = bool(unreached) and _is_served(config.control.socket)
    if served:
        what = f"a service runs at {config.control.socket} and holds its outputs: it opens them itself when it ends"
        click.echo(f"probewatch: {what}", err=True)
    for problem in unreached:
        if served:
            problem.remedy = ""  # such as to close the program that holds it: that is the service
        click.echo(f"probewatch: {problem}", err=True)
    if unreached:
        sys.exit(DeviceLost.exit_code)


def _is_served(socket: Path) -> bool:
    try:
        ControlClient(socket, _ANSWER_S).close()
    except ProbewatchError:
        return False
    return True


def _release(url: str) -> ProbewatchError | None:
    """De-energises one output; returns the error, None on success."""
    try:
        with open_output(url, HostClock()) as output:
            output.write(False)
    except (DeviceLost, ConfigurationError) as error:
        return error
    return None
