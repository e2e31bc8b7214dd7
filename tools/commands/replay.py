"""`probewatch replay`: runs a recording through the same pipeline as live data and reports the result."""

import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import click
from rich.console import Console
from rich.progress import track

from probewatch.appliance.configuration.config import load_config
from probewatch.appliance.core.line import Line
from probewatch.appliance.core.quality.report import VERSION
from probewatch.appliance.storage.black_box import Series
from probewatch.appliance.storage.calibration_file import (
    calibration_bytes,
    check_own_name,
    read_calibration,
)
from probewatch.appliance.supervision.timeline import Judging
from probewatch.drivers.descriptor import FILM_SUFFIXES
from probewatch.drivers.errors import RecordingError
from probewatch.drivers.files.atomic_file import check_apart, check_new
from probewatch.drivers.recordings.replay import Recording, open_recording
from probewatch.drivers.suggestion import did_you_mean, suggested
from probewatch.drivers.twins.faults import CART_FAULTS, Episode, Schedule
from probewatch.tools.report.page import check_page
from probewatch.tools.report.pdf import check_pdf, write_pdf
from probewatch.tools.report.recording_page import write_recording_page
from probewatch.tools.report.trace import Trace
from probewatch.tools.shared.digest import with_pictures
from probewatch.tools.shared.estimate import write_estimate
from probewatch.tools.shared.fault_at import fault_at
from probewatch.tools.shared.found_recordings import SUFFIXES, found, is_there
from probewatch.tools.shared.json_report import json_option, text_aside
from probewatch.tools.shared.recording_options import recording_options
from probewatch.tools.shared.recording_run import BlackBoxSession, Seen, nobody, run, run_series
from probewatch.tools.shared.replay_outcome import Outcome, print_outcome
from probewatch.tools.shared.subject import Subject
from probewatch.tools.shared.terminal import progress_bar
from probewatch.tools.study.archive import (
    NOTHING_TO_JUDGE,
    RECORD_BOTH,
    ArchiveTask,
    archive_table,
    refuse_all_unusable,
)
from probewatch.tools.study.workers import results

_Item = TypeVar("_Item")


def _episodes(_context: click.Context, _option: click.Parameter, texts: tuple[str, ...]) -> Schedule:
    return Schedule(tuple(_episode(text) for text in texts))


def _episode(text: str) -> Episode:
    fault, from_s = fault_at(text)
    if from_s is not None and not 0 <= from_s < 1e6:
        seconds = text.partition("@")[2]
        raise click.BadParameter(f"'{seconds}' is not a time in seconds after the start of the recording")
    return Episode(fault, from_s or 0.0)


