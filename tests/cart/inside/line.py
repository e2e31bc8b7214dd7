"""The relay line as its own side sees it, in sysfs: `line.py value`, or `line.py after SIGNAL PID SECONDS`, which sends
the signal and prints after how many milliseconds the line is low, or null when it is not within that time.
"""

import json
import os
import sys
import time
from pathlib import Path

VALUE = next(Path("/sys/devices/platform").glob("gpio-sim.*/gpiochip*/sim_gpio0/value"))


def level() -> int:
    return int(VALUE.read_text())


def after(signal: int, pid: int, seconds: float) -> float | None:
    began_s = time.monotonic()
    if pid:
        os.kill(pid, signal)
    while time.monotonic() - began_s < seconds:
        if level() == 0:
            return round((time.monotonic() - began_s) * 1e3, 1)
        time.sleep(0.001)
    return None


if __name__ == "__main__":
    if sys.argv[1] == "value":
        print(level())
    else:
        print(json.dumps(after(int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4]))))
