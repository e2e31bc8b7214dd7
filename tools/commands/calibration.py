"""`probewatch calibration`: shows the references and how they differ, and changes the one in force."""

import os
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import click
from rich.console import Console

from probewatch.appliance.configuration.config import Config, load_config
from probewatch.appliance.core.quality.calibration_difference import difference
from probewatch.appliance.limits import Limits
from probewatch.appliance.service.control.client import ControlClient, is_running
from probewatch.appliance.service.control.starting import how_to_end
from probewatch.appliance.storage.calibration_file import (
    calibration_bytes,
    check_own_name,
    is_device_set,
    provenance_of,
    write_calibration,
)
from probewatch.appliance.storage.reference import candidate_from_content, candidate_of_entry
from probewatch.appliance.storage.reference_dates import dates_of
from probewatch.appliance.storage.reference_store import FOLDER, Entry, History, content_of, set_aside
from probewatch.appliance.types import Calibration
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import check_new
from probewatch.drivers.printable import LONGEST_TEXT, printable
from probewatch.tools.commands.calibration_files import NamedReference, export, import_file
from probewatch.tools.commands.calibration_measured import command as measured
from probewatch.tools.german.translation import recognised, told
from probewatch.tools.shared.alarm_history import references_in
from probewatch.tools.shared.interruption import stopped_saying
from probewatch.tools.shared.json_report import json_of, json_option
from probewatch.tools.shared.named_cart import (
    CONFIG,
    NAMED,
    cart_language,
    control_option,
    folder_option,
    socket_option,
)
from probewatch.tools.shared.recovered import changes_text, recovered
from probewatch.tools.shared.reference_text import (
    entry_cells,
    entry_headings,
    entry_lines,
    numbers_text,
    print_difference,
    utc_text,
)
from probewatch.tools.shared.sign_off import remarks_on
from probewatch.tools.shared.spoken import language_of
from probewatch.tools.shared.tables import FittingTable
from probewatch.tools.shared.verification import accepted, ask, await_verification, recalibrating, reporting_change

_YES = click.option("--yes", is_flag=True, help="accept the difference shown without confirmation")
# Time to take up the probe and sweep; the service itself needs up to 10 s of motion
# (tests/appliance/core/test_line.py).
_WAIT = click.option("--wait", "wait_s", default=120.0, show_default=True, type=click.FloatRange(1, 3600), help="in s")


@click.group(name="calibration", short_help="the reference in force and its history; compare, go back")
def command() -> None:
    """Which reference calibration is in force, which were before, and how they differ.

    The configuration names the first reference only. From then on the service keeps in its own folder which one is in
    force, and goes on with it after a restart; every change is in the alarm log.

    \b
    Examples:
      probewatch calibration list
      probewatch calibration diff 1 2
      probewatch calibration back 1           # states the difference and asks
      probewatch calibration use new.toml     # a file; --yes where nobody can be asked
      probewatch calibration show 2
      probewatch calibration export 2 --output probe.xml
      probewatch calibration import probe.tfm --image-size 640 480 --output probe.toml
      probewatch calibration reset            # only where the service refuses its history
      probewatch calibration measured         # by motion, over all examinations
      probewatch calibration recover --output new.toml   # after a FAULT of rotation or offset
    """


for one in (measured, export, import_file):
    command.add_command(one)


@command.command(name="list", short_help="the references that were ever in force")
@folder_option
@json_option
def list_references(folder: Path, as_json: bool) -> None:
    """Every reference that was ever in force, the present one last."""
    history = references_in(folder)
    if as_json:
        click.echo(json_of(history.model_dump(mode="json")))
        return
    present = history.in_force
    language = cart_language()
    rows = [
        (str(entry.number), "▶" if entry is present else "", *entry_cells(entry, language)) for entry in history.entries
    ]
    Console(file=sys.stdout, highlight=False).print(FittingTable(entry_headings(language), rows), crop=False)


