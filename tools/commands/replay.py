"""`probewatch replay`: a recording through the same line as live data, and a report of what it shows."""

import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import click
from rich.console import Console
from rich.progress import track

from appliance.configuration.config import load_config
from appliance.core.handeye.second_opinion import SecondOpinion
from appliance.core.line import Line
from appliance.core.quality.report import Change, LineReport, report_json
from appliance.storage.calibration_file import read_calibration
from appliance.supervision.timeline import Judging
from appliance.types import Check
from drivers.files.atomic_file import check_writable
from drivers.recordings.replay import open_recording
from drivers.samples import Sample
from drivers.twins.faults import CART_FAULTS, Episode, Schedule
from tools.shared.estimate import check_new, write_estimate
from tools.shared.json_report import write_json
from tools.shared.recording_run import run
from tools.shared.tables import NOTHING, FittingTable


def _episodes(_context: click.Context, _option: click.Parameter, texts: tuple[str, ...]) -> Schedule:
    return Schedule(tuple(_episode(text) for text in texts))


def _episode(text: str) -> Episode:
    fault, at, seconds = text.partition("@")
    if fault not in CART_FAULTS:
        raise click.BadParameter(f"'{fault}' is none of {', '.join(CART_FAULTS)}")
    try:
        from_s = float(seconds) if at else 0.0
    except ValueError:
        from_s = -1.0
    if not 0 <= from_s < 1e6:
        raise click.BadParameter(f"'{seconds}' is not a time in seconds after the start of the recording")
    return Episode(fault, from_s)


@click.command(name="replay")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--calibration", required=True, type=click.Path(path_type=Path), help="our .toml or a PLUS device set")
@click.option("--config", "config_path", type=click.Path(path_type=Path), help="judge as the cart with this file would")
@click.option("--poses", type=click.Path(path_type=Path), help="sequence with the poses, if recorded apart")
@click.option("--inject", "schedule", multiple=True, callback=_episodes, metavar="FAULT[@SECONDS]", help="repeatable")
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="write the report here too")
@click.option(
    "--estimate", "estimate_path", type=click.Path(path_type=Path), help="write the estimated calibration here"
)
@click.option("--probe", help="tool on the probe, as the transforms name it [Probe]")
@click.option("--reference", help="reference tool; Tracker for none [Reference, where recorded]")
@click.option("--orientation", help="how pictures are stored, e.g. MF, where the file does not say")
def command(
    recording: Path,
    calibration: Path,
    config_path: Path | None,
    poses: Path | None,
    schedule: Schedule,
    json_path: Path | None,
    estimate_path: Path | None,
    probe: str | None,
    reference: str | None,
    orientation: str | None,
) -> None:
    """Run RECORDING (PLUS .igs.mha or .mhd) through the line and print a report.

    --config takes limits, durations and patience from a cart's configuration, so that the recording is judged as that
    cart would have judged it; without it they are those that probewatch ships with.

    --estimate writes what the motion shows of the calibration as a new file, for the first calibration of a cart
    (docs/first-calibration.md); what it does not show is taken from --calibration and named in not_observed.

    Exit code 0 says that a report was made; the verdict is in the report. 65: the recording cannot be used, or shows
    too little for --estimate; 78: the calibration or an option cannot.
    """
    check_writable(json_path)
    check_new(estimate_path)
    session = open_recording(recording, poses=poses, probe=probe, reference=reference, orientation=orientation)
    nominal = read_calibration(calibration, session.size_px, probe or "Probe")
    judging = Judging() if config_path is None else _judging(config_path)
    line = Line(nominal, judging.limits, judging.patience.stale_ns)
    report, timeline = run(session, line, schedule, judging, lambda samples: _progress(samples, len(session)))
    _print(report, timeline, recording)
    if json_path is not None:
        write_json(json_path, report_json(report, timeline))
    if estimate_path is not None:
        write_estimate(estimate_path, report.estimate, nominal, recording)
        click.echo(f"written: {estimate_path}")


def _judging(config_path: Path) -> Judging:
    config = load_config(config_path)
    return Judging(config.limits, config.supervisor.durations(), config.supervisor.patience())


def _progress(samples: Iterable[Sample], total: int) -> Iterator[Sample]:
    console = Console(stderr=True)
    if not console.is_terminal:
        return iter(samples)
    return iter(track(samples, "replay", total, transient=True, console=console))


def _print(report: LineReport, timeline: list[Change], recording: Path) -> None:
    click.echo(f"{recording.name}: {report.frames} frames, {report.poses} poses, {report.paired} paired")
    for reason, number in report.unpaired.items():
        click.echo(f"  {number} not paired: {reason}")
    Console(file=sys.stdout, highlight=False).print(_table(report))
    click.echo(f"{report.motions} motions of the probe went into the estimate")
    if report.second_opinion is not None:
        click.echo(_second_opinion(report.second_opinion))
    for change in timeline:
        click.echo(f"{change.t_s:8.2f} s  {change.state.value}: {change.reason}")
    fault = f" · {report.verdict.fault}" if report.verdict.fault else ""
    click.echo(f"verdict: {report.verdict.kind.value}{fault}  {report.verdict.reason}")


def _second_opinion(opinion: SecondOpinion) -> str:
    lateral, axial = (
        f"{scale:.4f} ± {scale * sigma:.4f}"
        for scale, sigma in zip(opinion.scale_mm_per_px, opinion.sigma[3:], strict=True)
    )
    return f"closed form, without the reference ({opinion.form}, {opinion.pairs} pairs): {lateral} and {axial} mm/px"


def _table(report: LineReport) -> FittingTable:
    latency = () if report.latency is None or report.latency in report.checks else (report.latency,)
    headings = ("check", "value", "± 1σ", "limit", "of limit", "verdict")
    return FittingTable(headings, [_cells(check) for check in (*latency, *report.checks)])


def _cells(check: Check) -> tuple[str, ...]:
    if check.value != check.value:
        return check.name, NOTHING, NOTHING, f"{check.limit:g} {check.unit}", NOTHING, check.verdict.value
    value, sigma = f"{check.value:.3g} {check.unit}", f"{check.sigma:.2g}"
    return check.name, value, sigma, f"{check.limit:g} {check.unit}", f"{check.ratio:.3g}", check.verdict.value
