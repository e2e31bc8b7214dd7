"""Solves a cross-wire scan of a recording, and states the offset that it shows against the calibration in force."""

import sys
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import click
import numpy as np
from rich.console import Console

from probewatch.appliance.configuration.config import load_config
from probewatch.appliance.crosswire.offset import (
    Demand,
    OffsetSolution,
    ScanRefused,
    refuse_slid,
    solve_offset,
    solve_zeta,
)
from probewatch.appliance.crosswire.scan import CrosswireScan
from probewatch.appliance.storage.calibration_file import (
    calibration_bytes,
    is_device_set,
)
from probewatch.appliance.storage.reference import candidate_from_content, in_force
from probewatch.appliance.types import Calibration
from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.shared.crosswire_input import ScanInput, simulated_reference
from probewatch.tools.shared.tables import FittingTable
from probewatch.tools.shared.terminal import progress_bar

_COMPONENTS = ("offset lateral", "offset axial", "ζ (elevational)")


@dataclass(frozen=True, slots=True)
class InForce:
    """Represents the calibration in force. `file` is None where it is the simulated one."""

    calibration: Calibration
    file: Path | None = None
    sha256: str = ""


def calibration_in_force(
    config_file: Path | None,
    socket: Path | None,
    calibration: Path | None,
    simulate: bool,
    size_px: tuple[int, int],
    probe: str | None,
    may_lack: bool,
) -> tuple[InForce | None, Path | None]:
    """Returns the calibration in force and the socket of the service; explicit options take precedence over the
    configuration.

    `size_px` is (width, height) of the scan's pictures, which a device set does not state. `may_lack` allows that there
    is no calibration in force.
    """
    config = None if config_file is None else load_config(config_file)
    socket = socket if config is None else socket or config.control.socket
    if calibration is not None:
        content = calibration_bytes(calibration)
        needed_px = size_px if is_device_set(content) else None
        before = candidate_from_content(content, str(calibration), needed_px, probe or "Probe")
    elif config is not None:
        before = in_force(config, size_px)
    elif simulate:
        return InForce(simulated_reference()), socket
    elif may_lack:
        return None, socket
    else:
        raise click.UsageError("give the calibration in force: --calibration FILE, or --config FILE of the service")
    return InForce(before.calibration, Path(before.file), before.sha256), socket


def check_size(before: InForce, scan_input: ScanInput) -> None:
    """Raises ConfigurationError where the calibration in force is for pictures of another size."""
    size_px = before.calibration.image_size_px
    if size_px != scan_input.size_px:
        what = f"its pictures are {scan_input.size_px}, the calibration in force is for {size_px} px"
        raise ConfigurationError(what, scan_input.name, "Scan with the scanner setting that the calibration belongs to")


def scanned(scan_input: ScanInput, latency_ms: float) -> CrosswireScan:
    """Returns the scan after all its pictures have been examined."""
    scan = CrosswireScan(latency_ms)
    if scan_input.file is None and not sys.stderr.isatty():  # no bar is shown, and drawing the pictures takes a minute
        click.echo(f"looking at {scan_input.name}: {scan_input.total} pictures and poses", err=True)
    with progress_bar("crossing seen in {task.fields[seen]} of {task.fields[pictures]} pictures") as progress:
        task = progress.add_task("scan", total=scan_input.total, seen=0, pictures=0)
        for sample in scan_input.samples:
            scan.step(sample)
            progress.update(task, advance=1, seen=scan.sightings, pictures=scan.pictures)
    scan.finish()
    return scan


def solved(scan: CrosswireScan, before: Calibration, solve: str, demand: Demand) -> OffsetSolution:
    """Solves the scan. Raises ScanRefused, with what the pictures showed where the crossing was rarely seen."""
    views = scan.views
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


def print_solution(solution: OffsetSolution, before: Calibration) -> None:
    """Prints the solution beside the calibration before."""
    parts = zip(_COMPONENTS, before.offset_mm, solution.offset_mm, solution.sigma_mm, strict=True)
    rows = [
        (name, f"{old:.2f}", f"{new:.2f}", f"{sigma:.2f}" if np.isfinite(sigma) else "kept")
        for name, old, new, sigma in parts
    ]
    rows.append(("size of the cloud", f"{solution.cloud_before_mm:.2f}", f"{solution.cloud_after_mm:.2f}", ""))
    Console(file=sys.stdout, highlight=False).print(FittingTable(("mm", "before", "after", "± 1σ"), rows), crop=False)
    click.echo(f"views: {solution.views}, and {solution.rejected} rejected")
    click.echo(f"tilt spread: {solution.tilt_sd_deg:.1f}° (at least {solution.tilt_needed_deg:.1f}° needed)")
    click.echo(f"localisation: {solution.localisation_mm:.2f} mm per view and axis")


def provenance(solution: OffsetSolution, before: InForce, scan_input: ScanInput) -> dict[str, str]:
    """Returns what the new file states about its origin."""
    stated = [
        f"{name} {new:.4f} ± {sigma:.4f} mm, before {old:.4f}"
        for name, new, sigma, old in zip(
            _COMPONENTS, solution.offset_mm, solution.sigma_mm, before.calibration.offset_mm, strict=True
        )
        if np.isfinite(sigma)
    ]
    return {
        "when": datetime.now(UTC).isoformat(timespec="seconds"),
        "how": f"probewatch {version('probewatch')} recalibrate, cross-wire, closed form",
        "input": scan_input.name,
        "solved": "; ".join(stated),
        "views": f"{solution.views} used, {solution.rejected} rejected",
        "tilt_spread_deg": f"{solution.tilt_sd_deg:.2f}",
        "localisation_mm": f"{solution.localisation_mm:.4f}",
    }