@command.command(short_help="show one reference in full")
@click.argument("number", type=int, required=False)
@folder_option
@click.option("--content", is_flag=True, help="print the calibration file itself, byte for byte")
def show(number: int | None, folder: Path, content: bool) -> None:
    """Everything known about reference NUMBER, or about the one in force, including who made and signed it, and until
    when it is valid. Missing data, a placeholder or an impossible date is marked with "!".
    """
    history = references_in(folder)
    entry = history.entry(len(history.entries) if number is None else number)
    if content:
        click.echo(content_of(folder, entry), nl=False)
        return
    language = cart_language()
    calibration = candidate_of_entry(folder, entry).calibration
    for name, text in (
        *entry_lines(entry, entry is history.in_force, language),
        *_paperwork(folder, history, entry, language),
        (told("scales", language), f"{numbers_text(calibration.scale_mm_per_px, 5)} mm/px (lateral, axial)"),
        (told("offset", language), f"{numbers_text(calibration.offset_mm, 2)} mm (lateral, axial, elevational)"),
        (told("polarity", language), f"{numbers_text(calibration.polarity, 0)} (lateral, axial)"),
    ):
        said = printable(text, LONGEST_TEXT)  # the terminal obeys colours and cursor movements
        click.secho(f"{name:<14}{said}", fg="yellow" if name == "!" else None)


def _paperwork(folder: Path, history: History, entry: Entry, language: str) -> Iterator[tuple[str, str]]:
    """Yields (name, text) on who made and signed it and how long it is valid; "!" marks what must not be relied on."""
    content = content_of(folder, entry)
    dates = dates_of(entry, history.entries, content, _due_days())
    stated, now = provenance_of(content), datetime.now(UTC)
    role, at = stated.get("signed_role", ""), stated.get("signed_at", "")
    signer = ", ".join(part for part in (stated.get("signed_by", ""), role, at and f"{utc_text(at)} UTC") if part)
    none = told("no date is set", language)
    due, expires = (f"{day:%Y-%m-%d %H:%M} UTC" if day else none for day in (dates.due, dates.expires))
    yield told("made by", language), stated.get("made_by") or told("not stated", language)
    yield told("signed by", language), signer or told("nobody", language)
    yield told("next check", language), due
    yield told("expires", language), expires
    for remark in (*remarks_on(stated, now), *filter(None, [dates.overdue(now)])):
        yield "!", recognised(remark, language)


def _cart() -> Config | None:
    """Returns the configuration of the selected cart; None where none is named and this computer has none that can be
    read.

    Raises ConfigurationError for one that was named.
    """
    named = click.get_current_context().meta.get(NAMED)
    try:
        return load_config(named or CONFIG)
    except ConfigurationError:
        if named is not None:
            raise
        return None


def _due_days() -> int | None:
    cart = _cart()
    return None if cart is None else cart.calibration.due_days


@command.command(short_help="how two references or files differ")
@click.argument("before")
@click.argument("after")
@folder_option
@json_option
def diff(before: str, after: str, folder: Path, as_json: bool) -> None:
    """How AFTER differs from BEFORE; each is the number of a reference, or a file.

    Where a person must accept the difference under the cart's limits, the output says so; in JSON as beyond_limits.
    """
    first, second, supposed = _pair(before, after, folder)
    change, cart = difference(first, second), _cart()
    is_beyond = change.beyond(Limits() if cart is None else cart.limits)
    if as_json:
        told_too = {"beyond_limits": is_beyond, "size_taken_from_the_other": supposed or None, "text": change.text}
        click.echo(json_of({**change.fields(), **told_too}))
        return
    language = cart_language()
    print_difference(change, language)
    if supposed:
        size = told(_SUPPOSED, language, file=supposed, width=first.image_size_px[0], height=first.image_size_px[1])
        click.secho(size, fg="yellow")
    if is_beyond:
        whose = "that probewatch ships with; --config names a cart's" if cart is None else "of the cart"
        must = "beyond the limits of the checks {whose}: a person must accept it before a service uses it"
        click.echo(told(must, language, whose=told(whose, language)))


@command.command(short_help="give a file to the service as its reference")
@click.argument("file", type=click.Path(path_type=Path))
@socket_option
@_YES
@_WAIT
def use(file: Path, control_socket: Path, yes: bool, wait_s: float) -> None:
    """Give FILE to the running service as its reference: our TOML, or a PLUS device set.

    A file far from the reference in force, beyond the limits of the checks, must be accepted: its difference is stated.
    The contact opens, and closes once the service has verified the new reference on moving tissue.

    \b
    Exit code 0: verified. 69: no service answers, or it lost a device. 75: declined, as while somebody else
    recalibrates, or not verified in time. 78: the file cannot be used.
    """
    _change(file, control_socket, yes, wait_s)


