"""`probewatch export`: converts a black box for other programs."""

import sys
from pathlib import Path

import click

from probewatch.appliance.storage.black_box import Series
from probewatch.drivers.errors import RecordingError
from probewatch.drivers.files.atomic_file import check_new
from probewatch.tools.shared.export import FORMS, export, missing_parts
from probewatch.tools.shared.found_recordings import BOXES, found, is_there


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--to", "form", type=click.Choice(FORMS), help="what to write [as --output ends]")
@click.option("--output", type=click.Path(path_type=Path), help="new file [name of the recording, in this folder]")
def command(recordings: tuple[Path, ...], form: str | None, output: Path | None) -> None:
    """Write RECORDINGS, the black boxes (.mcap) of one run of the recorder, in a form of other programs.

    \b
      .igs.mha, .igs.nrrd  pictures, each with the probe's pose at its own time: for 3D Slicer, PLUS and probewatch
      csv                  every pose, the verdict and the state, as a table
      mp4                  pictures with time, state, verdict and its reason under each, at a steady rate: to look at,
                           not to be judged again, for which there is .igs.mha

    \b
    Examples:
      probewatch export kept/20260102T030405-a1b2c3d4-00007.mcap --to .igs.mha
      probewatch export kept/*-a1b2c3d4-*.mcap --to mp4 --output alarm.mp4

    Pictures are written as they were recorded: text is black only where the recorder has blackened it.

    Exit code 0: written. 65: written, but a recording is damaged and what it still holds is in the new file; or nothing
    was, as they cannot be used; stderr says which. 78: the new file exists already, or cannot be written.
    """
    form = form or _form_of(output)
    ending = form if form.startswith(".") else f".{form}"
    if output is not None and not output.name.endswith(ending):
        raise click.UsageError(f"--output {output.name} does not end in {ending}")
    check_new(output)
    series, refused = _series(recordings)
    path = output
    if path is None:
        path = Path(f"{series.boxes[0].path.stem}{ending}")
        check_new(path)
    for lacking in missing_parts(series):
        click.secho(lacking, err=True, fg="yellow")
    number, left_out = export(series, form, path)
    if damage := series.damage_text:
        click.secho(f"damaged: {damage}", err=True, fg="yellow")
    if left_out:
        click.secho(f"left out: {left_out} pictures of another size than the first", err=True, fg="yellow")
    click.echo(f"written: {path}, {number} {'poses' if form == 'csv' else 'pictures'}")
    if damage or refused:
        sys.exit(RecordingError.exit_code)


def _series(recordings: tuple[Path, ...]) -> tuple[Series, list[str]]:
    """Returns the one run that they hold, and what is wrong with files that are left out. Raises RecordingError."""
    for recording in recordings:
        if not is_there(recording):
            raise RecordingError("is not there", str(recording), "Name a file that probewatch record has written")
    boxes, refused = found(recordings, BOXES)
    for what in refused:
        click.secho(what, err=True, fg="yellow")
    kept = [one for one in boxes if isinstance(one, Series)]
    if len(kept) != 1 or len(boxes) != 1:
        what = "are several recordings" if len(boxes) > 1 else "is not a black box"
        raise RecordingError(what, str(recordings[0]), "Name the .mcap files of one run of the recorder")
    return kept[0], refused


def _form_of(output: Path | None) -> str:
    """Returns the form that the suffix of the new file names. Raises click.UsageError where it names none."""
    if output is None:
        raise click.UsageError(f"Missing option '--to'. Choose from: {', '.join(FORMS)}")
    endings = {f".{one.lstrip('.')}": one for one in FORMS}
    named = next((form for ending, form in endings.items() if output.name.endswith(ending)), None)
    if named is None:
        raise click.UsageError(f"--output {output.name} has no known ending. Use one of {', '.join(endings)}")
    return named
