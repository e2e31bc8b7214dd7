"""`probewatch latency`: measures the tracker's latency against the pictures, from a recording."""

import math
from collections.abc import Callable
from pathlib import Path

import click

from probewatch.appliance.core.line import Line
from probewatch.appliance.core.path.latency import Latency
from probewatch.appliance.crosswire.latency import BottomLine
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.calibration_file import read_calibration
from probewatch.drivers.errors import RecordingError
from probewatch.drivers.recordings.replay import Recording, open_recording
from probewatch.drivers.samples import Sample
from probewatch.tools.shared.lateness import lateness
from probewatch.tools.shared.left_out import tell_left_out
from probewatch.tools.shared.recording_options import recording_options
from probewatch.tools.shared.terminal import progress_bar

_CLOCK_SIGMA_MS = 5.0
"""ms, sigma of what the recorder's own stamps add to every estimate, which no motion shows: the figure that PLUS states
for its temporal calibration. The estimator's own sigma is that of the motion alone."""


@click.command(name="latency")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option("--poses", type=click.Path(path_type=Path), help="sequence with the poses, if recorded apart")
@click.option(
    "--calibration", type=click.Path(path_type=Path), help="for tissue or a phantom; without it: a water tank"
)
@recording_options()
def command(
    recording: Path,
    poses: Path | None,
    calibration: Path | None,
    probe: str | None,
    reference: str | None,
    orientation: str | None,
) -> None:
    """Measure how late the tracker's stamps are against the pictures' in RECORDING (PLUS .igs.mha or .mhd), ± 1 sigma.

    Positive: the tracker is late; the pose stamped t + latency belongs to the picture stamped t. Give the figure to
    `recalibrate --latency-ms`, or to the recorder.

    Without --calibration the recording is of a water tank: move the probe straight up and down over its bottom, which
    shows as one bright line across the picture, for 15 s, 2 s to and fro, turning sharply. It needs nothing else.

    With --calibration it is of tissue or a phantom, moved sideways and in depth; a rough calibration is enough.

    \b
    Examples:
      probewatch latency tank.igs.mha
      probewatch latency tissue.igs.mha --calibration probe.toml

    \b
    Exit code 0: found. 65: the recording cannot be used, or does not show it; 78: the calibration or an option cannot.
    """
    session = open_recording(recording, poses=poses, probe=probe, reference=reference, orientation=orientation)
    if session.size_px is None:
        raise RecordingError("holds no pictures", str(recording), "Give a recording with its pictures")
    tell_left_out(session)
    found = _of_tank(session, recording) if calibration is None else _of_tissue(session, calibration, probe, recording)
    sigma_ms = (1e6 * found.sigma_s**2 + _CLOCK_SIGMA_MS**2) ** 0.5
    value_ms = 1000 * found.value_s
    early = f", or the pictures are late: latency {value_ms:.1f} ms" if round(value_ms, 1) < 0 else ""
    click.echo(f"{lateness(value_ms, sigma_ms)}{early}")


def _of_tank(session: Recording, recording: Path) -> Latency:
    bottom = BottomLine()
    _walk(session, "looking for the tank's bottom", bottom.step)
    found = bottom.latency()
    if found is None:
        line = f"a bright line across the picture that moves was seen in {bottom.seen} of {bottom.pictures} pictures"
        what = f"is not of the bottom of a water tank, or its motion does not show how late the tracker is: {line}"
        remedy = "Move the probe up and down for 15 s, by strokes of different lengths, turning sharply; "
        remedy += "for tissue or a phantom, also of wires, give --calibration"
        raise RecordingError(what, str(recording), remedy)
    click.echo(f"bottom line followed in {bottom.seen} of {bottom.pictures} pictures")
    return found


def _of_tissue(session: Recording, calibration: Path, probe: str | None, recording: Path) -> Latency:
    line = Line(read_calibration(calibration, session.size_px, probe or "Probe"), Limits())
    _walk(session, "comparing the paths of picture and tracker", line.step)
    check = line.constant_latency()
    if math.isnan(check.value):
        remedy = "Record a quarter of a minute of tissue: to and fro sideways and in depth, turning sharply"
        raise RecordingError("its motion does not show how late the tracker is", str(recording), remedy)
    return Latency(check.value / 1000, check.sigma / 1000)


def _walk(session: Recording, work: str, step: Callable[[Sample], object]) -> None:
    """Passes each sample of the recording to `step`, and shows the progress."""
    with progress_bar(work) as progress:
        task = progress.add_task("latency", total=len(session))
        for sample in session.samples():
            step(sample)
            progress.update(task, advance=1)
