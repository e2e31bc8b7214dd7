"""Opens `ndi+tcp://host:8765?probe=FILE.rom`, a Vega on the network. It has the options of `ndi:` except baud."""

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.io.tcp_line import parse_address
from probewatch.drivers.trackers.ndi import NDI_TCP
from probewatch.drivers.trackers.ndi.options import TrackerOptions, parse_options
from probewatch.drivers.trackers.ndi.tracker import NdiTracker, connect
from probewatch.drivers.trackers.ndi.transport import NetworkLine

DEFAULT_PORT = 8765
"""TCP port at which a Vega speaks the Combined API."""


def open_tracker(target: str, options: dict[str, str], clock: HostClock) -> NdiTracker:
    """Connects, loads the tools and starts tracking; see drivers.registry for what is raised."""
    wanted, (host, port) = checked(target, options)
    return connect(NetworkLine(host, port, clock), f"ndi+tcp://{target}", wanted, clock)


def checked(target: str, options: dict[str, str]) -> tuple[TrackerOptions, tuple[str, int]]:
    """Returns the options and (host, port). Raises ConfigurationError that names what is invalid."""
    url = f"ndi+tcp://{target}"
    if "baud" in options:
        raise ConfigurationError("a network has no line speed", url, "Leave baud= out")
    return parse_options(options, url, NDI_TCP), parse_address(target, DEFAULT_PORT, url)
