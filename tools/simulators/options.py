"""Defines options of several simulated devices, and the motion that two of them choose."""

from collections.abc import Iterable
from pathlib import Path
from typing import Protocol

import click

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.twins.scene.tank import PlaceOfWork
from probewatch.drivers.twins.scene.trajectory import PROGRAMS, USUAL_PROGRAM
from probewatch.drivers.twins.scene.world import World
from probewatch.drivers.twins.tool_motion import PoseAt, pose_file, recorded_motion, world_motion


class Option(Protocol):
    """Adds an option to a command."""

    def __call__(self, command: click.decorators.FC, /) -> click.decorators.FC: ...


FILE = click.Path(dir_okay=False, path_type=Path)
MOTION_FILES: tuple[Option, ...] = (
    click.option(
        "--poses", type=FILE, help="CSV of t_s,tool,q0,qx,qy,qz,x_mm,y_mm,z_mm instead of the simulated motion"
    ),
    click.option("--recording", type=FILE, help="PLUS sequence whose poses replace the simulated motion"),
)
SEED: Option = click.option("--seed", type=int, default=1, help="random seed of the simulation")
PROGRAM: Option = click.option("--program", default=USUAL_PROGRAM, help=f"how the hand moves: {', '.join(PROGRAMS)}")
FAULTS_AT: Option = click.option(
    "--fault", "faults", multiple=True, metavar="NAME[@FROM[..TO]]", help="in seconds; may be repeated"
)
CONTROL: Option = click.option("--control", type=FILE, help="JSON list of faults, read again whenever it changes")
# Bounds: rates at which a machine can still serve, or a person watch.
RATE: Option = click.option(
    "--rate", type=click.FloatRange(0.01, 100), default=1.0, help="simulated seconds per second"
)
ORIGIN: Option = click.option("--origin-ns", type=int, help="CLOCK_MONOTONIC at simulated time 0; now if not given")


def with_options(options: Iterable[Option]) -> Option:
    """Returns a decorator that adds these options to a command, in this order of its help."""
    given = tuple(options)

    def add(command: click.decorators.FC, /) -> click.decorators.FC:
        for option in reversed(given):
            command = option(command)
        return command

    return add


def motion_of(poses: Path | None, recording: Path | None, world: World | PlaceOfWork) -> PoseAt:
    """Returns the motion of the file that was given, else that of the world. Raises ConfigurationError."""
    if poses is not None and recording is not None:
        raise ConfigurationError("a pose file and a recording exclude each other", "--poses, --recording", "Give one")
    if poses is not None:
        return pose_file(poses)
    return world_motion(world) if recording is None else recorded_motion(recording)
