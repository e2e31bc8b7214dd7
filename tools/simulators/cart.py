"""Runs `probewatch simulate cart`: scanner, tracker and relay board together, for a service started beside them."""

import fcntl
import os
import signal
import tempfile
import tomllib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import check_kind, check_new, check_replaceable, replacing
from probewatch.drivers.twins.faults import PICTURE_FAULTS
from probewatch.drivers.twins.ndi.tracker import NDI_FAULTS
from probewatch.tools.shared.configuration_text import Answers, changed, template
from probewatch.tools.shared.termination import termination
from probewatch.tools.simulators.whole_cart import CartSettings, Event, SimulatedDevices

_BEGINS = "# SIMULATED devices of `probewatch simulate cart`"
_LOOK_S = 0.5
"""Seconds between two looks at whether every part runs, and what it reports: the delay with which either shows."""
_CLAIM = "simulated-cart"
"""File of the folder that holds the seed of the cart in it, and is locked while that cart runs."""


@click.command("cart")
@click.option(
    "--write", "file", type=click.Path(dir_okay=False, path_type=Path), help="write the configuration to this file"
)
@click.option(
    "--folder", type=click.Path(file_okay=False, path_type=Path), help="folder of sockets, alarm log and control files"
)
@click.option(
    "--seed", default=1, show_default=True, type=click.IntRange(0), help="random seed of tissue, motion and noise"
)
@click.option(
    "--unconfigured",
    is_flag=True,
    help="with --write: a cart not configured yet, and the URLs of its devices",
)
@click.option(
    "--openigtlink", "served", is_flag=True, help="serve pictures and poses through an OpenIGTLink server, as PLUS does"
)
def command(file: Path | None, folder: Path | None, seed: int, unconfigured: bool, served: bool) -> None:
    """Simulate a whole cart until Ctrl-C: a scanner, an NDI Polaris and a relay board, each a process of its own.

    Prints the configuration that fits them as soon as they are ready, or writes it with --write. The service is yours
    to start beside it; after some ten seconds of simulated motion it reaches MONITORING.

    \b
      probewatch simulate cart --write cart.toml
      probewatch run --config cart.toml             # in a second terminal
      probewatch status --watch --config cart.toml  # in a third

    With --unconfigured the file is the one that a package brings, for `probewatch configure`: docs/first-day.md.

    Faults are written into two files, which the configuration names with every fault they know; this command says what
    is shown then, or why a list is refused. Three hide what the
    probe does and have no alarm of their own: sparse-poses, the tracker sees the probe in one measurement of twelve;
    flicker-blank, every second picture is black; future-stamp, one picture is stamped a minute ahead.

    What is configured is simulated: never use it on a real cart. Without --folder everything lies in a temporary folder
    that is removed at the end, the alarm log too. With the --folder of an earlier cart that cart goes on, with its
    alarm log and its calibration; it takes the same --seed, and only one cart at a time.

    \b
    Exit code 0: ended by Ctrl-C. 69: a part of it died. 78: a file or folder cannot be used, or is in use.
    """
    check_kind(file, "a configuration, TOML", ".toml")
    if unconfigured:
        check_new(file)
    else:
        check_replaceable(file, _BEGINS.encode())
    if unconfigured and file is None:
        raise click.UsageError("--unconfigured writes a file: give --write FILE")
    stop = termination((signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
    with tempfile.TemporaryDirectory(prefix="probewatch-", ignore_cleanup_errors=True) as temporary:
        place = Path(temporary) if folder is None else _made(folder)

        def pause(seconds: float) -> None:
            if stop.wait(seconds):
                raise click.Abort

        with _claimed(place, seed), SimulatedDevices(place, CartSettings(seed, served=served), pause) as cart:
            if unconfigured and file is not None:
                _hand_out(_unconfigured(cart), file)
                click.echo(_commands(cart, file), err=True)
            else:
                _hand_out(_head(cart) + cart.config_text + _recorder(cart), file)
            heard = Counter[str]()
            while not stop.wait(_LOOK_S):
                cart.require_alive()
                for name, part in cart.twins.items():
                    events, heard[name] = part.said[heard[name] :], len(part.said)
                    for line in filter(None, map(_in_words, events)):
                        click.echo(f"{name}: {line}", err=True)


def _in_words(event: Event) -> str:
    """Returns what a device reports of its faults, in words; empty where it reports something else."""
    if event.get("refused"):
        return f"refused, and nothing changes: {event['refused']}"
    if "faults" in event:
        return f"shows {', '.join(event['faults']) or 'no fault'}"
    return ""


@contextmanager
def _claimed(folder: Path, seed: int) -> Iterator[None]:
    """Reserves the folder for one cart while it runs, and reports where the cart of an earlier start goes on.

    Raises ConfigurationError where another cart runs there, or where the calibration that is kept there is of another
    probe.
    """
    claim = folder / _CLAIM
    try:
        descriptor = os.open(claim, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise ConfigurationError(f"cannot be written ({error.strerror})", str(claim), "Choose another folder") from None
    with os.fdopen(descriptor, "r+") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            remedy = "Stop that one, or choose another folder"
            raise ConfigurationError("a simulated cart runs there already", str(folder), remedy) from None
        before = stream.read().strip()
        if before and before != str(seed):
            remedy = f"Continue it with --seed {before}, or choose another folder"
            what = f"holds the alarm log and the calibration of a cart of --seed {before}"
            raise ConfigurationError(what, str(folder), remedy)
        if before:
            click.echo(_goes_on(folder), err=True)
        stream.seek(0)
        stream.write(f"{seed}\n")
        stream.flush()
        yield


def _goes_on(folder: Path) -> str:
    """Returns what is left of the earlier cart and is in force again."""
    left = [name for name in ("scanner.json", "polaris.json", "server.json", "tank") if (folder / name).exists()]
    still = f"; still in force there: {', '.join(left)}" if left else ""
    return f"the cart in {folder} goes on, with its alarm log and its calibration{still}"


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


def _recorder(cart: SimulatedDevices) -> str:
    """Returns the places for `probewatch record` beside this cart, as not everybody may write to a real cart's."""
    return f'recorder.folder = "{cart.folder / "recorder"}"\nrecorder.socket = "{cart.folder / "record"}"\n'


def _unconfigured(cart: SimulatedDevices) -> str:
    """Returns the template with this cart's own places, so that two carts do not meet; a person names the devices."""
    said = tomllib.loads(cart.config_text + _recorder(cart))
    own = (("control", "socket"), ("alarm", "folder"), ("recorder", "folder"), ("recorder", "socket"))
    places: Answers = {(section, key): said[section][key] for section, key in own}
    return changed(template(), places, cart.config)


def _commands(cart: SimulatedDevices, file: Path) -> str:
    """Returns what is connected, for a person who configures it."""
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
