"""`probewatch devices`: lists the devices connected to this host that a URL can name."""

import sys
from pathlib import Path

import click
from rich.console import Console

from probewatch.drivers.io.inventory import CONNECTED, ROOT, Found
from probewatch.tools.german.devices import device_text
from probewatch.tools.shared.driver_text import before_paths
from probewatch.tools.shared.named_cart import cart_language
from probewatch.tools.shared.tables import FittingTable

_HEADINGS = ("kind", "path", "node", "what it is", "state")
_FREE = "free"


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
    language = cart_language()
    rows = [_row(kind.name, found) for kind, look in CONNECTED.items() for found in look(root)]
    headings, *told = (tuple(device_text(cell, language) for cell in row) for row in (_HEADINGS, *rows))
    if not rows:
        click.echo(device_text("No serial port, no video device and no GPIO chip is connected.", language))
    elif sys.stdout.isatty():
        styles = ["" if row[-1] == _FREE else "yellow" for row in rows]
        Console(highlight=False).print(FittingTable(headings, told, styles), crop=False)
    else:
        for row in (headings, *told):
            click.echo("\t".join(row))


def _row(kind: str, found: Found) -> tuple[str, ...]:
    return kind, found.path, found.node, found.title, found.obstacle or _FREE
