"""`probewatch study`: measures how often the instrument says OK, how accurate it is, and how soon it names a fault."""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from probewatch.appliance.core.parameters import MEASURED
from probewatch.appliance.limits import PROFILES, Profile
from probewatch.appliance.storage.calibration_file import calibration_bytes
from probewatch.drivers.errors import ConfigurationError, DeviceLost, RecordingError
from probewatch.drivers.files.atomic_file import check_kind
from probewatch.drivers.twins.scene.breathing import DIRECTIONS
from probewatch.drivers.twins.scene.surroundings import described, surroundings
from probewatch.tools.shared.found_recordings import found, is_there
from probewatch.tools.shared.recording_options import recording_options
from probewatch.tools.shared.tables import NOTHING, FittingTable
from probewatch.tools.shared.terminal import progress_bar
from probewatch.tools.shared.without_effect import refuse_typed
from probewatch.tools.study.archive import (
    ARCHIVE_KEYS,
    NOT_FETCHED,
    ArchiveTask,
    archive_table,
    refuse_all_unusable,
)
from probewatch.tools.study.hand import ALL, PROGRAMS
from probewatch.tools.study.hazard import STANDARD, WITHIN, Hazard
from probewatch.tools.study.kept_rows import refuse_changed, refuse_other_calibration
from probewatch.tools.study.page import check_page, write_page
from probewatch.tools.study.plan import Task, planned, tasks
from probewatch.tools.study.samples import ASKED, DEFAULT, KEYS, Conditions
from probewatch.tools.study.session import TISSUES
from probewatch.tools.study.store import is_url, listed
from probewatch.tools.study.summary import Coverage, Detection, coverages, detections
from probewatch.tools.study.table import StudyTable
from probewatch.tools.study.workers import results

_EXAMPLES = """
\b
Examples:
  probewatch study --seeds 3 --asked without-offsets     # how often healthy scanning is verified by itself
  probewatch study --sessions fan,hold --tissues still
  probewatch study --sessions gesture --tissues half-30+drag-2,rigid+breath-12-elevational
  probewatch study --hazards bend-lateral=6@start,latency=450@sudden
  probewatch study --sessions gesture-in-plane,gesture-fan
  probewatch study --hazards all --scheduler tcp://dask:8786
  probewatch study archive/ LIVER2.igs.mha --calibration probe.toml
  probewatch study s3://bucket/archive --calibration probe.toml --scheduler tcp://dask:8786

\b
Parts of a scene (--tissues), joined by +:
"""
_PARTS = "\n".join(f"  {form:<22}{what}" for form, what in described())
"""Has one line of the help for each part of a world."""


def _listed(_context: click.Context, _option: click.Parameter, text: str) -> tuple[str, ...]:
    chosen = tuple(PROGRAMS) if text == "all" else tuple(text.split(","))
    if unknown := [name for name in chosen if name not in ALL]:
        raise click.BadParameter(f"'{unknown[0]}' is none of {', '.join(ALL)}")
    return chosen


def _worlds(_context: click.Context, _option: click.Parameter, text: str) -> tuple[str, ...]:
    chosen = TISSUES if text == "all" else tuple(text.split(","))
    for name in chosen:
        surroundings(name)
    return chosen


def _noises(_context: click.Context, _option: click.Parameter, text: str) -> tuple[float, ...]:
    try:
        noises = tuple(float(one) for one in text.split(","))
    except ValueError:
        noises = (0.0,)
    if not all(0.001 <= one <= 5 for one in noises):
        raise click.BadParameter(f"'{text}' is not a list of .001 to 5 mm, such as .05,.1,.25")
    return noises


def _hazards(_context: click.Context, _option: click.Parameter, text: str) -> tuple[Hazard, ...]:
    if text == "within":
        return WITHIN
    return STANDARD if text == "all" else tuple(Hazard.parse(one) for one in text.split(","))


