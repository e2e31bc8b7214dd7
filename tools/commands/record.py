"""`probewatch record`: records what the service sees in black boxes, and marks what is kept."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from probewatch.appliance.configuration.config import load_config
from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.german.recorder import recorder_text
from probewatch.tools.recorder.run import RecorderService, ask
from probewatch.tools.shared.named_cart import cart_option
from probewatch.tools.shared.termination import termination
from probewatch.tools.shared.unit_sight import is_of_the_unit


@click.command()
@click.argument("action", required=False, type=click.Choice(["start", "stop", "status"]))
@cart_option
@click.option("--reason", default="", help="with start or stop: why, in a few words; kept with the stretch")
def command(action: str | None, config_file: Path, reason: str) -> None:
    """Record what the service sees into a bounded ring of black boxes, until Ctrl-C; the recorder's unit runs it.

    start and stop mark a stretch that the running recorder keeps, as it keeps the minutes around each alarm; status
    says how the recorder is doing. The stretch ends by itself after an hour.

    \b
      probewatch record                                  what the unit runs
      probewatch record start --reason "phantom, probe 3"
      probewatch record stop
      probewatch replay /var/lib/probewatch-recorder     what was recorded, judged again

    [recorder] of the configuration sets folder, bounds, and whether text on the picture is blackened; see
    docs/black-box.md. A recorder cannot affect the service: a full or broken disk is reported in the journal and by
    status, and nowhere else.

    Exit code 0: done. 69: no recorder answers. 75: there is no stretch to stop, or one is being kept already.
    """
    config = load_config(config_file)
    if action is not None:
        _print(ask(config.recorder.socket, action, reason, _start(config_file)), config.alarm.language)
        return
    stop = termination()
    try:
        with RecorderService(config) as service:
            click.echo(recorder_text(f"recording into {config.recorder.folder}", config.alarm.language), err=True)
            service.run(stop.is_set)
    except OSError as error:
        raise ConfigurationError(f"cannot be used ({error.strerror})", str(config.recorder.folder)) from None


def _start(config_file: Path) -> str:
    """Returns how the recorder of this cart is started; the unit's recorder serves only the unit's configuration."""
    if is_of_the_unit(config_file):
        return "systemctl start probewatch-recorder; journalctl -u probewatch-recorder says why it ended"
    return f"probewatch record --config {config_file}"


def _print(fields: dict[str, object], language: str) -> None:
    for name, said in told(fields):
        click.echo(f"{recorder_text(name, language):<17}{recorder_text(said, language)}")


def told(fields: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Returns the recorder's answer as (name, text) rows for people; empty for an answer without these fields."""
    if "session" not in fields:
        return []
    state = "recording" if fields["recording"] else "waits for the service"
    if fields["failing"]:
        state = f"NOT recording: {fields['failing']}"
    evicted = f", {fields['evicted_files']} older files gone" if fields["evicted_files"] else ""
    withheld = f"{fields['withheld_pictures']} pictures" if fields["withheld_pictures"] else "nothing"
    return [
        ("recorder", state),
        ("this stretch", "marked: it is kept" if fields["marked"] else "not marked"),
        ("ring", f"{_size(fields['ring_bytes'])} in {_files(fields['ring_files'])}{evicted}"),
        ("kept", f"{_size(fields['kept_bytes'])} in {_files(fields['kept_files'])}"),
        ("disk", f"{_size(fields['free_bytes'])} free"),
        ("lost", f"{fields['lost_samples']} samples" if fields["lost_samples"] else "nothing"),
        ("withheld", withheld),
        ("session", str(fields["session"])),
    ]


def _size(number: float) -> str:
    return f"{number / 1e9:.1f} GB" if number >= 1e9 else f"{number / 1e6:.1f} MB"


def _files(number: int) -> str:
    return f"{number} file{'' if number == 1 else 's'}"
