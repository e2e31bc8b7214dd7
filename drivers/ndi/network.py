"""`ndi+tcp://host:8765?probe=FILE.rom`: a Vega on the network; options as for drivers.ndi.tracker, but without baud."""

from drivers.errors import ConfigurationError
from drivers.hosttime import HostClock
from drivers.ndi.lines import NetworkLine
from drivers.ndi.options import parse_options
from drivers.ndi.tracker import NdiTracker, connect
from drivers.tcpline import parse_address

DEFAULT_PORT = 8765


def open_tracker(target: str, options: dict[str, str], clock: HostClock) -> NdiTracker:
    """Connect, load the tools and start tracking; see drivers.ports for what is raised."""
    url = f"ndi+tcp://{target}"
    if "baud" in options:
        raise ConfigurationError("a network has no line speed", url, "Leave baud= out")
    wanted = parse_options(options, url)
    host, port = parse_address(target, DEFAULT_PORT, url)
    return connect(NetworkLine(host, port, clock), url, wanted, clock)
