"""`probewatch simulate cart`: scanner, tracker and relay board together, for a service that is started beside them."""

import signal
import tempfile
import threading
import tomllib
from pathlib import Path

import click

from drivers.errors import ConfigurationError
from drivers.files.atomic_file import check_new, check_replaceable, replacing
from drivers.twins.faults import PICTURE_FAULTS
from drivers.twins.ndi.tracker import NDI_FAULTS
from tools.shared.configuration_text import Answers, changed, template
from tools.simulators.whole_cart import CartSettings, SimulatedDevices

_BEGINS = "# SIMULATED devices of `probewatch simulate cart`"
_LOOK_S = 0.5
"""Between two looks whether every part still runs; how late an end is told."""


@click.command("cart")
@click.option("--write", "file", type=click.Path(dir_okay=False, path_type=Path), help="write the configuration here")
@click.option(
    "--folder", type=click.Path(file_okay=False, path_type=Path), help="of sockets, alarm log and control files"
)
@click.option("--seed", default=1, show_default=True, type=click.IntRange(0), help="of tissue, motion and noise")
@click.option(
    "--unconfigured",
    is_flag=True,
    help="with --write: a cart that nobody has configured yet, and the URLs of its devices",
)
@click.option("--openigtlink", "served", is_flag=True, help="an OpenIGTLink server, as PLUS, hands on both")
def command(file: Path | None, folder: Path | None, seed: int, unconfigured: bool, served: bool) -> None:
    """Simulate a whole cart until Ctrl-C: a scanner, an NDI Polaris and a relay board, each a process of its own.

    Prints the configuration that fits them as soon as they are ready, or writes it with --write. The service is yours
    to start beside it; after some ten seconds of simulated motion it reaches MONITORING.

    \b
      probewatch simulate cart --write cart.toml
      probewatch run --config cart.toml             # in a second terminal
      probewatch status --watch --socket …          # in a third; the socket is named in cart.toml

    With --unconfigured the file is the one that a package brings, for `probewatch configure`: docs/first-day.md.

    Faults are written into two files, which the configuration names with every fault they know. Three hide what the
    probe does and have no alarm of their own: sparse-poses, the tracker sees the probe in one measurement of twelve;
    flicker-blank, every second picture is black; future-stamp, one picture is stamped a minute ahead.

    What is configured is simulated: never use it on a real cart. Without --folder everything lies in a temporary folder
    that is removed at the end, the alarm log too.
    """
    if unconfigured:
        check_new(file)
    else:
        check_replaceable(file, _BEGINS.encode())
    if unconfigured and file is None:
        raise click.UsageError("--unconfigured writes a file: give --write FILE")
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: stop.set())
    with tempfile.TemporaryDirectory(prefix="probewatch-", ignore_cleanup_errors=True) as temporary:
        place = Path(temporary) if folder is None else _made(folder)

        def pause(seconds: float) -> None:
            if stop.wait(seconds):
                raise click.Abort

        with SimulatedDevices(place, CartSettings(seed, served=served), pause) as cart:
            if unconfigured and file is not None:
                _hand_out(_unconfigured(cart), file)
                click.echo(_commands(cart, file), err=True)
            else:
                _hand_out(_head(cart) + cart.config_text, file)
            while not stop.wait(_LOOK_S):
                cart.require_alive()


def _made(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"cannot be made ({error.strerror})", str(folder), "Choose another folder") from None
    return folder.resolve()


def _head(cart: SimulatedDevices) -> str:
    return (
        f"{_BEGINS}, for as long as it runs. Never for a real cart.\n"
        f"# probewatch status --watch --socket {cart.socket}\n"
        '# Faults: write a JSON list such as ["flip-lateral"] into these files; [] ends them.\n'
        f"# {cart.folder}/scanner.json: {', '.join(PICTURE_FAULTS)}\n"
        f"# {cart.folder}/polaris.json: {', '.join(NDI_FAULTS)}\n"
        f"# While {cart.tank} exists, the probe is tilted over a cross-wire in water: touch it, scan, remove it.\n"
    )


def _unconfigured(cart: SimulatedDevices) -> str:
    """The template with the places of this cart, so that two carts do not meet; devices are for a person to name."""
    said = tomllib.loads(cart.config_text)
    places: Answers = {("control", "socket"): said["control"]["socket"], ("alarm", "folder"): said["alarm"]["folder"]}
    return changed(template(), places, cart.config)


def _commands(cart: SimulatedDevices, file: Path) -> str:
    """What is connected, for a person who configures it."""
    said = tomllib.loads(cart.config_text)
    urls = {"video": said["video"]["url"], "tracker": said["tracker"]["url"], "contact": said["output"][0]["url"]}
    lines = [f"{name}: {url}" for name, url in urls.items()] + [f"socket: {cart.socket}"]
    tank = f"While {cart.tank} exists, the probe is over a cross-wire in water"
    return "\n".join([f"then: probewatch configure {file}", *lines, tank])


def _hand_out(text: str, file: Path | None) -> None:
    if file is None:
        click.echo(text, nl=False)
        return
    try:
        with replacing(file) as stream:
            stream.write(text.encode())
    except OSError as error:
        raise ConfigurationError(f"cannot be written ({error.strerror})", str(file), "Choose another file") from None
    click.echo(f"ready; now run: probewatch run --config {file}", err=True)
