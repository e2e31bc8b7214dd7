"""`probewatch simulate optotrak`: a simulated Optotrak behind a First Principles server."""

import time
from collections.abc import Callable
from pathlib import Path

import click

from drivers.clock.host_clock import HostClock
from drivers.errors import ConfigurationError
from drivers.twins.fault_control import FaultControl, parse_fault
from drivers.twins.faults import Schedule
from drivers.twins.optotrak.first_principles import Device
from drivers.twins.optotrak.tracker import FAULTS, serve
from drivers.twins.scene.trajectory import PROGRAMS, USUAL_PROGRAM
from drivers.twins.scene.world import World
from drivers.twins.tool_motion import PoseAt, pose_file, recorded_motion, world_motion

_FILE = click.Path(dir_okay=False, path_type=Path)
# Bounds: a Certus fires markers at 4600 Hz at most, and no frame is faster; the others as for `simulate ndi`.
_OPTIONS: list[Callable[[click.decorators.FC], click.decorators.FC]] = [
    click.option("--tcp", "port", type=click.IntRange(0, 65535), required=True, metavar="PORT", help="0: any free one"),
    click.option("--host", default="127.0.0.1", help="address to listen at; 0.0.0.0 for every network [127.0.0.1]"),
    click.option("--frame-hz", type=click.FloatRange(1, 4600), default=100.0, help="frames per second [100]"),
    click.option("--bodies", type=click.IntRange(1, 20), default=2, help="rigid bodies: probe, reference, others [2]"),
    click.option(
        "--poses", type=_FILE, help="CSV of t_s,tool,q0,qx,qy,qz,x_mm,y_mm,z_mm instead of the simulated motion"
    ),
    click.option("--recording", type=_FILE, help="PLUS sequence whose poses replace the simulated motion"),
    click.option("--seed", type=int, default=1, help="random seed of the simulation"),
    click.option("--program", default=USUAL_PROGRAM, help=f"how the hand moves: {', '.join(PROGRAMS)}"),
    click.option("--fault", "faults", multiple=True, metavar="NAME[@FROM[..TO]]", help="in seconds; may be repeated"),
    click.option("--schedule", help="JSON list of faults instead"),
    click.option("--control", type=_FILE, help="JSON list of faults, read again whenever it changes"),
    click.option(
        "--skew-ppm",
        type=click.FloatRange(-500, 500),
        default=0.0,
        help="rate of the server's clock, relative to true time",
    ),
    click.option("--rate", type=click.FloatRange(0.1, 100), default=1.0, help="simulated seconds per second"),
    click.option("--origin-ns", type=int, help="CLOCK_MONOTONIC at simulated time 0; now if not given"),
]


def _with_options(function: click.decorators.FC) -> click.decorators.FC:
    for option in reversed(_OPTIONS):
        function = option(function)
    return function


@click.command("optotrak", epilog=f"Faults: {', '.join(FAULTS)}")
@_with_options
def command(
    port: int,
    host: str,
    frame_hz: float,
    bodies: int,
    poses: Path | None,
    recording: Path | None,
    seed: int,
    program: str,
    faults: tuple[str, ...],
    schedule: str | None,
    control: Path | None,
    skew_ppm: float,
    rate: float,
    origin_ns: int | None,
) -> None:
    """Simulate an Optotrak until SIGTERM; prints one JSON line with its URL when it is ready.

    \b
    Example:
      probewatch simulate optotrak --tcp 3020
    """
    device = Device(_motion(poses, recording, seed, program), frame_hz, bodies, skew_ppm)
    timed = Schedule.parse(schedule, FAULTS) if schedule else Schedule()
    given = Schedule((*timed.episodes, *(parse_fault(text, FAULTS) for text in faults)))
    clock = HostClock(rate, time.monotonic_ns() if origin_ns is None else origin_ns)
    serve((host, port), clock, device, FaultControl(FAULTS, given, control))


def _motion(poses: Path | None, recording: Path | None, seed: int, program: str) -> PoseAt:
    if poses is not None and recording is not None:
        raise ConfigurationError("a pose file and a recording exclude each other", "--poses, --recording", "Give one")
    if poses is not None:
        return pose_file(poses)
    return world_motion(World(seed, program)) if recording is None else recorded_motion(recording)