@command.command(short_help="go back to an earlier reference")
@click.argument("number", type=int)
@socket_option
@_YES
@_WAIT
def back(number: int, control_socket: Path, yes: bool, wait_s: float) -> None:
    """Go back to reference NUMBER of the history. This is a change like any other: shown, accepted, logged and verified
    again.

    Exit codes are those of `use`.
    """
    _change(number, control_socket, yes, wait_s)


@command.command(short_help="write the calibration that motion has measured")
@click.option("--output", required=True, type=click.Path(path_type=Path), help="new file, .toml")
@socket_option
def recover(output: Path, control_socket: Path) -> None:
    """Write the calibration that the running service proposes after a FAULT of rotation or in-plane offset.

    That is the reference with what motion measured of these; scales and ζ stay as they were. Nothing is applied:
    compare it (`diff`), and give it to the service with `use`, which states the difference, asks, and has it verified
    by new motion before the contact closes. A changed scale or ζ is not recovered by motion: `probewatch recalibrate`.

    \b
    Example:
      probewatch calibration recover --output recovered.toml

    \b
    Exit code 0: written. 69: no service answers. 78: nothing is proposed that could be written.
    """
    check_own_name(output)
    check_new(output)
    with ControlClient(control_socket) as client:
        status = client.status()
    write_calibration(
        output, recovered(status), {"made_by": "probewatch calibration recover", "from": changes_text(status)}
    )
    language = language_of(status)
    click.echo(f"{changes_text(status, language)}\n{told('written: {file}', language, file=output)}")


@command.command(short_help="set a damaged history aside and start again")
@folder_option
@control_option
@_YES
def reset(folder: Path, control_socket: Path, yes: bool) -> None:
    """Set the history aside, damaged or lost, so that the service starts again with the configuration's file.

    For a service that refuses to start because it cannot know its reference. What there was is kept under another name.
    """
    _refuse_running(control_socket)
    language = cart_language()
    with stopped_saying(told("nothing was changed", language), told("stopped", language)):
        ask(told("Set the history of the reference in {folder} aside?", language, folder=folder), yes, language)
    try:
        kept = set_aside(folder)
    except OSError as error:
        what = f"cannot be set aside ({error.strerror})"
        raise ConfigurationError(
            what, str(folder / FOLDER), "Run the command as the service's user, or as root"
        ) from None
    none = told("the folder holds no history", language)
    click.echo(none if kept is None else told("kept as {folder}", language, folder=kept))
    click.echo(
        told("at its next start the service uses the calibration file of the configuration, not verified", language)
    )


def _change(wanted: Path | int, socket: Path, yes: bool, wait_s: float) -> None:
    if isinstance(wanted, Path):
        _refuse_unusable(wanted)
    with ControlClient(socket) as client:
        language = language_of(client.status())
    with reporting_change(socket, language):
        with ControlClient(socket) as client:
            confirm = accepted(client.propose_calibration(wanted), yes, language)
        with ControlClient(socket) as client:
            with recalibrating(client, language):
                client.end_recalibration(wanted, *confirm, scanned=False)
            await_verification(client, socket, wait_s, language)
            number = client.status()["reference"]["number"]
            done = "reference {number} is verified and in force, also after a restart"
            click.echo(told(done, language, number=number))


def _refuse_unusable(file: Path) -> None:
    """Raises ConfigurationError for a file that no service can use; a file that only the service can read is left to
    the service.
    """
    if file.exists() and not os.access(file, os.R_OK):
        return
    if file.name.isdecimal() and not file.exists():
        remedy = f"To go back to reference {file.name}: probewatch calibration back {file.name}"
        raise ConfigurationError("is no file", str(file), remedy)
    content = calibration_bytes(file)
    if not is_device_set(content):  # a device set is complete only with the picture size of the cart
        candidate_from_content(content, str(file), None, "Probe")


def _refuse_running(socket: Path) -> None:
    if is_running(socket):
        raise ConfigurationError("a service is running", str(socket), f"Stop it first: {how_to_end(socket)}")


_SUPPOSED = (
    "{file} states no picture size: {width} × {height} px, that of the other, is supposed, and the offset depends on "
    "it. probewatch calibration import with --image-size makes a file that states it"
)


def _pair(before: str, after: str, folder: Path) -> tuple[Calibration, Calibration, str]:
    """Returns both calibrations, and which of the two, a device set, took the picture size from the other; empty where
    none did.
    """
    first, second = NamedReference(before, folder), NamedReference(after, folder)
    supposed = "" if first.size_px and second.size_px else after if first.size_px else before
    return first.calibration(second.size_px), second.calibration(first.size_px), supposed
