"""`probewatch pause`: pauses the alarm sound."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.supervision.annunciator import Role
from probewatch.appliance.supervision.audio import AudioMode
from probewatch.tools.shared.named_cart import socket_option
from probewatch.tools.shared.spoken import language_of, say

_SHORTEST_S, _LONGEST_S = 1, 120
"""Bounds of a pause that the service grants (docs/alarms.md): a longer one would be forgotten."""
_UNITS_S = {"": 1, "s": 1, "m": 60, "min": 60}
"""Length in seconds of each unit that may be typed; without a unit the number is in seconds."""
_TIME = re.compile(r"(\d+(?:\.\d*)?) ?([a-z]*)")


def _seconds(_: click.Context, __: click.Parameter, typed: str) -> float:
    """Returns the time in s, which may be typed with a unit. Raises click.BadParameter."""
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
    if (on or reason is not None) and _is_typed("seconds"):
        raise click.UsageError(f"SECONDS has no effect with {'--on' if on else '--off'}; leave it out")
    with ControlClient(control_socket) as client:
        if on:
            client.audio_on()
        elif reason is not None:
            client.audio_off(reason)
        else:
            client.pause_audio(seconds)
        status = client.status()
    language = language_of(status)
    if on:
        told = say("sound on", language)
    elif reason is not None:
        told = say("sound off", language)
    else:
        told = _paused(status, seconds)
    click.echo(f"{told}{_without_tone(status)}")


def _is_typed(name: str) -> bool:
    """Returns whether the argument of the command was typed."""
    return click.get_current_context().get_parameter_source(name) is ParameterSource.COMMANDLINE


def _paused(status: Mapping[str, Any], seconds: float) -> str:
    """Returns, as text, for how long the alarm is silent: a pause does not end an audio-off."""
    if status["audio"]["mode"] == AudioMode.OFF.value:
        return say("stays off", language_of(status))
    return say("silent", language_of(status), seconds=f"{seconds:g}")


def _without_tone(status: Mapping[str, Any]) -> str:
    """Returns a remark for a cart without a tone output; else an empty text."""
    signals = {output["signal"] for output in status["outputs"]}
    return "" if Role.TONE.value in signals else f"; {say('no tone', language_of(status))}"
