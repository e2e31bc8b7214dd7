"""`probewatch ack`: acknowledges the alarm."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.supervision.alarms import ACKNOWLEDGED, NOT_NOW, Priority
from probewatch.appliance.supervision.audio import AudioMode
from probewatch.appliance.supervision.languages import translated, translated_text
from probewatch.tools.shared.named_cart import socket_option
from probewatch.tools.shared.spoken import language_of, say, say_change


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
            click.echo(say("bump", language_of(client.status())))
            return
        acknowledged = _acknowledged(client)
        status = client.status()
        language = language_of(status)
        click.echo(f"{translated('acknowledged', language)} · {say_change(acknowledged, language)}")
        now = f"{status['state']}: {status['reason']}"
        click.echo(f"{say('now', language)} · {say_change(now, language)}")
        if status["latched"] is not None and not status["acknowledged"]:
            click.echo(say("another", language))
        elif status["latched"] is not None:
            click.echo(say("ends dated" if _has_expired(status) else "ends", language))


def _has_expired(status: Mapping[str, Any]) -> bool:
    """Returns whether no motion will verify the calibration, because its date has passed."""
    return bool(status.get("reference_overdue")) and status.get("reference_waits") == status["reference_overdue"]


def _sounds(status: Mapping[str, Any]) -> bool:
    """Returns whether an alarm sounds, so that a person may want it silent until its cause is mended."""
    sounds = status["priority"] in (Priority.HIGH.value, Priority.MEDIUM.value)
    return sounds and status["audio"]["mode"] == AudioMode.ON.value


def _acknowledged(client: ControlClient) -> str:
    """Returns what was acknowledged. Raises ControlRefused."""
    try:
        return client.acknowledge()
    except ControlRefused as error:
        if error.what.startswith(NOT_NOW):
            status = client.status()
            language = language_of(status)
            state = translated_text(error.what.removeprefix(NOT_NOW).strip(), language)
            what = f"{say('nothing', language)}: {say('not now', language)} {state}"
            raise ControlRefused(what, remedy=say("silence", language) if _sounds(status) else "") from None
        if error.what == ACKNOWLEDGED:
            raise ControlRefused(say("already", language_of(client.status()))) from None
        raise
