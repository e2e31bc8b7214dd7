"""`probewatch recalibrate`: solves ζ or a whole calibration from a cross-wire scan, writes it, and gives it to the
service.
"""

import contextlib
import sys
from dataclasses import replace
from datetime import UTC, date, datetime
from functools import partial
from pathlib import Path

import click

from probewatch.appliance.crosswire.offset import (
    Demand,
    renewed,
)
from probewatch.appliance.crosswire.water import RANGE_C, SCANNER_M_S
from probewatch.appliance.service.control.client import ControlClient
from probewatch.appliance.service.control.server import ControlRefused
from probewatch.appliance.storage.calibration_file import (
    TOML_BEGINS,
    check_own_name,
    write_calibration,
)
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import check_replaceable, check_writable
from probewatch.tools.german.translation import refusing_in, told
from probewatch.tools.recalibration.live_service import live_service, scan_live
from probewatch.tools.recalibration.paperwork import Begin, Signature, signed
from probewatch.tools.recalibration.paperwork import sign_off as signed_by_both
from probewatch.tools.recalibration.recorded_scan import (
    InForce,
    calibration_in_force,
    check_size,
    print_solution,
    provenance,
    scanned,
    solved,
)
from probewatch.tools.recalibration.steps import Sound
from probewatch.tools.recalibration.terminal import words
from probewatch.tools.shared.calendar_option import DAY
from probewatch.tools.shared.crosswire_input import recorded, simulated
from probewatch.tools.shared.crosswire_whole import WholeOptions, solve_all, sound
from probewatch.tools.shared.interruption import stopped_saying
from probewatch.tools.shared.named_cart import cart_language, config_option, saying_how_to_start
from probewatch.tools.shared.sign_off import SignOff, user
from probewatch.tools.shared.spoken import language_of
from probewatch.tools.shared.verification import (
    accepted,
    await_verification,
    recalibrating,
    refuse_simulated,
    reporting_change,
)
from probewatch.tools.shared.without_effect import refuse_typed

_RECORDED_ALONE = (
    "--calibration",
    "--output",
    "--force",
    "--reference",
    "--orientation",
    "--latency-ms",
    "--seed",
    "--duration",
    "--strike",
    "--review",
    "--estimate",
    "--check",
    "--check-point",
    "--face-row",
    "--sigma-mm",
    "--yes",
    "--wait",
)
_LIVE_ALONE = ("--latency-first", "--unchecked", "--feed", "--folder")
_SIMULATED_ALONE = ("--seed", "--duration")
_RECORDING_ALONE = ("--reference", "--orientation")
_NOBODY = (
    "no scan was started: there is no terminal to ask at. Give --probe, --preset, --made-by, --signed-by and --role"
)
_HELP = """Scan a cross-wire, solve ζ, write a new calibration, and let the service verify it.

ζ is the part of the calibration that watching cannot see: how far the picture's plane lies before or behind the
marker body. It follows from one point seen under many tilts.

\b
How to scan
  1. Two thin crossed wires in water (48 °C, or 20 °C with 9 % ethanol: 1540 m/s); tank and wires stand still.
  2. Show the crossing: two bright spots run together into one. Pass through it slowly, 2 to 5 mm/s, to and fro.
  3. Tilt the probe between passages: left, right, forwards, backwards, 10° and more. At least 8 passages, 20 are
     better. Let the crossing appear in different places of the picture.
  4. If the marker body may have slid: turn the probe in the picture's plane, too, and give --solve offset.
  5. For a first calibration: three minutes, the crossing also in every corner of the picture, and --solve all. It needs
     no calibration in force, finds the tracker's latency itself, and lists the views; --strike 7 leaves one out.
  6. --check takes a second scan, of the crossing elsewhere: the new calibration must put it in one place.

\b
Example of a first calibration, signed:
  probewatch recalibrate --recording scan.igs.mha --solve all --water-c 47.5 --output probe.toml
    --check other.igs.mha --signed-by "R. Gray" --role physicist --reason "new cart" --due 2027-05-01

With --config or --socket the service is told: its contact opens, and closes again only after the service itself has
verified the new calibration on moving tissue, for which the command waits (--wait). When the scan is refused or
interrupted, the service goes back to the calibration in force before. A new calibration beyond the limits of the checks
must be accepted: the command states the difference and asks, or takes --yes; then the tilts and ζ, too, must be shown.
A verified one stays in force after a restart; `probewatch calibration` tells the history.

Exit code 0: written and, where a service was told, verified. 65: the scan or the recording cannot support it.
69: no service answers, or it lost a device. 75: declined, as while somebody else recalibrates, or not verified in
time. 78: a file or an option cannot be used.
"""


