"""`probewatch metrics`: serves the status for Prometheus, from a separate process."""

import sys
import threading
from contextlib import ExitStack
from pathlib import Path

import click

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import check_kind, check_replaceable, replacing
from probewatch.tools.monitoring.endpoint import Endpoint
from probewatch.tools.monitoring.reading import Exposition
from probewatch.tools.shared.absent_service import warn_if_absent
from probewatch.tools.shared.called_host import endpoint_text, host_names
from probewatch.tools.shared.listen_address import listen_address
from probewatch.tools.shared.named_cart import socket_option
from probewatch.tools.shared.termination import termination
from probewatch.tools.shared.without_effect import refuse_typed

_LISTEN = "127.0.0.1:9797"
"""Neither Prometheus' list of exporters nor Debian's packages give this port to another program, as far as known."""
_METRICS_BEGIN = b"# HELP probewatch_"
_EVERY_S = 15.0
"""Seconds between two files: the interval at which Prometheus itself asks, unless it is configured otherwise."""


@click.command()
@socket_option
@click.option("--listen", default=_LISTEN, show_default=True, help="HOST:PORT that Prometheus asks")
@click.option(
    "--host",
    "hosts",
    multiple=True,
    callback=host_names,
    help="another host name under which Prometheus reaches this computer",
)
@click.option("--no-http", is_flag=True, help="do not listen; write the file only")
@click.option(
    "--textfile",
    type=click.Path(dir_okay=False, path_type=Path),
    help="write it for node_exporter's textfile collector",
)
@click.option(
    "--every",
    "every_s",
    default=_EVERY_S,
    show_default=True,
    type=click.FloatRange(1, 3600),
    help="s between two files",
)
@click.option("--once", is_flag=True, help="print the metrics and end; exit code 69 where no service answers")
def command(
    control_socket: Path,
    listen: str,
    hosts: tuple[str, ...],
    no_http: bool,
    textfile: Path | None,
    every_s: float,
    once: bool,
) -> None:
    """Serve the status of the service as Prometheus metrics on http://127.0.0.1:9797/metrics until Ctrl-C.

    It reads the status as `probewatch status` does and asks for nothing else, so it cannot affect the contact; the user
    of its unit is refused everything else. While no service answers, probewatch_up is 0 and there is no other value.

    \b
      probewatch metrics --once | grep contact_closed
      probewatch metrics --no-http --textfile /var/lib/prometheus/node-exporter/probewatch.prom

    The file appears whole or not at all and is removed at the end. docs/monitoring.md lists the metrics, has rules for
    alerts and a dashboard, and says how Prometheus reaches a cart from elsewhere.
    """
    if once and textfile is not None:
        raise click.UsageError("--once prints and ends, and writes no --textfile. Leave one of them out")
    if once:
        refuse_typed(("--listen", "--host", "--every"), "--once")
    if no_http:
        refuse_typed(("--listen", "--host"), "--no-http")
    exposition = Exposition(control_socket)
    if once:
        text = exposition.text()
        click.echo(text.decode(), nl=False)
        sys.exit(69 if b"\nprobewatch_up 0.0\n" in text else 0)
    if no_http and textfile is None:
        raise click.UsageError("--no-http needs --textfile")
    check_kind(textfile, "metrics", ".prom")
    check_replaceable(textfile, _METRICS_BEGIN)
    _refuse_unread(textfile)
    stop = termination()
    with ExitStack() as served:
        if not no_http:
            endpoint = served.enter_context(Endpoint(*listen_address(listen, _LISTEN), exposition.text, hosts))
            host, port = str(endpoint.server_address[0]), int(endpoint.server_address[1])
            click.echo(f"http://{endpoint_text(host, port)}/metrics")
        warn_if_absent(control_socket)
        _write_until(stop, textfile, every_s, exposition)


def _refuse_unread(textfile: Path | None) -> None:
    """Raises ConfigurationError for a name that node_exporter passes over."""
    if textfile is not None and textfile.suffix != ".prom":
        remedy = f"Name it {textfile.with_suffix('.prom').name}"
        raise ConfigurationError("is never read: node_exporter reads files that end in .prom", str(textfile), remedy)


def _write_until(stop: threading.Event, textfile: Path | None, every_s: float, exposition: Exposition) -> None:
    """Writes the file until the end and removes it then: a file left by an exporter would report old values."""
    if textfile is None:
        stop.wait()
        return
    failing = False
    try:
        while not stop.is_set():
            failing = _write(textfile, exposition.text(), failing)
            stop.wait(every_s)
    finally:
        textfile.unlink(missing_ok=True)


def _write(textfile: Path, text: bytes, failing: bool) -> bool:
    """Writes the file; returns whether that failed. The failure and the recovery are reported once each."""
    try:
        with replacing(textfile) as stream:
            stream.write(text)
    except OSError as error:
        if not failing:
            click.echo(f"{textfile}: cannot be written ({error.strerror}); trying again", err=True)
        return True
    if failing:
        click.echo(f"{textfile}: is written again", err=True)
    return False
