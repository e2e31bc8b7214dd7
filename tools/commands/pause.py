"""`probewatch pause`: pauses the alarm sound."""

from pathlib import Path

import click

from appliance.service.control.client import ControlClient
from appliance.supervision.annunciator import Role
from tools.shared.named_cart import socket_option


@click.command()
@click.argument("seconds", type=click.FloatRange(1, 120), default=120)
@click.option("--off", "reason", metavar="REASON", help="switch the sound off until --on; it reminds once a minute")
@click.option("--on", is_flag=True, help="switch the sound on again")
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
            click.echo(f"the alarm sound is on again{_without_tone(client)}")
        elif reason is not None:
            client.audio_off(reason)
            click.echo(
                f"the alarm is silent until 'probewatch pause --on'; it reminds once a minute{_without_tone(client)}"
            )
        else:
            client.pause_audio(seconds)
            click.echo(f"the alarm is silent for {seconds:g} s{_without_tone(client)}")


def _without_tone(client: ControlClient) -> str:
    """Returns a remark for a cart without a tone output; else an empty text."""
    signals = {output["signal"] for output in client.status()["outputs"]}
    return "" if Role.TONE.value in signals else "; this cart has no tone output"