@click.command(name="recalibrate", help=_HELP)
@config_option
@click.option("--socket", type=click.Path(path_type=Path), help="control socket of the running service")
@click.option("--calibration", type=click.Path(path_type=Path), help="calibration in force, if not the service's")
@click.option("--output", type=click.Path(path_type=Path), help="new file [calibration in force, with date and time]")
@click.option("--force", is_flag=True, help="replace the output file if it exists")
@click.option("--recording", type=click.Path(path_type=Path), help="the scan: a PLUS sequence, .igs.mha or .mhd")
@click.option("--probe", help="tool on the probe, as the recording names it [Probe]")
@click.option("--reference", help="reference tool of the recording; Tracker for none")
@click.option(
    "--orientation", help="orientation of stored pictures, where the recording does not state it: MF, MN, UF or UN"
)
@click.option(
    "--latency-ms",
    type=click.FloatRange(-500, 500),
    help="of the tracker, as `latency` finds it [0; --solve all: sought]",
)
@click.option("--simulated", "simulate", is_flag=True, help="a simulated scan instead of a recorded one")
@click.option("--seed", default=1, show_default=True, type=click.IntRange(0), help="of the simulated scan")
@click.option("--duration", default=30.0, show_default=True, type=click.FloatRange(1, 600), help="of it, in s")
@click.option(
    "--solve",
    default="zeta",
    show_default=True,
    type=click.Choice(["zeta", "offset", "all"]),
    help="ζ, all of t_x, or all eight parameters",
)
@click.option(
    "--strike",
    multiple=True,
    type=click.IntRange(1),
    help="number of a view to leave out, from 1; repeatable; with all",
)
@click.option("--review", is_flag=True, help="list every view, not the furthest off alone; with all")
@click.option("--estimate", type=click.Path(path_type=Path), help="of replay --estimate, to compare with; with all")
@click.option("--check", "check_file", type=click.Path(path_type=Path), help="scan of the crossing elsewhere; with all")
@click.option("--check-point", nargs=3, type=float, help="where that crossing is, tracker mm, if measured otherwise")
@click.option("--water-c", type=click.FloatRange(*RANGE_C), help="temperature of the water, °C")
@click.option(
    "--scanner-m-s", default=SCANNER_M_S, show_default=True, type=click.FloatRange(1400, 1700), help="its setting"
)
@click.option(
    "--correct-sound", is_flag=True, help="correct depths for the water's speed of sound; linear arrays; with all"
)
@click.option(
    "--face-row", default=0.0, show_default=True, type=click.FloatRange(0), help="row of the probe's face, for that"
)
@click.option("--made-by", help="who scanned [user of this computer]")
@click.option("--signed-by", default="", help="second person, who signs")
@click.option("--role", default="", help="of the second person")
@click.option("--comment", default="", help="of the second person")
@click.option("--reason", default="", help="for the calibration")
@click.option("--probe-serial", default="", help="serial number of the probe")
@click.option("--preset", default="", help="preset of the scanner")
@click.option("--due", type=DAY, help="day on which to calibrate again")
@click.option("--expires", type=DAY, help="day after which not to use it")
@click.option("--sigma-mm", default=0.5, show_default=True, type=click.FloatRange(0.01, 5), help="largest ± accepted")
@click.option(
    "--live", is_flag=True, help="scan on the running cart; asks for missing options, except with --signed-by"
)
@click.option("--latency-first", is_flag=True, help="with --live: measure first how late the tracker is")
@click.option("--unchecked", default="", help="with --live --signed-by: why no check at another point is made")
@click.option("--feed", type=click.Path(path_type=Path), help="with --live: the feed's socket, if not the service's")
@click.option(
    "--folder",
    type=click.Path(file_okay=False, path_type=Path),
    help="with --live: for the new file [with --config calibrations in its alarm folder, else .]",
)
@click.option("--yes", is_flag=True, help="accept a difference beyond the limits of the checks without being asked")
@click.option("--wait", "wait_s", default=120.0, show_default=True, type=click.FloatRange(1, 3600), help="for it, in s")
@saying_how_to_start
def command(
    config_file: Path | None,
    socket: Path | None,
    calibration: Path | None,
    output: Path | None,
    force: bool,
    recording: Path | None,
    probe: str | None,
    reference: str | None,
    orientation: str | None,
    latency_ms: float | None,
    simulate: bool,
    seed: int,
    duration: float,
    solve: str,
    strike: tuple[int, ...],
    review: bool,
    estimate: Path | None,
    check_file: Path | None,
    check_point: tuple[float, float, float] | None,
    water_c: float | None,
    scanner_m_s: float,
    correct_sound: bool,
    face_row: float,
    made_by: str | None,
    signed_by: str,
    role: str,
    comment: str,
    reason: str,
    probe_serial: str,
    preset: str,
    due: datetime | None,
    expires: datetime | None,
    sigma_mm: float,
    live: bool,
    latency_first: bool,
    unchecked: str,
    feed: Path | None,
    folder: Path | None,
    yes: bool,
    wait_s: float,
) -> None:
    _refuse_options(live, simulate, recording, solve, signed_by, latency_first)
    if live:
        chosen = Begin(
            probe or probe_serial,
            preset,
            made_by or (user() if signed_by else ""),
            reason,
            "zeta" if solve == "zeta" else "whole",
            water_c,
            scanner_m_s,
            correct_sound,
            latency_first,
            _day(due),
            _day(expires),
        )
        nobody = unchecked or "no confirmation was asked for (--signed-by)"
        signature = Signature(signed_by, role, comment, unchecked=nobody) if signed_by else None
        _refuse_signed(chosen, signature)
        service = live_service(config_file, socket, feed, folder)
        with refusing_in(service.language):
            Sound(chosen.water_c, chosen.scanner_m_s, chosen.correct_sound)  # before anything is typed in vain
        scan_live(service, chosen if signature else _asked(chosen, service.language), signature)
        return
    sign_off = SignOff(
        made_by or user(), signed_by, role, comment, reason, probe_serial, preset, _day(due), _day(expires)
    )
    sign_off.check()
    whole = WholeOptions(
        strike, review, estimate, check_file, check_point, water_c, scanner_m_s, correct_sound, face_row, latency_ms
    )
    if solve != "all":
        whole.refuse_used()
    program = "guided" if solve == "all" else "freehand"
    scan_input = (
        simulated(seed, duration, program) if recording is None else recorded(recording, probe, reference, orientation)
    )
    before, socket = calibration_in_force(
        config_file, socket, calibration, simulate, scan_input.size_px, probe, solve == "all"
    )
    target = output or _dated(before)
    _check_target(target, force)
    if before is not None:
        check_size(before, scan_input)
    if simulate and socket is not None:
        refuse_simulated(socket)
    sound(water_c, scanner_m_s, correct_sound)
    language = _language(socket)
    with (
        reporting_change(socket, language),
        contextlib.nullcontext() if socket is None else ControlClient(socket) as client,
    ):
        with recalibrating(client, language):
            scan = scanned(scan_input, latency_ms or 0.0)
            if solve == "all":
                reading = partial(recorded, probe=probe, reference=reference, orientation=orientation)
                after, record = solve_all(
                    scan, scan_input, before.calibration if before else None, whole, sign_off, sigma_mm, reading
                )
            else:
                assert before is not None
                solution = solved(scan, before.calibration, solve, Demand(sigma_mm=sigma_mm))
                print_solution(solution, before.calibration)
                after = renewed(before.calibration, solution)
                record = {**provenance(solution, before, scan_input), **sign_off.fields()}
            _check_target(target, force)
            after = replace(
                after,
                simulated=simulate or (before is not None and before.calibration.simulated),
                face_radius_mm=None if before is None else before.calibration.face_radius_mm,
            )
            write_calibration(target, after, {**record, **_previous(before)})
            click.echo(told("written: {file}", language, file=target))
            if client is not None:
                _hand_over(client, target, yes, language)
        _conclude(client, socket, target, wait_s, language)


