"""`probewatch openigtlink`: tells OpenIGTLink clients what the service sees."""

import ipaddress
import signal
from pathlib import Path
from threading import Event

import click

from tools.openigtlink.server import StateServer
from tools.shared.service_socket import socket_option
from tools.shared.status_watch import StatusWatch

_PORT = 18944
"""TCP port of OpenIGTLink, by its specification."""


# Bounds of --every: the tick of the service, and what a person still calls live.
@click.command("openigtlink")
@socket_option
@click.option("--host", default="127.0.0.1", show_default=True, help="address to listen at; 0.0.0.0 for every network")
@click.option("--port", default=_PORT, show_default=True, type=click.IntRange(0, 65535), help="0: any free one")
@click.option("--every", "every_s", default=0.1, show_default=True, type=click.FloatRange(0.05, 10), help="seconds")
def command(control_socket: Path, host: str, port: int, every_s: float) -> None:
    """Tell OpenIGTLink clients, such as 3D Slicer and PLUS, what the service sees; until SIGTERM.

    A process beside the service, which asks it for its status and can do nothing else. Each client gets STATUS of the
    device Probewatch in every round, and STRING of ProbewatchState (JSON) and TRANSFORM ImageToProbe, the calibration
    in force, once a second and at every change. STATUS has code 1, OK, only while the contact is closed.

    \b
    Answered: GET_STATUS, GET_STRING, GET_TRANS, GET_CAPABIL, and PLUS's commands GetStatus, GetTransform and
    RequestDeviceIds. Everything else is refused, in words. docs/connect.md shows it in 3D Slicer.
    """
    stop = Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    with StatusWatch(control_socket, every_s) as watch, StateServer((host, port), watch, every_s) as server:
        click.echo("listening at {}:{}".format(*server.address))
        if not _is_loopback(host):
            words = "whoever reaches this address may read the state, as OpenIGTLink knows no password"
            click.echo(f"probewatch: {words}", err=True)
        server.run(stop)


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
