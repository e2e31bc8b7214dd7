"""`probewatch recalibrate`: a cross-wire scan, ζ in closed form, a new calibration file, and the service told of it."""

import contextlib
import getpass
import hashlib
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import click
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from appliance.calibration_file import read_calibration, write_calibration
from appliance.config import load_config
from appliance.crosswire.offset import (
    Demand,
    OffsetSolution,
    ScanRefused,
    refuse_slid,
    renewed,
    solve_offset,
    solve_zeta,
)
from appliance.crosswire.scan import CrosswireScan
from appliance.service.control import ControlRefused
from appliance.service.control_client import ControlClient
from appliance.types import Calibration, State
from drivers.atomicfile import check_writable
from drivers.errors import ConfigurationError, DeviceLost, ProbewatchError
from tools.crosswire_input import ScanInput, recorded, simulated, simulated_reference

_LOOK_EVERY_S = 0.25
_COMPONENTS = ("offset lateral", "offset axial", "ζ (elevational)")

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

With --config or --socket the service is told: its contact opens, and closes again only after the service itself has
verified the new calibration on moving tissue, for which the command waits (--wait). When the scan is refused or
interrupted, the service goes back to the calibration in force before.

Exit code 0: written and, where a service was told, verified. 65: the scan or the recording cannot support it.
69: no service answers, or it lost a device. 75: the service declined, or has not verified in time. 78: a file or an
option cannot be used.
"""


@dataclass(frozen=True, slots=True)
class _Reference:
    """The calibration in force. file: None where it is the simulated one. configured: the service starts with it."""

    calibration: Calibration
    file: Path | None = None
    configured: bool = False
    sha256: str = ""


@click.command(name="recalibrate", help=_HELP, short_help="scan a cross-wire, solve ζ, write a new calibration")
@click.option("--config", "config_file", type=click.Path(path_type=Path), help="of the service: names the next two")
@click.option("--socket", type=click.Path(path_type=Path), help="control socket of the running service")
@click.option("--calibration", type=click.Path(path_type=Path), help="calibration in force: our .toml")
@click.option("--output", type=click.Path(path_type=Path), help="new file [calibration in force, with date and time]")
@click.option("--force", is_flag=True, help="replace the output file if it exists")
@click.option("--recording", type=click.Path(path_type=Path), help="the scan: a PLUS sequence, .igs.mha or .mhd")
@click.option("--probe", help="tool on the probe, as the recording names it [Probe]")
@click.option("--reference", help="reference tool of the recording; Tracker for none")
@click.option("--orientation", help="how pictures are stored, e.g. MF, where the recording does not say")
@click.option("--latency-ms", default=0.0, type=click.FloatRange(-500, 500), help="of the tracker, as replay finds it")
@click.option("--simulated", "simulate", is_flag=True, help="a simulated scan instead of a recorded one")
@click.option("--seed", default=1, show_default=True, type=click.IntRange(0), help="of the simulated scan")
@click.option("--duration", default=30.0, show_default=True, type=click.FloatRange(1, 600), help="of it, in s")
@click.option(
    "--solve", default="zeta", show_default=True, type=click.Choice(["zeta", "offset"]), help="ζ, or all of t_x"
)
@click.option("--sigma-mm", default=0.5, show_default=True, type=click.FloatRange(0.01, 5), help="largest ± accepted")
@click.option("--wait", "wait_s", default=120.0, show_default=True, type=click.FloatRange(1, 3600), help="for it, in s")
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
    latency_ms: float,
    simulate: bool,
    seed: int,
    duration: float,
    solve: str,
    sigma_mm: float,
    wait_s: float,
) -> None:
    if simulate == (recording is not None):
        raise click.UsageError("give the scan: either --recording FILE or --simulated")
    before, socket = _in_force(config_file, socket, calibration, simulate)
    target = output or _dated(before)
    _check_target(target, force)
    scan_input = simulated(seed, duration) if recording is None else recorded(recording, probe, reference, orientation)
    _check_size(before, scan_input)
    with _recalibrating(socket):
        scan = _scanned(scan_input, latency_ms)
        solution = _solved(scan, before.calibration, solve, Demand(sigma_mm=sigma_mm))
        _print(solution, before.calibration)
        _check_target(target, force)
        write_calibration(target, renewed(before.calibration, solution), _provenance(solution, before, scan_input))
        click.echo(f"written: {target}")
        if socket is not None:
            with ControlClient(socket) as client:
                client.end_recalibration(target)
    _conclude(socket, before, target, wait_s)


def _in_force(
    config_file: Path | None, socket: Path | None, calibration: Path | None, simulate: bool
) -> tuple[_Reference, Path | None]:
    """The calibration in force and the socket of the service; explicit options go before the configuration."""
    configured = None
    if config_file is not None:
        config = load_config(config_file)
        configured, socket = config.calibration.file, socket or config.control.socket
    file = calibration or configured
    if file is not None:
        before = read_calibration(file)
        return _Reference(before, file, file == configured, hashlib.sha256(file.read_bytes()).hexdigest()), socket
    if not simulate:
        raise click.UsageError("give the calibration in force: --calibration FILE, or --config FILE that names it")
    return _Reference(simulated_reference()), socket


def _dated(before: _Reference) -> Path:
    file = before.file or Path("simulated.toml")
    return file.with_name(f"{file.stem}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}.toml")


def _check_target(target: Path, force: bool) -> None:
    check_writable(target)
    if target.exists() and not force:
        raise ConfigurationError("exists already", str(target), "Give --output another name, or --force to replace it")


def _check_size(before: _Reference, scan_input: ScanInput) -> None:
    size_px = before.calibration.image_size_px
    if size_px != scan_input.size_px:
        what = f"its pictures are {scan_input.size_px}, the calibration in force is for {size_px} px"
        raise ConfigurationError(what, scan_input.name, "Scan with the scanner setting that the calibration belongs to")


@contextlib.contextmanager
def _recalibrating(socket: Path | None) -> Iterator[None]:
    """The service recalibrates while the block runs; a block that fails or is interrupted aborts it."""
    if socket is None:
        yield
        return
    try:
        with ControlClient(socket) as client:
            client.begin_recalibration()
        yield
    except BaseException:
        with contextlib.suppress(ProbewatchError), ControlClient(socket) as client:
            client.abort_recalibration()
        raise


def _scanned(scan_input: ScanInput, latency_ms: float) -> CrosswireScan:
    scan = CrosswireScan(latency_ms)
    with _progress("crossing seen in {task.fields[seen]} of {task.fields[pictures]} pictures") as progress:
        task = progress.add_task("scan", total=scan_input.total, seen=0, pictures=0)
        for sample in scan_input.samples:
            scan.step(sample)
            progress.update(task, advance=1, seen=scan.sightings, pictures=scan.pictures)
    return scan


def _progress(text: str) -> Progress:
    console = Console(stderr=True)
    columns = TextColumn(text), BarColumn(), TimeRemainingColumn()
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def _solved(scan: CrosswireScan, before: Calibration, solve: str, demand: Demand) -> OffsetSolution:
    """Raises ScanRefused, with what the pictures showed where the crossing was hardly seen."""
    views = scan.views()
    click.echo(f"{scan.pictures} pictures, crossing seen in {scan.sightings}, {len(views)} passages through its plane")
    for reason, number in scan.refused.most_common():
        click.echo(f"  {number} without: {reason}")
    if not views:
        remedy = "See that the wires show brightly, and pass through their crossing slowly, to and fro"
        raise ScanRefused("no passage through the crossing was found", "cross-wire scan", remedy)
    crossings_px, poses = np.array([view.centre_px for view in views]), np.array([view.matrix for view in views])
    if solve == "offset":
        return solve_offset(crossings_px, poses, before, demand)
    refuse_slid(crossings_px, poses, before)
    return solve_zeta(crossings_px, poses, before, demand)


def _print(solution: OffsetSolution, before: Calibration) -> None:
    table = Table("mm", "before", "after", "± 1σ", box=SIMPLE_HEAD, pad_edge=False)
    for name, old, new, sigma in zip(_COMPONENTS, before.offset_mm, solution.offset_mm, solution.sigma_mm, strict=True):
        table.add_row(name, f"{old:.2f}", f"{new:.2f}", f"{sigma:.2f}" if np.isfinite(sigma) else "kept")
    table.add_row("size of the cloud", f"{solution.cloud_before_mm:.2f}", f"{solution.cloud_after_mm:.2f}", "")
    Console(file=sys.stdout, highlight=False).print(table)
    click.echo(f"views: {solution.views}, and {solution.rejected} rejected")
    click.echo(f"tilt spread: {solution.tilt_sd_deg:.1f}° (at least {solution.tilt_needed_deg:.1f}° needed)")
    click.echo(f"localisation: {solution.localisation_mm:.2f} mm per view and axis")


def _provenance(solution: OffsetSolution, before: _Reference, scan_input: ScanInput) -> dict[str, str]:
    stated = [
        f"{name} {new:.4f} ± {sigma:.4f} mm, before {old:.4f}"
        for name, new, sigma, old in zip(
            _COMPONENTS, solution.offset_mm, solution.sigma_mm, before.calibration.offset_mm, strict=True
        )
        if np.isfinite(sigma)
    ]
    return {
        "who": _user(),
        "when": datetime.now(UTC).isoformat(timespec="seconds"),
        "how": f"probewatch {version('probewatch')} recalibrate, cross-wire, closed form",
        "input": scan_input.name,
        "solved": "; ".join(stated),
        "views": f"{solution.views} used, {solution.rejected} rejected",
        "tilt_spread_deg": f"{solution.tilt_sd_deg:.2f}",
        "localisation_mm": f"{solution.localisation_mm:.4f}",
        "previous_file": "simulated" if before.file is None else str(before.file.absolute()),
        "previous_sha256": before.sha256,
    }


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):
        return f"uid {os.getuid()}"


def _conclude(socket: Path | None, before: _Reference, target: Path, wait_s: float) -> None:
    if socket is None:
        click.echo("no service was told; name the new file in [calibration] of its configuration and start it")
        return
    _await_verification(socket, wait_s)
    click.echo("the service has verified the new calibration and monitors again")
    if not (before.configured and before.file is not None and target.absolute() == before.file.absolute()):
        click.echo(f'for its next start, set in its configuration: [calibration] file = "{target.absolute()}"')


def _await_verification(socket: Path, wait_s: float) -> None:
    """Returns once the service monitors. Raises DeviceLost, ControlRefused."""
    end_s = time.monotonic() + wait_s
    click.echo("now move the probe over tissue, to and fro: the service verifies the new calibration")
    with _progress("{task.fields[state]}: {task.fields[reason]}") as progress:
        task = progress.add_task("wait", total=None, state="", reason="")
        while True:
            with ControlClient(socket) as client:
                status = client.status()
            progress.update(task, state=status["state"], reason=status["reason"])
            if status["state"] != State.RECALIBRATING.value:
                break
            if time.monotonic() > end_s:
                raise _not_verified(f"not verified within {wait_s:g} s: {status['reason']}")
            time.sleep(_LOOK_EVERY_S)
    if status["state"] == State.DEVICE_LOST.value:
        what = f"a device was lost before the new calibration was verified: {status['reason']}"
        raise DeviceLost(what, str(socket), "The old one is in force again; mend the device and recalibrate anew")
    if status["state"] != State.MONITORING.value:
        raise _not_verified(f"not verified, the service is in state {status['state']}: {status['reason']}")


def _not_verified(what: str) -> ControlRefused:
    return ControlRefused(what, "new calibration", "The contact stays open; move the probe over tissue, see its status")
