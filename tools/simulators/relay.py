"""Runs `probewatch simulate relay`: an LCUS relay board on a pseudo-terminal, for `relay:LINK`."""

import json
import time
from pathlib import Path

import click

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.twins.pty_line import PtyLine
from probewatch.drivers.twins.relay_board import RelayBoard
from probewatch.tools.shared.termination import termination
from probewatch.tools.simulators.options import ORIGIN, RATE


# Bounds: boards of this kind have up to eight relays; those of --rate as for `simulate ndi`.
@click.command("relay")
@click.option("--pty", "link", type=click.Path(path_type=Path), required=True, metavar="LINK", help="serve it here")
@click.option("--channels", type=click.IntRange(1, 8), default=1, help="relays on the board [1]")
@click.option("--mute", is_flag=True, help="send no replies, like the bare LCUS-1")
@RATE
@ORIGIN
def command(link: Path, channels: int, mute: bool, rate: float, origin_ns: int | None) -> None:
    """Simulate a relay board until SIGTERM; prints one JSON line with its URL when ready, then each change of a relay.

    \b
      probewatch simulate relay --pty /tmp/relay
    """
    stop = termination()
    clock = HostClock(rate, time.monotonic_ns() if origin_ns is None else origin_ns)
    with PtyLine(link, clock) as line:
        board = RelayBoard(line, clock, channels, not mute)
        click.echo(json.dumps({"ready": True, "url": f"relay:{link}?channel=1"}))
        board.run(stop)
