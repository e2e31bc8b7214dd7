"""Opens `igtl://host:18944?image=Image_Reference&probe=Probe&reference=Reference`: pictures and poses of an OpenIGTLink
server, such as PLUS. One URL may name both; each source has a connection of its own.

Its options are the rows of IGTL, in the `__init__.py` of this folder.
"""

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.openigtlink.options import IgtlOptions, parse_target
from probewatch.drivers.openigtlink.tracker import IgtlTracker
from probewatch.drivers.openigtlink.video import IgtlVideo


def open_video(target: str, options: dict[str, str], clock: HostClock) -> IgtlVideo:
    """Opens the source of pictures; see drivers.registry for what is raised."""
    return IgtlVideo(*checked(target, options), clock)


def open_tracker(target: str, options: dict[str, str], clock: HostClock) -> IgtlTracker:
    """Opens the source of poses; see drivers.registry for what is raised."""
    return IgtlTracker(*checked(target, options), clock)


def checked(target: str, options: dict[str, str]) -> tuple[tuple[str, int], IgtlOptions]:
    """Returns (host, port) and the options. Raises ConfigurationError that names what is invalid."""
    return parse_target(target, options)
