"""`probewatch self-test`: tests the cart before the clinic opens."""

import ctypes
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from probewatch.appliance.service.control.client import ControlClient
from probewatch.drivers.errors import ConfigurationError, ProbewatchError
from probewatch.drivers.files.atomic_file import make_folder, replacing
from probewatch.drivers.printable import printable
from probewatch.tools.german.translation import confirmed, told
from probewatch.tools.selftest import items
from probewatch.tools.selftest.baseline import KEY, beside, chosen, first_use
from probewatch.tools.selftest.items import Item
from probewatch.tools.selftest.listed import print_items
from probewatch.tools.selftest.measured import Measured, measured
from probewatch.tools.selftest.records import read_self_tests, sealed
from probewatch.tools.shared.interruption import stopped_saying
from probewatch.tools.shared.json_report import json_option, text_aside
from probewatch.tools.shared.named_cart import LOG, cart_says, socket_option
from probewatch.tools.shared.spoken import language_of
from probewatch.tools.shared.terminal import progress_bar

_STILL_S, _MOVING_S = 5.0, 12.0
"""Seconds of measurement. At rest: 300 poses at 60 Hz. In motion: the overlay is learnt in a few seconds of motion.
Longer would show more, but make people skip the test."""
_FOLDER = "self-tests"
_LAMPS_S = 5.0
"""Seconds for which a lamp test lights everything (docs/control.md)."""
_UNSYNCHRONISED, _ERROR = 0x0040, 5
"""STA_UNSYNC and TIME_ERROR of adjtimex(2), <linux/timex.h>."""
_TIMEX_BYTES, _TIMEX_STATUS = 208, 40
"""Bytes: size of struct timex of 64-bit Linux, and offset of its field `status`."""


@click.command(name="self-test")
@socket_option
@click.option("--feed", type=click.Path(path_type=Path), help="socket of the feed [beside the control socket]")
@click.option(
    "--folder", type=click.Path(file_okay=False, path_type=Path), help="where the result is kept [alarm folder]"
)
@click.option("--operator", default="", help="who runs the test; kept with the result")
@click.option(
    "--lamps",
    type=click.Choice(["ask", "seen", "not-seen", "skip"]),
    default="ask",
    show_default=True,
    help="test lamps and tone and ask, or state the result; skip does not pass",
)
@click.option("--baseline", is_flag=True, help="keep the result as that of the first use, to compare later ones with")
@click.option("--yes", is_flag=True, help="do not wait for the operator: the probe lies still now and moves afterwards")
@json_option
def command(
    control_socket: Path,
    feed: Path | None,
    folder: Path | None,
    operator: str,
    lamps: str,
    baseline: bool,
    yes: bool,
    as_json: bool,
) -> None:
    """Test the cart before the clinic opens, in under a minute: a green and red list.

    Devices, rates and losses, time quality, noise of the probe at rest, overlay mask, lamps and tone by the operator's
    word, disk, clock, reference and its due date. The service goes on watching meanwhile; nothing is changed.

    What was found is kept as JSON in the folder `self-tests` of the alarm log's folder, for the report. With
    --baseline it is that of the first use: each later figure is told beside it, and a rate that differs is red.

    \b
    Examples:
      probewatch self-test --operator "A. Smith"
      probewatch self-test --baseline                     # at the first use, and after a repair
      probewatch self-test --yes --lamps skip --json      # in a script, where nobody can be asked

    \b
    Exit code 0: all green. 1: something is red, or could not be tried. 69: no service answers.
    78: nobody can be asked, or a file cannot be used.
    """
    write = click.get_current_context().with_resource(text_aside(as_json))
    feed = feed or cart_says("feed", "socket") or control_socket.with_name("feed")
    folder = folder or (cart_says("alarm", "folder") or LOG) / _FOLDER
    if not yes and not sys.stdin.isatty():
        what = "needs an operator to lay the probe down and then to move it, and there is no terminal"
        raise ConfigurationError(
            what, "self-test", "Run it at a terminal, or give --yes and --lamps seen, not-seen or skip"
        )
    with ControlClient(control_socket) as client:
        language = language_of(client.status())
    with stopped_saying(told("no result was stored", language), told("stopped", language)):
        found, kept = _tested(control_socket, feed, folder, operator, lamps, yes, baseline, language)
    write([item.fields() for item in found])
    if not as_json:
        print_items(found, Console(file=sys.stdout, highlight=False), language)
        if kept.green:
            click.echo(told("kept: {file}", language, file=kept.what))
    sys.exit(0 if all(item.green for item in found) else 1)


