"""`igtl://host:18944?image=Image_Reference&probe=Probe&reference=Reference`: pictures and poses of an OpenIGTLink
server, such as PLUS. One URL may name both; each source has a connection of its own.

Options: image (device name of the pictures; needed where the server sends several), probe, reference (names of tools,
`Probe` for the transform ProbeToTracker, or of transforms as the server sends them), levels=BLACK,WHITE (for pixels
other than 8 bits), crop, orientation (as for v4l2:), deadline_ms (silence after which the server counts as lost; 200
for poses, 500 for pictures), latency_ms (measurement to sending as measured on this server, 0), ask=tdata or qtdata
(for a server that sends these on request only), header=1 (for a server that knows no other), simulated=yes (the server
has no real device behind it).
"""

from drivers.clock.host_clock import HostClock
from drivers.openigtlink.options import IgtlOptions, parse_target
from drivers.openigtlink.tracker import IgtlTracker
from drivers.openigtlink.video import IgtlVideo


def open_video(target: str, options: dict[str, str], clock: HostClock) -> IgtlVideo:
    """See drivers.registry for what is raised."""
    return IgtlVideo(*checked(target, options), clock)


def open_tracker(target: str, options: dict[str, str], clock: HostClock) -> IgtlTracker:
    """See drivers.registry for what is raised."""
    return IgtlTracker(*checked(target, options), clock)


def checked(target: str, options: dict[str, str]) -> tuple[tuple[str, int], IgtlOptions]:
    """(host, port) and the options. Raises ConfigurationError naming what cannot be."""
    return parse_target(target, options)
