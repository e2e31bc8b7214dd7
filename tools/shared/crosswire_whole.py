"""Solves all eight parameters from a scan, prints them and checks them at another point. A refusal states every reason
for which the scan cannot be used.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from rich.console import Console

from probewatch.appliance.crosswire.checkpoint import PASS_MM, check_point
from probewatch.appliance.crosswire.offset import ScanRefused
from probewatch.appliance.crosswire.running import Running, RunningCalibration, WholeDemand
from probewatch.appliance.crosswire.scan import CrosswireScan
from probewatch.appliance.crosswire.water import LARGEST_ERROR, for_tissue, speed_of_sound_m_s
from probewatch.appliance.storage.calibration_file import read_calibration
from probewatch.appliance.types import Calibration
from probewatch.tools.shared.crosswire_input import ScanInput
from probewatch.tools.shared.crosswire_review import disagreements, parameter_table, view_table
from probewatch.tools.shared.digest import file_sha256
from probewatch.tools.shared.lateness import lateness
from probewatch.tools.shared.sign_off import SignOff, whole_record

_STATED_LATENCY_S = 0.005
"""s, standard deviation of a latency that the user states: that with which `probewatch latency` finds it. Not
varied."""


@dataclass(frozen=True, slots=True)
class WholeOptions:
    """Holds the options of --solve all. `latency_ms` is None where the user stated none."""

    strike: tuple[int, ...] = ()
    review: bool = False
    estimate: Path | None = None
    check_file: Path | None = None
    check_point: tuple[float, float, float] | None = None
    water_c: float | None = None
    scanner_m_s: float = 1540.0
    correct_sound: bool = False
    face_row_px: float = 0.0
    latency_ms: float | None = None

    def refuse_used(self) -> None:
        """Raises click.UsageError for an option that needs --solve all."""
        given = {
            "--strike": self.strike,
            "--review": self.review,
            "--estimate": self.estimate,
            "--check": self.check_file,
            "--check-point": self.check_point,
            "--correct-sound": self.correct_sound,
        }
        for name, value in given.items():
            if value:
                raise click.UsageError(f"{name} goes with --solve all")


def sound(water_c: float | None, scanner_m_s: float, corrected: bool) -> None:
    """Prints how the speed of sound in the water affects depths. Raises ScanRefused where the effect is too large and
    not corrected.
    """
    if water_c is None:
        return
    water_m_s = speed_of_sound_m_s(water_c)
    error = scanner_m_s / water_m_s - 1
    depth = "too deep" if error > 0 else "too shallow"
    told = f"sound travels at {water_m_s:.0f} m/s in water of {water_c:g} °C, the scanner counts with {scanner_m_s:.0f}"
    click.echo(f"{told}: depths appear {abs(100 * error):.1f} % {depth}")
    if abs(error) > LARGEST_ERROR and not corrected:
        raise ScanRefused(
            f"{told}: {abs(100 * error):.1f} % {depth}, {100 * LARGEST_ERROR:g} % is the most",
            "cross-wire scan",
            "Use water of 48 °C, or of 20 °C with 9 % of ethanol (and leave --water-c away), or give --solve all and"
            " --correct-sound",
        )


def solve_all(
    scan: CrosswireScan,
    scan_input: ScanInput,
    before: Calibration | None,
    options: WholeOptions,
    sign_off: SignOff,
    sigma_mm: float,
    reading: Callable[[Path], ScanInput],
) -> tuple[Calibration, dict[str, str]]:
    """Returns the calibration and its record. `reading` opens the recording for the check at another point. Raises
    ScanRefused.
    """
    state, running = _solved(scan, scan_input, before, options, sigma_mm)
    _say(scan, state, running, before, options)
    if state.refusals or state.whole is None:
        raise ScanRefused(
            "; ".join(f"{one.reason.value}: {one.what}" for one in state.refusals) or "no solution",
            "cross-wire scan",
            state.refusals[0].remedy if state.refusals else "Scan again",
        )
    found = state.whole.calibration
    record = whole_record(state, sign_off, scan_input.name, _sha256(scan_input))
    if options.check_file is not None:
        record["check"] = _checked(found, reading(options.check_file), options, state.whole.latency_s)
    if options.correct_sound and options.water_c is not None:
        water_m_s = speed_of_sound_m_s(options.water_c)
        found = for_tissue(found, water_m_s, options.scanner_m_s, options.face_row_px)
        record["sound"] = f"made at {water_m_s:.1f} m/s, carried to {options.scanner_m_s:.1f} m/s"
    return found, record


def _solved(
    scan: CrosswireScan, scan_input: ScanInput, before: Calibration | None, options: WholeOptions, sigma_mm: float
) -> tuple[Running, RunningCalibration]:
    demand = WholeDemand(offset_mm=sigma_mm)
    if options.latency_ms is None:
        running = RunningCalibration(scan_input.size_px, before, demand)
    else:
        running = RunningCalibration(scan_input.size_px, before, demand, _STATED_LATENCY_S)
    for number, view in enumerate(scan.views, 1):
        try:
            running.add(view)
        except ValueError as error:
            remedy = "See that the recording holds rigid poses in mm"
            raise ScanRefused(str(error), f"cross-wire scan, view {number}", remedy) from None
    for number in options.strike:
        if number > len(scan.views):
            raise click.UsageError(f"--strike {number}: the scan has views 1 to {len(scan.views)}")
        running.strike(number - 1)
    return running.state(scan.misses_mm), running


def _say(
    scan: CrosswireScan,
    state: Running,
    running: RunningCalibration,
    before: Calibration | None,
    options: WholeOptions,
) -> None:
    click.echo(f"{scan.pictures} pictures, crossing seen in {scan.sightings}, {state.views} passages through its plane")
    for reason, number in scan.refused.most_common():
        click.echo(f"  {number} without: {reason}")
    console = Console(highlight=False)
    if state.views:
        console.print(
            view_table(state, np.array([view.centre_px for view in running.views]), options.review), crop=False
        )
    if state.whole is not None:
        whole = state.whole
        others = {} if before is None else {"in force": before}
        if options.estimate is not None:
            others["estimate"] = read_calibration(options.estimate, whole.calibration.image_size_px)
        console.print(parameter_table(whole, others), crop=False)
        for disagreement in disagreements(whole, others):
            click.secho(f"! {disagreement}", fg="yellow")
        if state.closed is not None:
            given = "the one in force" if before is not None else "the new one"
            zeta = f"{state.closed.zeta_mm:.2f} ± {state.closed.zeta_sigma_mm:.2f} mm"
            click.echo(f"ζ in closed form, all else of {given}: {zeta}")
        late = 1000 * whole.latency_s + (options.latency_ms or 0.0)
        click.echo(lateness(late, 1000 * whole.latency_sigma_s))
        click.echo(f"one view scatters by {whole.localisation_mm:.2f} mm per axis")
        click.echo(f"a point of the picture is put right within {whole.expected_mm:.2f} mm, as far as the views tell")
    spread = ", ".join(f"{value:.1f}°" for value in state.coverage.spread_deg)
    click.echo(f"tilt spread about the lateral, axial, elevational axis: {spread}")
    if state.coverage.next_motion:
        click.echo(f"what would add most: {state.coverage.next_motion}")
    for refusal in state.refusals:
        click.echo(f"{refusal.reason.value}: {refusal.what}. {refusal.remedy}")


def _checked(found: Calibration, other: ScanInput, options: WholeOptions, latency_s: float) -> str:
    """Returns the result of the check at another crossing, in words. Raises ScanRefused where the views of that
    crossing do not meet in one place, or not at its stated place.
    """
    scan = CrosswireScan((options.latency_ms or 0.0) + 1000 * latency_s)
    for sample in other.samples:
        scan.step(sample)
    scan.finish()
    known = None if options.check_point is None else np.array(options.check_point)
    check = check_point(found, scan.views, known)
    how = "from where it is" if check.known else "about one place"
    told = f"{len(scan.views)} views put it within {check.error_mm:.2f} mm RMS {how}, {check.largest_mm:.2f} at most"
    click.echo(f"check at an independent point: {told}")
    if not check.passed:
        raise ScanRefused(
            f"{told}; {PASS_MM:g} mm is allowed",
            "check at an independent point",
            "See that marker body and tank are fixed, then scan again",
        )
    return told


def _sha256(scan_input: ScanInput) -> str:
    return "" if scan_input.file is None else file_sha256(scan_input.file)
