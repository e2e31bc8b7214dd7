"""Reads OpenIGTLink, the network protocol of PLUS and 3D Slicer: its messages, the stream that carries them, and a
server as a source of pictures and as a source of poses.

DRIVERS describes it and can be read without importing the driver (drivers/descriptor.py).
"""

from dataclasses import replace

from probewatch.drivers.descriptor import HOST, Driver, Option, Twin
from probewatch.drivers.trackers.staleness import DEADLINE, LATENCY
from probewatch.drivers.video.crop import CROP, ORIENTATION

_TOOL = "TOOL|TRANSFORM"

IGTL = Driver(
    "igtl",
    "probewatch.drivers.openigtlink.source",
    "whatever PLUS or another OpenIGTLink server drives",
    "TCP, OpenIGTLink",
    {"tracker": "igtl://host:18944?probe=Probe", "video": "igtl://host:18944?image=Image"},
    (HOST,),
    (
        Option(
            "image", "device name of the pictures; needed where the server sends several", "the only one", form="NAME"
        ),
        Option(
            "probe",
            "tool, for the transform ProbeToTracker, or for Probe where the server sends no other; or a whole name",
            "Probe",
            form=_TOOL,
        ),
        Option(
            "reference",
            "tool or transform to which poses refer, composed from both transforms of the same time",
            form=_TOOL,
        ),
        Option("witness", "tool or transform of a second marker body on the probe, of the same time", form=_TOOL),
        Option("levels", "for pixels other than 8 bits", form="BLACK,WHITE", refusal="are not two rising numbers"),
        CROP,
        ORIENTATION,
        replace(DEADLINE, help="silence after which the server is lost", default="200 poses, 500 pictures"),
        replace(LATENCY, help="known time from measurement to sending, taken off every stamp"),
        Option("ask", "for a server that sends tracking data on request only", words=("tdata", "qtdata")),
        Option("header", "1 for a server that knows no other version", "2", words=("1", "2")),
        Option(
            "simulated",
            "yes: no real device is behind it, so every text begins with SIMULATED",
            "no",
            words=("yes", "no"),
        ),
    ),
    Twin("openigtlink", "a server such as PLUS on TCP, which hands on a scanner and a tracker"),
    page="connect.md",
)
DRIVERS = (IGTL,)
