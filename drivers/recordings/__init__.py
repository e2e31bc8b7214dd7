"""Reads and writes recorded sessions, and plays a recording in place of devices.

DRIVERS, the description of that playback, is read without importing it (drivers/descriptor.py).
"""

from probewatch.drivers.descriptor import RECORDING, Driver, Option

_STARTS_S = (0, 3600)
"""Seconds: more than an hour before a recording begins is a slip of the decimal point."""

REPLAY = Driver(
    "replay",
    "probewatch.drivers.recordings.replay",
    "recordings, such as those of PLUS",
    "file",
    {"tracker": "replay:session.mha", "video": "replay:session.mha"},
    (RECORDING,),
    (
        Option(
            "orientation",
            "how pictures are stored, where the file says it wrongly",
            "by the file",
            form="MF|MN|UF|UN",
        ),
        Option(
            "poses", "the recording or table with the poses, where they are not in this one", "this one", form="FILE"
        ),
        Option("probe", "the tool on the ultrasound probe", "Probe", form="TOOL"),
        Option(
            "reference", "the tool to which poses refer; Tracker for none", "Reference if there is one", form="TOOL"
        ),
        Option("start_s", "after which the recording begins", "1", "s", _STARTS_S, refusal="is not a time"),
        Option("witness", "the tool of a second marker body on the probe", "Witness if there is one", form="TOOL"),
    ),
    is_simulated=True,
)
DRIVERS = (REPLAY,)
