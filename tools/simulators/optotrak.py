"""Runs `probewatch simulate optotrak`: a simulated Optotrak behind a First Principles server."""

import time
from pathlib import Path

import click

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.twins.fault_control import FaultControl, parse_fault
from probewatch.drivers.twins.faults import Schedule
from probewatch.drivers.twins.optotrak.first_principles import Device
from probewatch.drivers.twins.optotrak.tracker import FAULTS, serve
from probewatch.drivers.twins.scene.world import World
from probewatch.tools.shared.termination import termination
from probewatch.tools.simulators.options import (
    CONTROL,
    FAULTS_AT,
    MOTION_FILES,
    ORIGIN,
    PROGRAM,
    SEED,
    Option,
    motion_of,
    with_options,
)

# Bounds: a Certus fires markers at 4600 Hz at most, and no frame is faster; the others as for `simulate ndi`.
_OPTIONS: list[Option] = [
    click.option("--tcp", "port", type=click.IntRange(0, 65535), required=True, metavar="PORT", help="0: any free one"),
    click.option("--host", default="127.0.0.1", help="address to listen at; 0.0.0.0 for every network [127.0.0.1]"),
    click.option("--frame-hz", type=click.FloatRange(1, 4600), default=100.0, help="frames per second [100]"),
    click.option("--bodies", type=click.IntRange(1, 20), default=2, help="rigid bodies: probe, reference, others [2]"),
    *MOTION_FILES,
    SEED,
    PROGRAM,
    FAULTS_AT,
    click.option("--schedule", help="JSON list of faults instead"),
    CONTROL,
    click.option(
        "--skew-ppm",
        type=click.FloatRange(-500, 500),
        default=0.0,
        help="rate of the server's clock, relative to true time",
    ),
    click.option("--rate", type=click.FloatRange(0.1, 100), default=1.0, help="simulated seconds per second"),
    ORIGIN,
]


@click.command("optotrak", epilog=f"Faults: {', '.join(FAULTS)}")
@with_options(_OPTIONS)
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
    device = Device(motion_of(poses, recording, World(seed, program)), frame_hz, bodies, skew_ppm)
    timed = Schedule.parse(schedule, FAULTS) if schedule else Schedule()
    given = Schedule((*timed.episodes, *(parse_fault(text, FAULTS) for text in faults)))
    clock = HostClock(rate, time.monotonic_ns() if origin_ns is None else origin_ns)
    serve((host, port), clock, device, FaultControl(FAULTS, given, control), termination())
