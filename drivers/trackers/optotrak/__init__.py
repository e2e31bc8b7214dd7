"""Reads an Optotrak behind NDI's First Principles server: RTC3D over TCP.

DRIVERS describes it and can be read without importing the driver (drivers/descriptor.py).
"""

from probewatch.drivers.descriptor import HOST, Driver, Option, Twin
from probewatch.drivers.trackers.staleness import DEADLINE, LATENCY, LOG

_BODIES = (1, 255)
"""Numbers of rigid bodies that a URL may name, up to 255. A reply counts them in one byte."""
_RATES_HZ = (1, 4600)
"""Rates that a URL may name, Hz. A Certus fires markers at 4600 Hz at most, and no frame is faster."""

OPTOTRAK = Driver(
    "optotrak",
    "probewatch.drivers.trackers.optotrak.tracker",
    "Optotrak 3020, Certus",
    "TCP, RTC3D of First Principles",
    {"tracker": "optotrak://host:3020"},
    (HOST,),
    (
        Option(
            "body", "number of the probe's rigid body in the order in which the server lists them", "1", bounds=_BODIES
        ),
        Option(
            "reference",
            "number of the rigid body to which poses refer; without it the tracker's frame",
            bounds=_BODIES,
        ),
        Option("witness", "number of the rigid body of a second marker body on the probe", bounds=_BODIES),
        Option(
            "mode",
            "stream: the server sends; single: each frame is asked for",
            "stream",
            words=("stream", "single"),
        ),
        Option("order", "byte order of the payload; both give the same poses", "big", words=("big", "little")),
        Option(
            "rate",
            "frames per second wanted; 2 ÷ rate must lie within the deadline",
            "all frames; 60 in single mode",
            "Hz",
            _RATES_HZ,
        ),
        DEADLINE,
        LATENCY,
        LOG,
    ),
    Twin("optotrak", "an Optotrak behind an RTC3D server on TCP"),
)
DRIVERS = (OPTOTRAK,)
