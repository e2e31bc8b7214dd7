"""`probewatch pause`: pauses the alarm sound."""

import re
from pathlib import Path

import click

from appliance.service.control.client import ControlClient
from appliance.supervision.annunciator import Role
from appliance.supervision.audio import AudioMode
from tools.shared.named_cart import socket_option

_SHORTEST_S, _LONGEST_S = 1, 120
"""What the service grants (docs/alarms.md): a longer pause would be forgotten."""
_UNITS_S = {"": 1, "s": 1, "m": 60, "min": 60}
"""Seconds of each unit that may be typed; none is seconds."""
_TIME = re.compile(r"(\d+(?:\.\d*)?) ?([a-z]*)")


def _seconds(_: click.Context, __: click.Parameter, typed: str) -> float:
    """Returns the time in s, which may be typed with its unit. Raises click.BadParameter."""
    found = _TIME.fullmatch(typed.strip().lower())
    seconds = float(found[1]) * _UNITS_S.get(found[2], 0) if found else 0.0
    if not _SHORTEST_S <= seconds <= _LONGEST_S:
        taken = f"{_SHORTEST_S} to {_LONGEST_S} seconds, such as 30 or 1m"
        raise click.BadParameter(f"'{typed}' is no time for a pause: {taken}. Longer: --off REASON")
    return seconds


@click.command()
@click.argument("seconds", callback=_seconds, default=str(_LONGEST_S))
@click.option("--off", "reason", metavar="REASON", help="switch the sound off until --on; it reminds once a minute")
@click.option("--on", is_flag=True, help="switch the sound on again")
@socket_option
def command(control_socket: Path, seconds: float, reason: str | None, on: bool) -> None:
    """Pause the alarm sound for SECONDS, 120 at most. Lamps and the contact stay as they are.

    \b
    Examples:
      probewatch pause            two minutes of silence
      probewatch pause 30         half a minute; 1m is a whole one
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
            click.echo(f"{_paused(client, seconds)}{_without_tone(client)}")


def _paused(client: ControlClient, seconds: float) -> str:
    """Returns for how long the alarm is silent: a pause ends no audio-off."""
    if client.status()["audio"]["mode"] == AudioMode.OFF.value:
        return "the alarm sound is switched off already, and stays so until 'probewatch pause --on'"
    return f"the alarm is silent for {seconds:g} s"


def _without_tone(client: ControlClient) -> str:
    """Returns a remark for a cart without a tone output; else an empty text."""
    signals = {output["signal"] for output in client.status()["outputs"]}
    return "" if Role.TONE.value in signals else "; this cart has no tone output"