def _tested(
    control: Path, feed: Path, folder: Path, operator: str, lamps: str, yes: bool, baseline: bool, language: str
) -> tuple[list[Item], Item]:
    """Runs the test. Returns its items, with one more where the result could not be stored, and the item about storing
    it.
    """
    still, moving, trouble = _measure(feed, yes, language)
    with ControlClient(control) as client:
        seen = _lamps(client, lamps, language)
        status = client.status()
    found = _judged(status, still, moving, trouble, seen)
    found = [*found, chosen(found)] if baseline else beside(found, first_use(read_self_tests(folder).kept))
    kept = _kept(folder, found, status, operator, baseline)
    return ([*found, kept] if kept.remedy else found), kept


def _measure(feed: Path, yes: bool, language: str) -> tuple[Measured, Measured, str]:
    """Returns the measurements at rest and in motion, and why the feed sent nothing, which is empty where it did."""
    try:
        _wait(told("Lay the probe down in view of the tracker, and leave it; then Enter", language), yes)
        with _progress(told("at rest", language)) as note:
            still = measured(feed, _STILL_S, note)
        _wait(told("Now move the probe over tissue or a phantom; then Enter", language), yes)
        with _progress(told("moving", language)) as note:
            return still, measured(feed, _MOVING_S, note), ""
    except ProbewatchError as error:
        return Measured(), Measured(), str(error)


def _wait(what: str, yes: bool) -> None:
    if not yes:
        click.prompt(what, default="", show_default=False, prompt_suffix=" ")


@contextmanager
def _progress(what: str) -> Iterator[Any]:
    with progress_bar("{task.description}") as progress:
        task = progress.add_task(what, total=1.0)
        yield lambda share: progress.update(task, completed=share)


def _lamps(client: ControlClient, how: str, language: str) -> bool | None:
    if how in ("seen", "not-seen"):
        return how == "seen"
    signals = {output["signal"] for output in client.status()["outputs"]}
    if how == "skip" or not sys.stdin.isatty() or signals <= {"contact"}:  # which no lamp test touches
        return None
    client.test_lamps()
    question = "For {seconds} s every lamp is lit and the tone sounds. All seen and heard?"
    return confirmed(told(question, language, seconds=f"{_LAMPS_S:g}"), language)


def _judged(status: dict[str, Any], still: Measured, moving: Measured, trouble: str, seen: bool | None) -> list[Item]:
    utc = datetime.now(UTC)
    found = [*items.service(status), *items.devices(status)]
    if trouble:
        found.append(Item("feed", False, trouble, "probewatch status says why there is none: feed"))
    else:
        frames, poses = moving.frames, moving.poses
        found += items.timing("video", frames, moving.frames_ns, items.silence_ms(status, "video"))
        found += items.timing("tracker", poses, moving.poses_ns, items.silence_ms(status, "tracker"))
        found += [items.noise(still.poses), items.overlay(frames)]
    found += [items.outputs(status, seen), *items.disk(status), items.clock(utc, _built(), _synchronised())]
    return [*found, *items.reference(status, utc)]


def _kept(folder: Path, found: list[Item], status: dict[str, Any], operator: str, baseline: bool) -> Item:
    """Stores the result. Returns an item that says whether that succeeded."""
    utc = datetime.now(UTC)
    record = {
        "format": "probewatch-self-test",
        "version": 1,
        "utc": utc.isoformat(timespec="seconds"),
        "operator": printable(operator),
        "passed": all(item.green for item in found),
        KEY: baseline and all(item.green for item in found),
        "software": status["software"],
        "reference": None if status["reference"] is None else status["reference"]["sha256"],
        "simulated": status["simulated"],
        "items": [item.fields() for item in found],
    }
    file = folder / f"{utc:%Y%m%dT%H%M%S.%f}Z.json"
    try:
        make_folder(folder, 0o770)
        with replacing(file) as stream:
            stream.write(json.dumps(sealed(record, folder), ensure_ascii=False, indent=1).encode() + b"\n")
        file.chmod(0o640)
    except (OSError, ProbewatchError) as error:
        return Item("kept", False, f"{folder}: {error}", "Name a --folder that you may write to, or be in its group")
    return Item("kept", True, str(file))


def _built() -> datetime:
    """Returns when this program was built; a cart's clock cannot be earlier."""
    return datetime.fromtimestamp(Path(__file__).stat().st_mtime, UTC)


def _synchronised() -> bool | None:
    """Returns whether the kernel reports a synchronised clock, None where it does not say."""
    timex = ctypes.create_string_buffer(_TIMEX_BYTES)
    state = ctypes.CDLL(None, use_errno=True).adjtimex(timex)
    if state < 0:
        return None
    status = int.from_bytes(timex.raw[_TIMEX_STATUS : _TIMEX_STATUS + 4], sys.byteorder)
    return state != _ERROR and not status & _UNSYNCHRONISED