def _refuse_options(
    live: bool, simulate: bool, recording: Path | None, solve: str, signed_by: str, latency_first: bool
) -> None:
    """Raises UsageError where no scan is named, and for options that belong to another kind of scan."""
    if live:
        if simulate or recording is not None:
            raise click.UsageError("--live scans on the cart itself; leave --simulated and --recording out")
        if signed_by and latency_first:
            raise click.UsageError("--latency-first needs a person at the terminal; leave --signed-by out")
        if solve == "offset":
            raise click.UsageError("--solve offset needs a recorded scan; --live solves zeta or all")
        refuse_typed(_RECORDED_ALONE, "--live")
        return
    if simulate == (recording is not None):
        raise click.UsageError("give the scan: --live, or either --recording FILE or --simulated")
    scan = "--simulated" if simulate else "--recording"
    refuse_typed((*_LIVE_ALONE, *(_RECORDING_ALONE if simulate else _SIMULATED_ALONE)), scan)


def _refuse_signed(chosen: Begin, signature: Signature | None) -> None:
    """Raises ProbewatchError or UsageError, before the scan, for what would be refused after it."""
    if signature is None:
        SignOff(chosen.technician, due=chosen.due, expires=chosen.expires).check()
        return
    if not (chosen.probe.strip() and chosen.preset.strip()):
        raise click.UsageError("with --signed-by no questions are asked: give --probe and --preset, too")
    signed_by_both(chosen, signed(signature)).check()