@click.command(name="replay")
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--calibration", type=click.Path(path_type=Path), help="a probewatch .toml or a PLUS device set")
@click.option(
    "--config",
    "config_path",
    type=click.Path(path_type=Path),
    help="use the limits and times of this cart configuration, a whole one",
)
@click.option("--poses", type=click.Path(path_type=Path), help="sequence or .csv with the poses, if recorded apart")
@click.option(
    "--inject",
    "schedule",
    multiple=True,
    callback=_episodes,
    metavar="FAULT[@SECONDS]",
    help=f"repeatable: {', '.join(CART_FAULTS)}",
)
@json_option
@click.option("--html", "html_path", type=click.Path(path_type=Path), help="write a page to look at, with plots")
@click.option("--pdf", "pdf_path", type=click.Path(path_type=Path), help="that page as PDF, by chromium")
@click.option(
    "--estimate", "estimate_path", type=click.Path(path_type=Path), help="write the estimated calibration here"
)
@recording_options()
@click.option(
    "--jobs", default=1, show_default=True, type=click.IntRange(1, 512), help="processes for several recordings"
)
def command(
    recordings: tuple[Path, ...],
    calibration: Path | None,
    config_path: Path | None,
    poses: Path | None,
    schedule: Schedule,
    as_json: bool,
    html_path: Path | None,
    pdf_path: Path | None,
    estimate_path: Path | None,
    probe: str | None,
    reference: str | None,
    orientation: str | None,
    jobs: int,
) -> None:
    """Run RECORDINGS through the line and print a report; of several, or of a folder of them, a table.

    It reads PLUS sequences (.igs.mha, .mhd, .igs.nrrd, .nrrd), black boxes of probewatch record (.mcap, whose files of
    one run are one recording), and films with a table of poses beside them (docs/black-box.md has its columns).

    \b
    Examples:
      probewatch replay LIVER.igs.mha --calibration probe.toml --html liver.html
      probewatch replay /var/lib/probewatch-recorder/kept
      probewatch replay film.mp4 --poses poses.csv --calibration probe.toml
      probewatch replay archive/ --calibration probe.toml --jobs 2

    A black box needs no --calibration: it is judged by what was in force, and the report says whether every verdict is
    that of the live run, bit for bit. With --calibration it is judged by that one.

    --config takes limits, durations and timeouts from a cart's configuration, so that the recording is judged as that
    cart would have judged it; without it they are those that probewatch ships with.

    --estimate writes what the motion shows of the calibration as a new file, for the first calibration of a cart
    (docs/first-calibration.md); what it does not show is taken from --calibration and named in not_observed.

    Exit code 0 says that a report was made; the verdict is in the report. 65: no recording can be used, nothing in it
    can be judged, or it shows too little for --estimate; 78: the calibration or an option cannot.
    """
    write_report = click.get_current_context().with_resource(text_aside(as_json))
    _refuse_report(recordings)
    _refuse_absent(recordings)
    check_apart((html_path, pdf_path, estimate_path), (*recordings, poses, calibration, config_path))
    check_page(html_path)
    check_pdf(pdf_path)
    if pdf_path is not None and html_path is None:
        raise click.UsageError("--pdf prints the page of --html")
    check_own_name(estimate_path)
    check_new(estimate_path)
    if estimate_path is not None and calibration is None:
        raise click.UsageError("--estimate needs --calibration")
    judging = None if config_path is None else _judging(config_path)
    several, refused = found(recordings)
    _tell_refused(refused, several, recordings)
    if len(several) > 1:
        _refuse_for_several(poses=poses, inject=schedule.episodes, estimate=estimate_path, html=html_path)
        content = None if calibration is None else calibration_bytes(calibration)
        named = (probe, reference, orientation)
        tasks = [ArchiveTask(_path(one), calibration, judging, _parts(one), *named, content=content) for one in several]
        subject = Subject.of((), calibration, config_path, schedule)
        for name, said in subject.rows():  # beside the table, which a pipe cuts into columns
            click.echo(f"{name + ':':<18}{said}", err=True)
        rows = _print_several(tasks, jobs)
        write_report({"version": VERSION, "recordings": rows, "of": subject.fields()})
        refuse_all_unusable(rows)
        return
    (one,) = several
    trace = Trace()
    names = _Names(poses, probe, reference, orientation)
    outcome = _replayed(one, calibration, judging, schedule, names, nobody if html_path is None else trace)
    files = [*(_parts(one) or with_pictures(_path(one))), *([] if poses is None else [poses])]
    subject = Subject.of(files, calibration, config_path, schedule)
    print_outcome(outcome, subject)
    write_report({**outcome.fields(), "of": subject.fields()})
    if html_path is not None:
        kept = subject, outcome.path.name, trace, outcome.report, outcome.timeline, outcome.comparison, outcome.damage
        write_recording_page(html_path, *kept)
        click.echo(f"written: {html_path}")
        if pdf_path is not None:
            write_pdf(html_path, pdf_path)
            click.echo(f"written: {pdf_path}")
    if estimate_path is not None:
        assert outcome.nominal is not None
        write_estimate(estimate_path, outcome.report.estimate, outcome.nominal, outcome.path)
        click.echo(f"written: {estimate_path}")
    if why := outcome.unusable_because:
        raise RecordingError(f"{NOTHING_TO_JUDGE}: {why}", str(outcome.path), RECORD_BOTH)


@dataclass(frozen=True)
class _Names:
    """Holds the options for opening a recording."""

    poses: Path | None
    probe: str | None
    reference: str | None
    orientation: str | None


def _replayed(
    one: Path | Series, calibration: Path | None, judging: Judging | None, schedule: Schedule, names: _Names, seen: Seen
) -> Outcome:
    if isinstance(one, Series) and calibration is None:
        _refuse_without_effect(
            poses=names.poses, probe=names.probe, reference=names.reference, orientation=names.orientation
        )
        if schedule.episodes:
            raise click.UsageError("--inject needs --calibration")
        report, timeline, comparison = run_series(one, judging, _progress(None), seen)
        return Outcome(_path(one), report, timeline, None, comparison, one.damage_text)
    if calibration is None:
        raise click.UsageError("Missing option '--calibration': only a black box brings its own")
    if isinstance(one, Series):
        _refuse_without_effect(poses=names.poses, reference=names.reference, orientation=names.orientation)
    session: BlackBoxSession | Recording
    if isinstance(one, Series):
        session = BlackBoxSession(one)
    else:
        session = open_recording(
            one, poses=names.poses, probe=names.probe, reference=names.reference, orientation=names.orientation
        )
    if session.size_px is None:
        raise RecordingError("holds no pictures", str(_path(one)), "Give those, and this with --poses")
    _refuse_late(schedule, (session.overlap_ns[1] - session.start_ns) / 1e9)
    nominal = read_calibration(calibration, session.size_px, names.probe or "Probe")
    judged = judging or Judging()
    line = Line(nominal, judged.limits, judged.timeouts.stale_ns)
    report, timeline = run(session, line, schedule, judged, _progress(len(session)), seen)
    damage = one.damage_text if isinstance(one, Series) else ""
    notes = tuple(session.notes) if isinstance(session, Recording) else ()
    return Outcome(_path(one), report, timeline, nominal, None, damage, notes)