def _profiles(_context: click.Context, _option: click.Parameter, text: str) -> tuple[Profile, ...]:
    given = text.split(",")
    if unknown := [name for name in given if name not in PROFILES]:
        raise click.BadParameter(f"'{unknown[0]}' is none of {', '.join(PROFILES)}")
    return tuple(name for name in PROFILES if name in given)


@click.command(name="study", epilog=_EXAMPLES + _PARTS + f"\n  TO is one of {', '.join(DIRECTIONS)}.\n")
@click.argument("recordings", nargs=-1)
@click.option(
    "--output",
    default=Path("study"),
    show_default=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="folder for study.csv and study.html; rows already there are not computed again",
)
@click.option(
    "--sessions",
    default="all",
    show_default=True,
    callback=_listed,
    help=f"{', '.join(ALL)}; all: those without a gesture",
)
@click.option(
    "--tissues",
    default="all",
    show_default=True,
    callback=_worlds,
    help=f"scenes that the probe scans, parts joined by +: half-30+drag-2; see below; all: {', '.join(TISSUES)}",
)
@click.option("--seeds", default=10, show_default=True, type=click.IntRange(1, 10_000), help="of each session")
@click.option(
    "--draws",
    default=1,
    show_default=True,
    type=click.IntRange(1, 10_000),
    help="noises of the tracker on the same pictures: more hours without rendering more",
)
@click.option("--duration", "duration_s", type=click.FloatRange(5, 3600), help="of each session, s [60; mixed 90]")
@click.option(
    "--noise-mm",
    "noises_mm",
    default="0.1",
    show_default=True,
    callback=_noises,
    help="standard deviation of the tracker, mm; several: .05,.1,.25",
)
@click.option(
    "--hazards",
    default="none",
    show_default=True,
    callback=_hazards,
    help="none, all, within (all nine at once, none beyond half of its limit), or KIND=SIZE@MANNER,…: sizes in deg, "
    "mm, % and ms; manners start (where none is given), sudden, creeping, unseen; a slash between two at once",
)
@click.option(
    "--asked",
    type=click.Choice(list(ASKED)),
    default=DEFAULT,
    show_default=True,
    help="what the contact asks for: everything, as shipped, or all but the offsets, which sweeps alone do not show",
)
@click.option(
    "--profiles",
    default="coarse",
    show_default=True,
    callback=_profiles,
    help=f"limits by which every run is judged, each on the same pictures: {', '.join(PROFILES)}",
)
@click.option(
    "--motions",
    type=click.Path(path_type=Path, file_okay=False),
    help="cache of rendered sessions: 220 MB a minute",
)
@click.option(
    "--jobs",
    default=os.cpu_count() or 1,
    show_default=True,
    type=click.IntRange(1, 512),
    help="processes of this computer; each needs about 600 MB",
)
@click.option("--scheduler", metavar="tcp://HOST:PORT", help="an existing Dask cluster instead of processes here")
@click.option(
    "--calibration", type=click.Path(path_type=Path), help="of the RECORDINGs: a probewatch .toml or a PLUS device set"
)
@recording_options("RECORDINGs")
def command(
    recordings: tuple[str, ...],
    output: Path,
    sessions: tuple[str, ...],
    tissues: tuple[str, ...],
    seeds: int,
    draws: int,
    duration_s: float | None,
    noises_mm: tuple[float, ...],
    hazards: tuple[Hazard, ...],
    asked: str,
    profiles: tuple[Profile, ...],
    motions: Path | None,
    jobs: int,
    scheduler: str | None,
    calibration: Path | None,
    probe: str | None,
    reference: str | None,
    orientation: str | None,
) -> None:
    """Judge the instrument: run simulated sessions, or RECORDINGs, through it and tell how well it does.

    Each simulated session is a hand on tissue with known truth. For every run the table has the share of time in which
    the contact was closed, the first OK, each parameter's value, sigma and z-score beside its Cramér–Rao bound, what
    was named and when. It grows row by row, and is taken up where it was left.

    Of RECORDINGs the table has what the instrument says of each: no truth is known there. They are files, folders, or
    addresses that fsspec knows, such as s3://bucket/archive, of which each worker fetches its own.
    """
    check_kind(output, "a folder of several files")
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"cannot be made: {error.strerror}", str(output), "Give another --output") from error
    of_recordings = {"calibration": calibration, "probe": probe, "reference": reference, "orientation": orientation}
    _refuse_without_effect(recordings, of_recordings)
    if recordings:
        _study_recordings(_archive(recordings, calibration, (probe, reference, orientation)), output, jobs, scheduler)
        return
    table = StudyTable(output / "study.csv", KEYS)
    page = output / "study.html"
    check_page(page)
    folder = None if motions is None else motions.absolute()
    plan = planned(sessions, tissues, seeds, noises_mm, hazards, duration_s, asked, draws, profiles)
    _refuse_late(plan)
    _do(plan, table, folder, jobs, scheduler)
    keys = {one.key for one in plan}
    rows = [row for row in table.rows if tuple(row[key] for key in KEYS) in keys]
    _print(rows)
    write_page(page, rows)
    click.echo(f"written: {table.path}, {page}")


