"""A simulated scanner as a process."""

import time
from pathlib import Path

from tests.support.rigs import Rig


def _start(folder: Path) -> list[str]:
    return ["scanner", "--socket", str(folder / "video"), "--origin-ns", str(time.monotonic_ns())]


RIGS = (Rig("sim", "sim", "video", _start),)
