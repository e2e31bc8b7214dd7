"""`python -m drivers.twins.polaris --pty LINK`: a simulated Polaris on a pseudo-terminal, in the shared world."""

import argparse
import json
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Event

import numpy as np

from drivers.hosttime import HostClock
from drivers.ndi.wire import encode_text
from drivers.samples import Matrix4
from drivers.twins.combined_api import CombinedApi, PoseAt
from drivers.twins.faults import Schedule, pose_time_s, spoil_pose
from drivers.twins.ptyline import PtyLine
from drivers.twins.rom import REFERENCE, make_rom
from drivers.twins.world import World

BOOT_S = 1.0
_IDLE_S = 0.05
_BITS_PER_BYTE = 10
_REFERENCE_POSE_MM = (150.0, -40.0, -1700.0)

Spoil = Callable[[bytes], bytes]


class PolarisTwin:
    """The device on its line. device: the state machine within. spoil: changes replies to BX before they go out."""

    def __init__(
        self, line: PtyLine, clock: HostClock, pose_at: PoseAt, schedule: Schedule, track_hz: int = 60
    ) -> None:
        self.device = CombinedApi(self._measured, track_hz)
        self.spoil: Spoil = bytes
        self._line, self._clock, self._schedule, self._pose_at = line, clock, schedule, pose_at
        self._received = bytearray()
        self._deaf_until_ns = 0

    def run(self, stop: Event) -> None:
        """Serve the line until stop is set."""
        while not stop.is_set():
            data = self._line.read(_IDLE_S)
            active = self._schedule.active(self._now_s())
            self._hold("stale-tracker" in active)
            if data and "lose-tracker" not in active and self._clock.now_ns() >= self._deaf_until_ns:
                self._hear(data)

    def reset(self) -> None:
        """The device restarts, as after a power glitch or a break: deaf for a second, then RESET at 9600 baud."""
        self.device.reset()
        self._received.clear()
        boot_ns = round(BOOT_S * 1e9)
        self._line.write(encode_text("RESET"), self.device.baud, self._clock.now_ns() + boot_ns)

    def _now_s(self) -> float:
        return (self._clock.now_ns() - self._clock.origin_ns) / 1e9

    def _hold(self, stale: bool) -> None:
        if not stale:
            self.device.hold_s = None
        elif self.device.hold_s is None:
            self.device.hold_s = self._now_s()

    def _hear(self, data: bytes) -> None:
        """Bytes at another speed than the device's are noise; a NUL stands for a break."""
        if b"\0" in data:
            self.reset()
            return
        self._received += data if self._line.host_baud == self.device.baud else b"\xff" * len(data)
        while (end := self._received.find(b"\r")) >= 0:
            line = bytes(self._received[: end + 1])
            del self._received[: end + 1]
            self._answer(line)

    def _answer(self, line: bytes) -> None:
        """Reply in the time both directions take on the line; a new line speed holds from the next byte on."""
        baud = self.device.baud
        start_ns = self._clock.now_ns() + len(line) * _BITS_PER_BYTE * 1_000_000_000 // baud
        self._clock.sleep_until(start_ns)
        reply = self.device.answer(line, self._now_s())
        self._line.write(self.spoil(reply) if line.startswith(b"BX") else reply, baud, start_ns)

    def _measured(self, main_type: int, t_s: float, frame: int) -> Matrix4:
        """What the cameras make of a tool: the probe's marker body suffers the faults of the schedule."""
        if main_type == REFERENCE:
            return self._pose_at(main_type, t_s, frame)
        active = self._schedule.active(t_s)
        return spoil_pose(self._pose_at(main_type, pose_time_s(t_s, active), frame), active)


def world_poses(world: World) -> PoseAt:
    """Poses of the shared world: its probe, and a reference tool that lies still beside it."""
    still = np.eye(4)
    still[:3, 3] = _REFERENCE_POSE_MM

    def pose_at(main_type: int, t_s: float, frame: int) -> Matrix4:
        return still if main_type == REFERENCE else world.measured_pose(t_s, max(frame, 0))

    return pose_at


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="polaris twin", description=__doc__)
    parser.add_argument("--pty", type=Path, required=True, metavar="LINK", help="symbolic link to make for the host")
    parser.add_argument("--rom", type=Path, metavar="FILE", help="write a generic probe definition here first")
    parser.add_argument("--origin-ns", type=int, required=True, help="CLOCK_MONOTONIC of world time 0")
    parser.add_argument("--rate", type=float, default=1.0, help="world seconds per second")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--program", default="sweep", help="how the hand moves")
    parser.add_argument("--track-hz", type=int, choices=(60, 30, 20), default=60)
    parser.add_argument("--schedule", type=Schedule.parse, default=Schedule(), help="JSON list of faults")
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
    world = World(arguments.seed, arguments.program)
    with PtyLine(arguments.pty, clock) as line:
        twin = PolarisTwin(line, clock, world_poses(world), arguments.schedule, arguments.track_hz)
        json.dump({"ready": True, "url": f"ndi:{arguments.pty}{query}"}, sys.stdout)
        print(flush=True)
        twin.run(stop)


if __name__ == "__main__":
    main()
