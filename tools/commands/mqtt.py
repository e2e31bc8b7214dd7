"""`probewatch mqtt`: publishes the state of the cart to an MQTT broker, from a separate process."""

import re
import socket
from pathlib import Path

import click

from probewatch.tools.monitoring.broker import broker_of
from probewatch.tools.monitoring.mqtt import Publisher
from probewatch.tools.monitoring.reading import read_status
from probewatch.tools.shared.absent_service import warn_if_absent
from probewatch.tools.shared.named_cart import socket_option
from probewatch.tools.shared.termination import termination

_FILE = click.Path(dir_okay=False, path_type=Path)


def _topic(_context: click.Context, option: click.Parameter, text: str | None) -> str:
    """Returns a valid topic name: one or several levels, none empty, without wildcards; the host's name where none was
    given. --discovery alone may be empty. Raises click.BadParameter.
    """
    name = socket.gethostname().partition(".")[0] if text is None else text
    if not name and option.name != "discovery":
        raise click.BadParameter("must not be empty")
    if name and not re.fullmatch(r"[\w-]+(/[\w-]+)*", name, re.ASCII):
        raise click.BadParameter("may have letters, digits, - and _")
    return name


@click.command()
@socket_option
@click.option("--broker", required=True, metavar="URL", help="mqtts://HOST[:PORT], or mqtt://HOST[:PORT] in the clear")
@click.option("--cart", callback=_topic, help="name of this cart in the topics; the host's name unless given")
@click.option("--user", help="name to log in with")
@click.option("--password-file", type=_FILE, help="its first line is the password; others may not read the file")
@click.option("--ca", type=_FILE, help="CA that signed the broker's certificate; the system's CAs unless given")
@click.option("--certificate", type=_FILE, help="client certificate of this cart, PEM")
@click.option("--key", type=_FILE, help="private key of that certificate, PEM")
@click.option("--prefix", default="probewatch", show_default=True, callback=_topic, help="first part of the topics")
@click.option(
    "--discovery",
    default="homeassistant",
    show_default=True,
    callback=_topic,
    help='discovery prefix of Home Assistant; "" for none',
)
def command(
    control_socket: Path,
    broker: str,
    cart: str,
    user: str | None,
    password_file: Path | None,
    ca: Path | None,
    certificate: Path | None,
    key: Path | None,
    prefix: str,
    discovery: str,
) -> None:
    """Publish the state of this cart to an MQTT broker until Ctrl-C.

    PREFIX/CART/state is JSON, retained, published at every change and every 15 s; PREFIX/CART/availability is online,
    or offline as soon as the broker misses this program. Home Assistant finds the cart by itself.

    It reads the status as `probewatch status` does and accepts no messages, so a broker cannot affect the
    contact. A broker that vanishes is reported once on stderr, and tried again for as long as it takes.

    \b
      probewatch mqtt --broker mqtts://broker.example --user cart-2 --password-file /etc/probewatch/mqtt-password
    """
    where = broker_of(broker, user, password_file, ca, certificate, key)
    warn_if_absent(control_socket)
    stop = termination()
    Publisher(
        where, cart, lambda: read_status(control_socket), lambda text: click.echo(text, err=True), prefix, discovery
    ).run(stop)
