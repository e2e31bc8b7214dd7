"""`probewatch pause`: silence for a while."""

from pathlib import Path

import click

from appliance.service.control.client import ControlClient
from tools.shared.named_cart import socket_option


@click.command()
@click.argument("seconds", type=click.FloatRange(1, 120), default=120)
@click.option("--off", "reason", metavar="REASON", help="switch the sound off until --on; it reminds once a minute")
@click.option("--on", is_flag=True, help="let it sound again")
@socket_option
def command(control_socket: Path, seconds: float, reason: str | None, on: bool) -> None:
    """Pause the alarm sound for SECONDS, 120 at most. Lamps and the contact stay as they are.

    \b
    Examples:
      probewatch pause            two minutes of silence
      probewatch pause 30
      probewatch pause --off "service visit, room empty"
      probewatch pause --on
    """
    if on and reason is not None:
        raise click.UsageError("--on and --off exclude each other")
    with ControlClient(control_socket) as client:
        if on:
            client.audio_on()
            click.echo("the alarm may sound again")
        elif reason is not None:
            client.audio_off(reason)
            click.echo("the alarm is silent until 'probewatch pause --on'; it reminds once a minute")
        else:
            client.pause_audio(seconds)
            click.echo(f"the alarm is silent for {seconds:g} s")
