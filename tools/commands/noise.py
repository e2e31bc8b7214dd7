"""`probewatch noise`: learns the noise of this cart from healthy scanning, for `[noise]` of the configuration."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TypeVar

import click
from rich.console import Console
from rich.progress import track

from probewatch.appliance.configuration.config import load_config
from probewatch.appliance.configuration.noise_file import (
    NOISE_BEGINS,
    LearnedFrom,
    LearnedNoise,
    judged_by,
    write_noise,
)
from probewatch.appliance.limits import FALSE_ALARM_H, MOST_NAMED_NATS, NAMED_NATS
from probewatch.appliance.storage.black_box import Series
from probewatch.appliance.supervision.timeline import Judging
from probewatch.drivers.errors import RecordingError
from probewatch.drivers.files.atomic_file import check_kind, check_replaceable
from probewatch.tools.shared.digest import file_sha256, with_pictures
from probewatch.tools.shared.found_recordings import found
from probewatch.tools.shared.healthy_scanning import Heard, Named, heard_in_sequence, heard_in_series
from probewatch.tools.shared.noise_tail import Tail, least_hours, minutes_text, tail_of
from probewatch.tools.shared.recording_options import recording_options

_Item = TypeVar("_Item")
_DIGITS = 3
"""Decimal places of what is written: a thousandth of a nat changes no verdict that a person could tell apart."""


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--output", required=True, type=click.Path(path_type=Path), help="file to write, such as noise.toml")
@click.option("--config", "config_path", type=click.Path(path_type=Path), help="of the cart: its limits and times")
@click.option("--calibration", type=click.Path(path_type=Path), help="of sequences; a black box brings its own")
@recording_options("sequences")
def command(
    recordings: tuple[Path, ...],
    output: Path,
    config_path: Path | None,
    calibration: Path | None,
    probe: str | None,
    reference: str | None,
    orientation: str | None,
) -> None:
    """Learn from RECORDINGS of healthy scanning how sure a FAULT must be before it is named on this cart.

    It plays them through the line, as replay does, and notes how far the sequential test's log likelihood ratio rises
    while nothing is wrong. From that follows the threshold which such scanning passes once in 1000 hours at most. Where
    it is higher than the one that probewatch ships with (18.5 nats), faults are named later; the contact opens as
    before, at the first sign. It is never lower.

    RECORDINGS are sequences (.igs.mha, .mhd, .nrrd) with --calibration, black boxes (.mcap), and folders of them, of
    this cart, with its probe, on patients, and with nothing wrong: one that shows a fault is refused by name.

    \b
    Examples:
      probewatch noise /var/lib/probewatch-recorder --config /etc/probewatch/probewatch.toml --output noise.toml
      probewatch noise MONDAY.igs.mha TUESDAY.igs.mha --calibration probe.toml --output noise.toml

    Then name the file in the configuration, [noise] file = "noise.toml", and: probewatch reload

    Exit code 65: a recording is damaged, not healthy, named twice, or all are too short (it says how much is needed).
    78: a file or an option cannot be used.
    """
    check_kind(output, "TOML", ".toml")
    check_replaceable(output, NOISE_BEGINS.encode())
    config = None if config_path is None else load_config(config_path)
    judging = Judging() if config is None else Judging(config.limits, timeouts=config.supervisor.timeouts())
    several, refused = found(recordings)
    if refused:
        raise RecordingError(f"cannot be learned from: {refused[0]}", str(recordings[0]), "Leave it out")
    files = [file for one in several for file in _files(one)]
    origin = _once_each(files)
    named = Named(probe, reference, orientation)
    _refuse_without_effect(several, named)
    heard = [_heard(one, calibration, judging, named) for one in several]
    hours = sum(listened.tested_ns for listened, _ in heard) / 3.6e12
    _refuse_too_little(hours, files)
    tail = tail_of([peak for listened, _ in heard for peak in listened.peaks.values()], hours)
    _refuse_too_high(tail, files)
    learned = _learned(tail, origin, any(simulated for _, simulated in heard), judging)
    write_noise(output, learned)
    for line in _told(tail, learned):
        click.echo(line)
    click.echo(f"written: {output}")


def _refuse_without_effect(several: Sequence[Path | Series], named: Named) -> None:
    """Refuses options for sequences where no sequence is named."""
    given = [f"--{field.name}" for field in fields(named) if getattr(named, field.name) is not None]
    if given and all(isinstance(one, Series) for one in several):
        raise click.UsageError(f"{given[0]} is for sequences: a black box holds the pose that the cart used")


def _heard(one: Path | Series, calibration: Path | None, judging: Judging, named: Named) -> tuple[Heard, bool]:
    """Returns the peaks of one recording, and whether it is simulated. Raises RecordingError, click.UsageError."""
    stale_ns = judging.timeouts.stale_ns
    if isinstance(one, Series):
        heard = heard_in_series(one, judging.limits, stale_ns)
        if one.damage_text:
            raise RecordingError(f"is damaged: {one.damage_text}", str(one.boxes[0].path), "Leave it out")
        return heard
    if calibration is None:
        raise click.UsageError("Missing option '--calibration': only a black box brings its own")
    return heard_in_sequence(one, calibration, judging.limits, stale_ns, _progress, named)


def _files(one: Path | Series) -> tuple[Path, ...]:
    return tuple(box.path for box in one.boxes) if isinstance(one, Series) else with_pictures(one)


def _once_each(files: list[Path]) -> tuple[LearnedFrom, ...]:
    """Returns the name and SHA-256 of each file. Raises RecordingError where two files are the same."""
    known: dict[str, Path] = {}
    for file in files:
        digest = file_sha256(file)
        if digest in known:
            what = f"is the same recording as {known[digest]}"
            raise RecordingError(what, str(file), "Name each recording once: a copy adds no evidence")
        known[digest] = file
    return tuple(LearnedFrom(file=file.name, sha256=digest) for digest, file in known.items())


def _refuse_too_little(hours: float, files: list[Path]) -> None:
    least = least_hours()
    if hours < least:
        what = f"{minutes_text(hours)} of scanning with motion to test are too little"
        remedy = f"At least {minutes_text(least)} are needed, {minutes_text(least - hours)} more"
        raise RecordingError(what, _whole(files), remedy)


def _refuse_too_high(tail: Tail, files: list[Path]) -> None:
    if tail.threshold_nats <= MOST_NAMED_NATS:
        return
    what = (
        f"would need a threshold of {tail.threshold_nats:.0f} nats, more than {MOST_NAMED_NATS:.0f}: "
        f"{tail.exceedances} half minutes rose above {tail.from_nats:g}. "
        "This scanning is not healthy, or not like the model of the noise"
    )
    raise RecordingError(what, _whole(files), "Check calibration and tracker; more hours narrow the bound")


def _whole(files: list[Path]) -> str:
    return str(files[0]) if len(files) == 1 else f"{files[0]} and {len(files) - 1} more"


def _learned(tail: Tail, origin: tuple[LearnedFrom, ...], simulated: bool, judging: Judging) -> LearnedNoise:
    return LearnedNoise(
        format="probewatch-noise",
        version=1,
        named_nats=max(round(tail.threshold_nats, _DIGITS), NAMED_NATS),
        hours=max(round(tail.hours, _DIGITS), 10.0**-_DIGITS),
        from_nats=tail.from_nats,
        exceedances=tail.exceedances,
        tail_nats=round(tail.tail_nats, _DIGITS),
        per_hour=round(tail.per_hour, _DIGITS),
        software=f"probewatch {version('probewatch')}",
        learned_utc=datetime.now(UTC).isoformat(timespec="seconds"),
        simulated=simulated,
        limits=judged_by(judging.limits),
        recording=origin,
    )


def _told(tail: Tail, learned: LearnedNoise) -> Iterator[str]:
    yield f"{tail.hours:.2f} h of scanning with motion to test, {len(learned.recording)} files"
    rose = f"{tail.exceedances} half minutes rose above {tail.from_nats:g} nats"
    yield f"{rose}; at most {tail.per_hour:.2g} in an hour (95 %)"
    yield f"one false name in {FALSE_ALARM_H:.0f} h asks for {tail.threshold_nats:.1f} nats"
    if learned.named_nats > NAMED_NATS:
        yield f"a fault is named from {learned.named_nats:.1f} nats instead of {NAMED_NATS:.1f}, and so later"
    else:
        yield f"the threshold that probewatch ships with, {NAMED_NATS:.1f} nats, keeps that promise and stays"


def _progress(items: Iterable[_Item]) -> Iterator[_Item]:
    console = Console(stderr=True)
    return iter(track(items, "noise", transient=True, console=console)) if console.is_terminal else iter(items)