def _refuse_late(schedule: Schedule, end_s: float) -> None:
    """Refuses a fault that begins after the end of the recording: it would have no effect, and the report would list
    it.
    """
    for episode in schedule.episodes:
        if episode.from_s > max(end_s, 0):
            what = (
                f"--inject {episode.fault}@{episode.from_s:g} begins after the recording, which ends at {end_s:.1f} s"
            )
            raise click.UsageError(what)


def _refuse_without_effect(**given: object) -> None:
    if named := [f"--{name}" for name, value in given.items() if value]:
        raise click.UsageError(f"{named[0]} is for sequences and films: a black box holds the pose that the cart used")


def _tell_refused(refused: list[str], several: list[Path | Series], recordings: tuple[Path, ...]) -> None:
    for what in refused:
        click.secho(what, err=True, fg="yellow")
    if not several:
        raise RecordingError("none of them can be read", str(recordings[0]), "Copy them again")


def _refuse_for_several(**given: object) -> None:
    if named := [f"--{name}" for name, value in given.items() if value]:
        raise click.UsageError(f"{named[0]} is for one recording, these are several")


def _path(one: Path | Series) -> Path:
    return one.boxes[0].path if isinstance(one, Series) else one


def _refuse_report(recordings: tuple[Path, ...]) -> None:
    """Refuses a report name after --json, which takes no file name."""
    for path in recordings:
        if path.suffix.lower() == ".json":
            raise click.UsageError(f"'{path}' is not a recording; --json prints the report: --json > {path}")


def _refuse_absent(recordings: tuple[Path, ...]) -> None:
    """Refuses a missing file before any option is required that only another kind of recording needs."""
    for path in recordings:
        if not is_there(path):
            beside = (
                [one.name for one in path.parent.iterdir() if one.suffix.lower() in (*SUFFIXES, *FILM_SUFFIXES)]
                if path.parent.is_dir()
                else []
            )
            alike = [name for name in beside if suggested(_stem(path.name), [_stem(name)])]  # not by its suffix alone
            meant = [str(path.with_name(name)) for name in suggested(path.name, alike)]
            remedy = did_you_mean(meant) or "Check its name and its folder"
            raise RecordingError("cannot be read: No such file or directory", str(path), remedy)


def _stem(name: str) -> str:
    """Returns the name without its suffixes, such as .igs.mha."""
    return name.partition(".")[0]


def _parts(one: Path | Series) -> tuple[Path, ...]:
    return tuple(box.path for box in one.boxes) if isinstance(one, Series) else ()


def _print_several(tasks: list[ArchiveTask], jobs: int) -> list[dict[str, str]]:
    rows: list[dict[str, str]] = []
    with progress_bar("replay {task.completed:.0f} of {task.total:.0f}") as progress:
        bar = progress.add_task("replay", total=len(tasks))
        done = results(ArchiveTask.rows, tasks, jobs, None) if jobs > 1 else (task.rows() for task in tasks)
        for found_rows in done:
            rows += found_rows
            progress.advance(bar)
    rows.sort(key=lambda row: row["recording"])
    Console(file=sys.stdout, highlight=False).print(archive_table(rows), crop=False)
    return rows


def _judging(config_path: Path) -> Judging:
    config = load_config(config_path)
    return Judging(config.limits, config.supervisor.durations(), config.supervisor.timeouts())


def _progress(total: int | None) -> Callable[[Iterable[_Item]], Iterator[_Item]]:
    """Returns a function that shows a progress bar over items; `total` is None where their number is not known."""
    console = Console(stderr=True)

    def shown(items: Iterable[_Item]) -> Iterator[_Item]:
        if not console.is_terminal:
            return iter(items)
        return iter(track(items, "replay", total, transient=True, console=console))

    return shown
