"""`probewatch devices`: what is connected to this host and may be named in a URL."""

import sys
from collections.abc import Callable
from pathlib import Path

import click
from rich.console import Console

from drivers.io.inventory import ROOT, Found, gpio_chips, serial_ports, video_devices
from tools.shared.tables import FittingTable

_KINDS: dict[str, Callable[[Path], tuple[Found, ...]]] = {
    "serial port": serial_ports,
    "video": video_devices,
    "GPIO chip": gpio_chips,
}
_HEADINGS = ("kind", "path", "node", "what it is", "state")


@click.command("devices")
@click.option("--root", type=click.Path(path_type=Path, file_okay=False), default=ROOT, hidden=True)
def command(root: Path) -> None:
    """List serial ports, video devices and GPIO chips, and whether they can be opened.

    Nothing is opened for that. In a URL, write ndi:, relay: or serialpin: before a serial port, v4l2: before video,
    gpio: before a GPIO chip and ?line= after it. Trackers on the network are not searched for: try one with
    `probewatch probe URL`.

    \b
    Example:
      probewatch devices
    """
    rows = [_row(kind, found) for kind, look in _KINDS.items() for found in look(root)]
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
