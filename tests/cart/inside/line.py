"""A GPIO line as its own side sees it, in sysfs: `line.py after SIGNAL PID SECONDS LINE` sends the signal and prints
after how many milliseconds the line is low, or null when it is not within that time.
"""

import json
import os
import sys
import time
from pathlib import Path

BANK = next(Path("/sys/devices/platform").glob("gpio-sim.*/gpiochip*"))


def after(signal: int, pid: int, seconds: float, line: int) -> float | None:
    value, began_s = BANK / f"sim_gpio{line}/value", time.monotonic()
    os.kill(pid, signal)
    while time.monotonic() - began_s < seconds:
        if int(value.read_text()) == 0:
            return round((time.monotonic() - began_s) * 1e3, 1)
        time.sleep(0.001)
    return None


if __name__ == "__main__":
    signal, pid, seconds, line = sys.argv[2:]
    print(json.dumps(after(int(signal), int(pid), float(seconds), int(line))))
