"""`probewatch simulate`: devices that exist only as bytes; each command lives in `tools/simulators/<name>.py`."""

import click

from tools.shared.lazy_group import LazyGroup

_DEVICES = {
    "cart": "scanner, tracker and relay board together, and the configuration that fits them",
    "log": "an NDI tracker as it answered in a byte log",
    "ndi": "a Polaris or Aurora on a pseudo-terminal, a Vega on TCP",
    "openigtlink": "a server such as PLUS on TCP, which hands on a scanner and a tracker",
    "optotrak": "an Optotrak behind an RTC3D server on TCP",
    "relay": "an LCUS relay board on a pseudo-terminal",
    "scanner": "a scanner's video output on a Unix socket",
}


@click.group("simulate", cls=LazyGroup, names=_DEVICES, prefix="tools.simulators.", heading="Devices")
def command() -> None:
    """Simulate a device at its own protocol, or a whole cart, with faults at run time."""
