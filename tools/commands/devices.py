"""`probewatch devices`: lists the devices connected to this host that a URL can name."""

import sys
from pathlib import Path

import click
from rich.console import Console

from drivers.io.inventory import CONNECTED, ROOT, Found
from tools.shared.driver_text import before_paths
from tools.shared.tables import FittingTable

_HEADINGS = ("kind", "path", "node", "what it is", "state")


_HELP = """List serial ports, video devices and GPIO chips, and whether they can be opened.

Nothing is opened for that. Trackers on the network are not searched for: try one with `probewatch probe URL`.

\b
What to write before the path in a URL:
{}

\b
Example:
  probewatch devices
"""


@click.command("devices", help=_HELP.format("\n".join(before_paths(CONNECTED))))
@click.option("--root", type=click.Path(path_type=Path, file_okay=False), default=ROOT, hidden=True)
def command(root: Path) -> None:
    rows = [_row(kind.name, found) for kind, look in CONNECTED.items() for found in look(root)]
    if not rows:
        click.echo("No serial port, no video device and no GPIO chip is connected.")
    elif sys.stdout.isatty():
        _print_table(rows)
    else:
        for row in (_HEADINGS, *rows):
            click.echo("\t".join(row))


def _row(kind: str, found: Found) -> tuple[str, ...]:
    return kind, found.path, found.node, found.title, found.obstacle or "free"


def _print_table(rows: list[tuple[str, ...]]) -> None:
    styles = ["" if row[-1] == "free" else "yellow" for row in rows]
    Console(highlight=False).print(FittingTable(_HEADINGS, rows, styles), crop=False)
