"""`probewatch page`: serves the cart's web page, from a separate process."""

import platform
import shlex
import socket as sockets
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import click
import uvicorn

from probewatch.appliance.configuration.config import load_config
from probewatch.appliance.service.control.rights import Onlookers
from probewatch.drivers.errors import ConfigurationError, cannot_listen
from probewatch.drivers.files.atomic_file import check_writable
from probewatch.tools.page.alarm_log_watch import AlarmLogWatch
from probewatch.tools.page.asking import Asking
from probewatch.tools.page.connection import Connection
from probewatch.tools.page.pictures import Pictures
from probewatch.tools.page.server import TOKEN_COMMAND, Page, Parts
from probewatch.tools.page.token_socket import Door, invitation
from probewatch.tools.page.tokens import TOKEN_S, Tokens
from probewatch.tools.recalibration.session import ScanSession
from probewatch.tools.shared.absent_service import warn_if_absent
from probewatch.tools.shared.called_host import endpoint_text, host_names
from probewatch.tools.shared.listen_address import listen_address
from probewatch.tools.shared.named_cart import SOCKET, config_option, named_or_own
from probewatch.tools.shared.status_watch import StatusWatch
from probewatch.tools.shared.without_effect import refuse_typed

_LISTEN = "127.0.0.1:9780"
"""Debian's packages give this port to no other program, as far as known; it is near that of the metrics."""
_DOOR = Path("/run/probewatch-page/door")
_EVERY_S = 0.2
"""Seconds between two requests to the service while the page has a viewer: four of its ticks."""
_LONGEST_HEADERS = 16_384
"""Bytes of HTTP headers at most: browsers send some 1000."""

_SERVING_ALONE = ("--socket", "--feed", "--listen", "--host", "--cart", "--folder")


def _name() -> str:
    return platform.node() or "cart"


@click.command()
@config_option
@click.option("--socket", "control", type=click.Path(path_type=Path), help="control socket [of the configuration]")
@click.option("--feed", type=click.Path(path_type=Path), help="socket of the feed [beside the control socket]")
@click.option("--listen", default=_LISTEN, show_default=True, help="HOST:PORT; port 0 takes a free one")
@click.option(
    "--host",
    "hosts",
    multiple=True,
    callback=host_names,
    help="another host name under which browsers reach this computer",
)
@click.option("--cart", default=_name, help="name of this cart on the page; the host's name unless given")
@click.option("--folder", type=click.Path(file_okay=False, path_type=Path), help="for new calibrations [.]")
@click.option("--door", type=click.Path(path_type=Path), help=f"socket on which --token asks the page [{_DOOR}]")
@click.option("--token", "ask", is_flag=True, help="print the URL and a one-time token of the running page, and end")
def command(
    config_file: Path | None,
    control: Path | None,
    feed: Path | None,
    listen: str,
    hosts: tuple[str, ...],
    cart: str,
    folder: Path | None,
    door: Path | None,
    ask: bool,
) -> None:
    """Serve the cart's web page on http://127.0.0.1:9780 until Ctrl-C: what the service sees, for the whole room.

    Looking needs no token. Recalibrating, acknowledging, silence and the lamp test do: whoever may send requests to the
    service can ask for a one-time token, which lets one browser do that for twelve hours.

    \b
      probewatch page --token                                # the page of the package; then type it into the page
      probewatch page --config cart.toml --door page-door    # a page of your own, started by hand
      probewatch page --token --door page-door               # a token of that one

    The page asks the service and its feed as any client may, so it cannot affect the alarm. It loads nothing from
    elsewhere. docs/page.md has pictures of it; docs/security.md says what listens.
    """
    if ask:
        refuse_typed(_SERVING_ALONE, "--token, which asks a page that runs")
        token, url = invitation(door or _DOOR)
        click.echo(f"{url}recalibrate\ntoken: {token}   (once, within {TOKEN_S / 60:.0f} minutes)")
        return
    named = named_or_own(config_file, control)
    config = None if named is None else load_config(named)
    if control is None:
        control = SOCKET if config is None else config.control.socket
    if feed is None:
        feed = (None if config is None else config.feed_socket) or control.with_name("feed")
    host, port = listen_address(listen, _LISTEN)
    tokens = Tokens()
    with ExitStack() as running:
        listener = running.enter_context(_listening(host, port))
        url = _url(host, listener.getsockname()[1])
        watch = running.enter_context(StatusWatch(control, _EVERY_S))
        session = running.enter_context(ScanSession(control, feed, (folder or Path()).absolute(), watch))
        pictures = running.enter_context(Pictures(feed))
        alarms = AlarmLogWatch(None if config is None else config.alarm.folder)

        def invite(name: str) -> tuple[str, str]:
            return tokens.issue(name, time.monotonic()), url

        served = door or (_DOOR if _DOOR.parent.is_dir() else None)
        if served is not None:
            onlookers = frozenset[int]() if config is None else Onlookers.of(config).refused
            running.enter_context(Door(served, "", invite, onlookers))
        if sys.stdout.isatty():
            click.echo(f"{url}   token: {invite('whoever started it')[0]}")
        else:
            click.echo(url)
        click.echo(_how_to_ask(served), err=True)
        warn_if_absent(control)
        _warn_if_useless(folder)
        parts = Parts(
            watch,
            pictures,
            session,
            alarms,
            Asking(control),
            tokens,
            cart,
            _called(host, hosts),
            _token_command(served),
        )
        _serve(Page(parts), listener)