def _asked(chosen: Begin, language: str) -> Begin:
    """Returns the options with the answers of the person at the terminal. Raises click.Abort."""
    asked = sys.stdin.isatty()
    begun, stopped = told("nothing was begun", language), told("stopped", language)
    with stopped_saying(begun if asked else _NOBODY, stopped if asked else "stopped"):
        return replace(
            chosen,
            probe=chosen.probe or words(told("probe", language), language),
            preset=chosen.preset or words(told("depth or preset of the scanner", language), language),
            technician=chosen.technician or words(told("your name", language), language),
        )


def _day(moment: datetime | None) -> date | None:
    return None if moment is None else moment.date()


def _dated(before: InForce | None) -> Path:
    file = Path("probe.toml") if before is None else before.file or Path("simulated.toml")
    return file.with_name(f"{file.stem}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}.toml")


def _check_target(target: Path, force: bool) -> None:
    check_own_name(target)
    if force:
        check_replaceable(target, TOML_BEGINS.encode())
    elif target.exists():
        raise ConfigurationError("exists already", str(target), "Give --output another name, or --force to replace it")
    check_writable(target)


def _previous(before: InForce | None) -> dict[str, str]:
    if before is None:
        return {"who": user(), "previous_file": "none"}
    file = "simulated" if before.file is None else str(before.file.absolute())
    return {"who": user(), "previous_file": file, "previous_sha256": before.sha256}


def _language(socket: Path | None) -> str:
    """Returns the language of the cart. Raises DeviceLost where its service does not answer."""
    if socket is None:
        return cart_language()
    with ControlClient(socket) as client:
        return language_of(client.status())


def _hand_over(client: ControlClient, target: Path, yes: bool, language: str) -> None:
    """Gives the new calibration to the service. Raises ControlRefused, which names the command to do so later."""
    try:
        client.end_recalibration(target, *accepted(client.propose_calibration(target), yes, language))
    except ControlRefused as error:
        remedy = f"{error.remedy or 'See its status'}; later: probewatch calibration use {target}"
        raise ControlRefused(error.what, error.where, remedy) from None


def _conclude(client: ControlClient | None, socket: Path | None, target: Path, wait_s: float, language: str) -> None:
    if client is None or socket is None:
        later = "no service was notified; to use the file: probewatch calibration use {file}"
        click.echo(told(later, language, file=target))
        return
    await_verification(client, socket, wait_s, language)
    done = "the service has verified the new calibration and monitors again; it is in force, also after a restart"
    click.echo(told(done, language))
