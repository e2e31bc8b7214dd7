"""`probewatch simulate`: simulates devices with their own protocols; each is a file `tools/simulators/<name>.py`."""

import click

from probewatch.drivers.registry import drivers
from probewatch.tools.shared.lazy_group import LazyGroup

_DEVICES = {
    "cart": "scanner, tracker and relay board together, and the configuration that fits them",
    "log": "an NDI tracker as it answered in a byte log",
    **{driver.twin.name: driver.twin.what for driver in drivers().values() if driver.twin is not None},
}


@click.group("simulate", cls=LazyGroup, names=_DEVICES, prefix="probewatch.tools.simulators.", heading="Devices")
def command() -> None:
    """Simulate a device at its own protocol, or a whole cart, with faults at run time."""