_SIMULATED_ALONE = (
    "--sessions",
    "--tissues",
    "--seeds",
    "--draws",
    "--duration",
    "--noise-mm",
    "--hazards",
    "--asked",
    "--profiles",
    "--motions",
)


def _refuse_without_effect(recordings: tuple[str, ...], of_recordings: Mapping[str, object]) -> None:
    """Raises UsageError for options of the other kind of study, RecordingError for a missing file."""
    given = [f"--{name}" for name, value in of_recordings.items() if value is not None]
    if not recordings and given:
        raise click.UsageError(f"{given[0]} is of RECORDINGs; simulated sessions have their own")
    for name in recordings:
        if not is_url(name) and not is_there(Path(name)):
            raise RecordingError("cannot be read: No such file or directory", name, "Check its name and its folder")
    if recordings:
        refuse_typed(_SIMULATED_ALONE, "RECORDINGs")


def _refuse_late(plan: Sequence[Conditions]) -> None:
    """Raises UsageError for a hazard that begins after its session: it would count as missed."""
    for one in plan:
        onset_s, ends_s = one.hazard.onset_s, one.session.duration_s
        if isfinite(onset_s) and onset_s >= ends_s:
            what = f"{one.hazard} begins at {onset_s:g} s, and the session ends at {ends_s:g} s"
            raise click.UsageError(f"{what}: give a longer --duration, or @start")


def _do(plan: Sequence[Conditions], table: StudyTable, folder: Path | None, jobs: int, scheduler: str | None) -> None:
    left = list(tasks(plan, table.done, folder))
    total = sum(len(task.runs) for task in left)
    if total < len(plan):
        click.echo(f"{len(plan) - total} of {len(plan)} runs are in {table.path} already")
    for rows in _progress(results(Task.rows, left, jobs, scheduler, _say), total):
        table.add(rows)


_Names = tuple[str | None, str | None, str | None]
"""Holds the options --probe, --reference and --orientation, None where one was not given."""


def _archive(recordings: tuple[str, ...], calibration: Path | None, names: _Names) -> list[ArchiveTask]:
    """Returns a task for each recording; the files of one run of a recorder are one recording."""
    content = None if calibration is None else calibration_bytes(calibration)
    stored = [urls for name in recordings if is_url(name) for urls in listed(name)]
    tasks = [_task(urls[0], calibration, names, urls=urls, content=content) for urls in stored]
    if paths := [Path(name).absolute() for name in recordings if not is_url(name)]:
        several, refused = found(paths)
        for what in refused:
            click.echo(what, err=True)
        for one in several:
            parts = () if isinstance(one, Path) else tuple(box.path for box in one.boxes)
            path = one if isinstance(one, Path) else parts[0]
            tasks.append(_task(path, calibration, names, parts=parts, content=content))
    needs_one = [task for task in tasks if not task.parts and not str(task.recording).endswith(".mcap")]
    if calibration is None and needs_one:
        raise click.UsageError("RECORDINGs need --calibration: only black boxes bring their own")
    return tasks


