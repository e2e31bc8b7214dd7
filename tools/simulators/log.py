"""Runs `probewatch simulate log`: the NDI tracker of a byte log, which answers as it did when it was recorded."""

import json
from pathlib import Path

import click

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.io.byte_log import read_log
from probewatch.drivers.twins.byte_log_twin import LogTwin
from probewatch.tools.shared.termination import termination
from probewatch.tools.simulators.ndi import line_options, open_line, url_of


@click.command("log")
@click.argument("log", type=click.Path(dir_okay=False, path_type=Path))
@line_options
@click.option("--rate", type=click.FloatRange(0.1, 100), default=1.0, help="how much faster than it was recorded")
def command(log: Path, link: Path | None, port: int | None, rate: float) -> None:
    """Play the byte log LOG of an NDI tracker once, then hang up; prints one JSON line with its URL when it is ready.

    A log is recorded with log=FILE in the tracker's URL. The program that connects must load the same tools and ask as
    the one did that recorded it: what the log does not hold is not answered, and said at the end.

    \b
    Example:
      probewatch simulate log tracker.log --pty /tmp/polaris
    """
    stop = termination()
    clock = HostClock(rate)
    entries = read_log(log)
    with open_line(link, port, clock) as line:
        twin = LogTwin(line, clock, entries)
        click.echo(json.dumps({"ready": True, "url": url_of(line, link)}))
        twin.run(stop)
    for request in twin.unanswered:
        click.echo(f"not in the log: {request!r}", err=True)
