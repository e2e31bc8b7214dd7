"""Reads trackers that speak Northern Digital's Combined API: Polaris, Vega and Aurora, over a serial line or TCP.

DRIVERS describes each of them and can be read without importing the drivers (drivers/descriptor.py).
"""

from dataclasses import replace

from probewatch.drivers.descriptor import HOST, SERIAL_PORT, Driver, Option, Twin
from probewatch.drivers.trackers.staleness import DEADLINE, LATENCY, LOG

_TOOL = "FILE.rom|@PLUG|FILE.rom@PLUG"
_BAUDS = ("9600", "14400", "19200", "38400", "57600", "115200", "921600", "1228739")
"""Line speeds, bits per second, from those for which the Combined API's COMM has a digit (`session.py`). Faster
shortens the reply; slower works over a longer cable. No real device was tried.
"""
_COUNTERS_HZ = (1, 5000)
"""Rates of a frame counter, Hz. They reach beyond those of any device, so that only typing errors are refused."""

NDI = Driver(
    "ndi",
    "probewatch.drivers.trackers.ndi.tracker",
    "Polaris, Aurora",
    "serial, Combined API",
    {"tracker": "ndi:/dev/ttyUSB0"},
    (SERIAL_PORT,),
    (
        Option(
            "probe",
            "FILE.rom: a wireless tool; @2: on plug 2; @2b: its second sensor; FILE.rom@2: on a plug without a memory",
            "first wired tool",
            form=_TOOL,
            question="tool definition file (.rom) of the probe's markers, or 'wired'",
            without="wired",
        ),
        Option("reference", "the tool to which all poses are relative, in the same forms", form=_TOOL),
        Option(
            "witness",
            "a second body on the probe, with a geometry or a plug of its own",
            form=_TOOL,
            question="the same of a second marker body on the probe, or 'none'",
            without="none",
        ),
        Option("tools", "further tools, separated by commas; `probewatch probe` shows their state", form="TOOL,TOOL"),
        Option(
            "baud",
            "line speed while tracking; at the end the tracker is left at 9600",
            "115200",
            words=_BAUDS,
            refusal="is not a line speed of these trackers",
        ),
        Option(
            "reply",
            "the tracking command",
            "by firmware",
            words=("bx2", "bx", "tx"),
            refusal="is not a tracking command",
        ),
        Option("counter_hz", "rate of the frame counter", "by model", "Hz", _COUNTERS_HZ),
        replace(DEADLINE, help=f"{DEADLINE.help}; longer where one reply takes more than a quarter of it"),
        replace(LATENCY, help="known delay from exposure to the first byte of the reply, taken off every stamp"),
        LOG,
    ),
    Twin("ndi", "a Polaris or Aurora on a pseudo-terminal, a Vega on TCP"),
    is_listed=True,
)
NDI_TCP = Driver(
    "ndi+tcp",
    "probewatch.drivers.trackers.ndi.network",
    "Polaris Vega",
    "TCP, Combined API",
    {"tracker": "ndi+tcp://host:8765"},
    (HOST,),
    tuple(option for option in NDI.options if option.name != "baud"),
    NDI.twin,
)
DRIVERS = (NDI, NDI_TCP)
