"""`probewatch record`: writes black boxes of what the service sees, and marks what is to be kept."""

import signal
import threading
from pathlib import Path

import click

from appliance.configuration.config import load_config
from drivers.errors import ConfigurationError
from tools.recorder.run import RecorderService, ask
from tools.shared.named_cart import cart_option


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
    """
    config = load_config(config_file)
    if action is not None:
        _print(ask(config.recorder.socket, action, reason))
        return
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    try:
        with RecorderService(config) as service:
            click.echo(f"recording into {config.recorder.folder}", err=True)
            service.run(stop.is_set)
    except OSError as error:
        raise ConfigurationError(f"cannot be used ({error.strerror})", str(config.recorder.folder)) from None


def _print(fields: dict[str, object]) -> None:
    for name, value in fields.items():
        if name != "ok":
            click.echo(f"{name.replace('_', ' ')}: {value}")
