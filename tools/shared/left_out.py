"""Reports what a recording's reader has left out, turned or not read, for commands without a report of their own that
counts it.
"""

import click

from probewatch.drivers.recordings.replay import Recording


def tell_left_out(recording: Recording) -> None:
    """Prints a line for each, on stderr."""
    for remark in (*recording.remarks, *recording.notes):
        click.secho(f"{recording.pictures.path.name}: {remark}", err=True, fg="yellow")
