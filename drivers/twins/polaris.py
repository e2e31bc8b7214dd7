"""`python -m drivers.twins.polaris --pty LINK`: a simulated Polaris on a pseudo-terminal, in the shared world."""

import argparse
import json
import signal
import sys
from pathlib import Path
from threading import Event

from drivers.hosttime import HostClock
from drivers.twins.combined_api import CombinedApi
from drivers.twins.control import FaultControl
from drivers.twins.models import SPECTRA
from drivers.twins.motion import world_motion
from drivers.twins.ndi import NDI_FAULTS, NdiTwin
from drivers.twins.ptyline import PtyLine
from drivers.twins.rom import make_rom
from drivers.twins.world import World


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="polaris twin", description=__doc__)
    parser.add_argument("--pty", type=Path, required=True, metavar="LINK", help="symbolic link to make for the host")
    parser.add_argument("--rom", type=Path, metavar="FILE", help="write a generic probe definition here first")
    parser.add_argument("--origin-ns", type=int, required=True, help="CLOCK_MONOTONIC of world time 0")
    parser.add_argument("--rate", type=float, default=1.0, help="world seconds per second")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--program", default="sweep", help="how the hand moves")
    parser.add_argument("--track-hz", type=int, choices=SPECTRA.track_hz, default=SPECTRA.track_hz[0])
    parser.add_argument("--control", type=Path, metavar="FILE", help="faults, read again whenever it changes")
    return parser.parse_args()


def main() -> None:
    """Serve until SIGTERM or SIGINT."""
    arguments = _arguments()
    stop = Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    clock = HostClock(arguments.rate, arguments.origin_ns)
    query = ""
    if arguments.rom:
        arguments.rom.write_bytes(make_rom())
        query = f"?probe={arguments.rom}"
    pose_at = world_motion(World(arguments.seed, arguments.program))
    device = CombinedApi(pose_at, SPECTRA, arguments.track_hz)
    with PtyLine(arguments.pty, clock) as line:
        twin = NdiTwin(line, clock, device, FaultControl(NDI_FAULTS, file=arguments.control))
        json.dump({"ready": True, "url": f"ndi:{arguments.pty}{query}"}, sys.stdout)
        print(flush=True)
        twin.run(stop)


if __name__ == "__main__":
    main()
