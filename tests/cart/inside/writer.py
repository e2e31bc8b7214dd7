"""Writes as the service and its tools do, as fast as the disk allows: `writer.py FOLDER PORT`.

After each entry of the alarm log its number goes out on the serial port, when the log says that it is on the disk;
after every fifth the calibration is replaced by the other one.
"""

import os
import sys
import time
from datetime import UTC, datetime
from itertools import cycle
from pathlib import Path

import numpy as np

from probewatch.appliance.storage.alarm_chain import Latch
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.appliance.storage.calibration_file import write_calibration
from probewatch.appliance.storage.image_to_probe import calibration_from_image_to_probe


def main(folder: Path, port: str) -> None:
    acknowledge = os.open(port, os.O_WRONLY | os.O_NOCTTY)
    log = AlarmLog(folder)
    matrix = np.diag([0.1, 0.1, 0.1, 1.0])
    calibrations = cycle(
        (name, calibration_from_image_to_probe(matrix @ np.diag([scale, scale, scale, 1.0]), (640, 480)))
        for name, scale in (("first", 1.0), ("second", 1.1))
    )
    while True:
        latch = Latch("halt", "polarity") if log.number % 2 else None
        log.append(datetime.now(UTC), time.monotonic_ns(), "state", {"state": "halt", "ballast": "x" * 500}, latch)
        os.write(acknowledge, b"%d\n" % log.number)
        if log.number % 5 == 0:
            name, calibration = next(calibrations)
            write_calibration(folder / "calibration.toml", calibration, {"name": name})


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