def _task(recording: Path | str, calibration: Path | None, names: _Names, **more: Any) -> ArchiveTask:
    probe, reference, orientation = names
    return ArchiveTask(recording, calibration, probe=probe, reference=reference, orientation=orientation, **more)


def _study_recordings(archive: list[ArchiveTask], output: Path, jobs: int, scheduler: str | None) -> None:
    table = StudyTable(output / "recordings.csv", ARCHIVE_KEYS)
    refuse_other_calibration(archive, table)
    refuse_changed(archive, table)
    left = [task for task in archive if (str(task.recording),) not in table.done]
    if len(left) < len(archive):
        click.echo(f"{len(archive) - len(left)} of {len(archive)} recordings are in {table.path} already")
    away: list[dict[str, str]] = []
    for rows in _progress(results(ArchiveTask.rows, left, jobs, scheduler, _say), len(left)):
        missing = [row for row in rows if row["error"].startswith(NOT_FETCHED)]
        away += missing
        table.add(row for row in rows if row not in missing)
    Console(highlight=False).print(archive_table([*table.rows, *away]), crop=False)
    click.echo(f"written: {table.path}")
    if away:
        what = f"{len(away)} of {len(archive)} recordings could not be fetched"
        raise DeviceLost(what, away[0]["recording"], "What is done stays, so start it again")
    refuse_all_unusable(table.rows)


def _say(text: str) -> None:
    click.echo(text, err=True)


def _progress(done: Iterable[list[dict[str, str]]], total: int) -> Iterator[list[dict[str, str]]]:
    with progress_bar("study {task.completed:.0f} of {task.total:.0f}") as progress:
        bar = progress.add_task("study", total=total)
        for rows in done:
            yield rows
            progress.advance(bar, len(rows))


def _print(rows: list[dict[str, str]]) -> None:
    console = Console(highlight=False)
    healthy, sick = coverages(rows), detections(rows)
    if healthy:
        heads: tuple[str, ...] = ("session", "tissue", "noise", "profile")
        heads += ("closed", "from … to", "first", "FAULT", "worst z RMS")
        console.print(FittingTable(heads, [_healthy_cells(one) for one in healthy], right_from=3), crop=False)
    if sick:
        heads = ("hazard", "profile", "FAULT", "named rightly", "after", "open after", "OK at twice its limit")
        console.print(FittingTable(heads, [_sick_cells(one) for one in sick], right_from=2), crop=False)


def _healthy_cells(one: Coverage) -> tuple[str, ...]:
    least, middle, most = one.spread
    known = {name: one.scores[name].rms for name in MEASURED if isfinite(one.scores[name].rms)}
    worst = max(known, key=lambda name: known[name], default=None)
    return (
        one.session,
        one.tissue,
        f"{one.noise_mm} mm",
        one.profile,
        f"{middle:.0f} %",
        f"{least:.0f} … {most:.0f}",
        _seconds(one.closed_s),
        f"{one.faulted.k} of {one.faulted.n}",
        NOTHING if worst is None else f"{known[worst]:.1f} {worst}",
    )


def _seconds(value: float) -> str:
    return f"{value:.1f} s" if isfinite(value) else NOTHING


def _sick_cells(one: Detection) -> tuple[str, ...]:
    gross = f"{one.gross.k} of {one.gross.n}"
    found, named = (f"{share.k} of {share.n}" for share in (one.found, one.named))
    return one.hazard, one.profile, found, named, _seconds(one.fault_s), _seconds(one.opened_s), gross