def _warn_if_useless(folder: Path | None) -> None:
    """Warns at the start why each scan would be refused; the page serves the status all the same."""
    try:
        check_writable(None if folder is None else folder / "calibration")
    except ConfigurationError as error:
        click.echo(f"--folder {folder}: no scan can begin here: {error.advice}", err=True)


def _serve(page: Page, listener: sockets.socket) -> None:
    """Serves until SIGTERM or Ctrl-C."""
    config = uvicorn.Config(
        page.app,
        http=Connection,
        log_level="warning",
        access_log=False,
        server_header=False,
        lifespan="off",
        ws="none",
        h11_max_incomplete_event_size=_LONGEST_HEADERS,
        timeout_graceful_shutdown=1,
    )
    uvicorn.Server(config).run(sockets=[listener])


def _token_command(door: Path | None) -> str:
    """Returns what a person types, in any folder, for a token of the running page."""
    if door == _DOOR:
        return TOKEN_COMMAND
    return f"{TOKEN_COMMAND} --door {'FILE' if door is None else shlex.quote(str(door.absolute()))}"


def _how_to_ask(door: Path | None) -> str:
    """Returns how to get a token of the running page. `door` is its socket for that, None where it has none."""
    if door is None:
        what = "this page cannot be asked for a token later: start it with --door FILE, such as --door page-door"
        return f"{what}; then: probewatch page --token --door FILE"
    return f"a token: probewatch page --token{'' if door == _DOOR else f' --door {door}'}"


def _called(host: str, others: tuple[str, ...]) -> frozenset[str]:
    """Returns the names by which browsers may ask for the page, in lower case as `called` gives them."""
    usual = {"localhost", "127.0.0.1", "::1"} if host in ("127.0.0.1", "::1", "localhost") else {host}
    return frozenset(name.lower() for name in (*usual, *others))


def _url(host: str, port: int) -> str:
    return f"http://{endpoint_text(host, port)}/"


def _listening(host: str, port: int) -> sockets.socket:
    try:
        return sockets.create_server((host, port), family=sockets.AF_INET6 if ":" in host else sockets.AF_INET)
    except (OSError, OverflowError, UnicodeError) as error:
        raise cannot_listen(error, f"--listen {host}:{port}", "Choose another address") from None
