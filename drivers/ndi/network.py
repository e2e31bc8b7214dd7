"""`ndi+tcp://host:8765?probe=FILE.rom`: a Vega on the network; options as for drivers.ndi.tracker, but without baud."""

from drivers.errors import ConfigurationError
from drivers.hosttime import HostClock
from drivers.ndi.lines import NetworkLine
from drivers.ndi.options import TrackerOptions, parse_options
from drivers.ndi.tracker import NdiTracker, connect
from drivers.tcpline import parse_address

DEFAULT_PORT = 8765
"""TCP port at which a Vega speaks the Combined API."""


def open_tracker(target: str, options: dict[str, str], clock: HostClock) -> NdiTracker:
    """Connect, load the tools and start tracking; see drivers.ports for what is raised."""
    wanted, (host, port) = checked(target, options)
    return connect(NetworkLine(host, port, clock), f"ndi+tcp://{target}", wanted, clock)


def checked(target: str, options: dict[str, str]) -> tuple[TrackerOptions, tuple[str, int]]:
    """The options and (host, port). Raises ConfigurationError naming what cannot be."""
    url = f"ndi+tcp://{target}"
    if "baud" in options:
        raise ConfigurationError("a network has no line speed", url, "Leave baud= out")
    return parse_options(options, url), parse_address(target, DEFAULT_PORT, url)
