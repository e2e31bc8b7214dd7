"""`probewatch openigtlink`: sends the service's data to OpenIGTLink clients."""

import ipaddress
from pathlib import Path

import click

from probewatch.tools.openigtlink.asked import USUAL_NAMES, Names
from probewatch.tools.openigtlink.passage import Passage
from probewatch.tools.openigtlink.server import StateServer
from probewatch.tools.openigtlink.wording import NAMES
from probewatch.tools.shared.absent_service import warn_if_absent
from probewatch.tools.shared.called_host import endpoint_text
from probewatch.tools.shared.named_cart import socket_option
from probewatch.tools.shared.status_watch import StatusWatch
from probewatch.tools.shared.termination import termination

_PORT = 18944
"""TCP port of OpenIGTLink, by its specification."""


_LONGEST_NAME = 20  # bytes of a device name, by the specification


def _name(_context: click.Context, _option: click.Parameter, text: str) -> str:
    if not (text.isascii() and text.isprintable() and 0 < len(text) <= _LONGEST_NAME):
        raise click.BadParameter(f"a device name has 1 to {_LONGEST_NAME} signs of ASCII")
    if text in NAMES:
        raise click.BadParameter(f"'{text}' is taken: so are {', '.join(NAMES)}")
    return text


# Bounds of --every: the tick of the service, and the longest interval that a person would still call live.
@click.command("openigtlink")
@socket_option
@click.option("--host", default="127.0.0.1", show_default=True, help="address to listen at; 0.0.0.0 for every network")
@click.option("--port", default=_PORT, show_default=True, type=click.IntRange(0, 65535), help="0: any free one")
@click.option("--every", "every_s", default=0.1, show_default=True, type=click.FloatRange(0.05, 10), help="seconds")
@click.option("--feed", type=click.Path(path_type=Path), help="socket of the feed [beside the control socket]")
@click.option(
    "--image", default=USUAL_NAMES.image, show_default=True, callback=_name, help="device name of the pictures"
)
@click.option("--pose", default=USUAL_NAMES.pose, show_default=True, callback=_name, help="device name of the poses")
@click.option("--stream", is_flag=True, help="pictures and poses to every client, also if it has not asked for them")
def command(
    control_socket: Path,
    host: str,
    port: int,
    every_s: float,
    feed: Path | None,
    image: str,
    pose: str,
    stream: bool,
) -> None:
    """Tell OpenIGTLink clients, such as 3D Slicer and PLUS, what the service sees; until SIGTERM.

    A process beside the service, which reads its status and its feed. It sends no requests, and the user of its unit
    is refused all of them. Each client gets STATUS of the device Probewatch in every round, and once a second and at
    every change STRING of ProbewatchState (JSON), TRANSFORM ImageToProbe, the calibration in force, and
    ImageToProbeEstimate, as motion shows it. STATUS has code 1, OK, only while the contact is closed.

    Pictures and poses go to who asks: STT_IMAGE and STT_TRANS for all until STP_IMAGE and STP_TRANS, GET_IMAGE and
    GET_TRANS for the next one; or to everybody, with --stream.

    \b
    Answered as well: GET_STATUS, GET_STRING, GET_CAPABIL, and PLUS's commands GetStatus, GetTransform and
    RequestDeviceIds. Everything else is refused, in words. docs/connect.md shows it in 3D Slicer.

    \b
    Examples:
      probewatch openigtlink
      probewatch openigtlink --config cart.toml --stream
    """
    if image == pose:
        raise click.UsageError(f"--image and --pose are both '{image}': give each a name of its own")
    stop = termination()

    def say(text: str) -> None:
        click.echo(f"probewatch: {text}", err=True)

    with (
        StatusWatch(control_socket, every_s) as watch,
        Passage(feed or control_socket.with_name("feed"), lambda text: click.echo(text, err=True)) as passage,
        StateServer((host, port), watch, every_s, passage, Names(image, pose), stream, say) as server,
    ):
        click.echo(f"listening at {endpoint_text(*server.address)}")
        if not _is_loopback(host):
            words = "anyone who reaches this address can read the state: OpenIGTLink has no password"
            click.echo(f"probewatch: {words}", err=True)
        warn_if_absent(control_socket)
        server.run(stop)


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
