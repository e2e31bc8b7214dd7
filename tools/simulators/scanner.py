"""Runs `probewatch simulate scanner`: an ultrasound scanner whose video output is a socket, for `sim:SOCKET`."""

import json
import time
from contextlib import suppress
from pathlib import Path

import click
import cv2

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.twins.fault_control import FaultControl
from probewatch.drivers.twins.faults import PICTURE_FAULTS
from probewatch.drivers.twins.scanner import Scanner, VideoPlug
from probewatch.drivers.twins.scene.bedside import Bedside
from probewatch.drivers.twins.scene.surroundings import RIGID, listed
from probewatch.drivers.twins.scene.tank import PlaceOfWork
from probewatch.drivers.twins.scene.trajectory import PROGRAMS, USUAL_PROGRAM
from probewatch.drivers.twins.scene.world import SCENES, World, WorldSettings
from probewatch.tools.shared.termination import termination
from probewatch.tools.simulators.options import ORIGIN, RATE, SEED


# Bounds of --rate: those of `simulate ndi`. Those of --fps: from a slow sweep to what no scanner of the field exceeds.
@click.command("scanner", epilog=f"Faults: {', '.join(PICTURE_FAULTS)}")
@click.option("--socket", type=click.Path(path_type=Path), required=True, help="Unix socket to serve")
@click.option("--fps", type=click.FloatRange(0.1, 1000), default=30.0, help="pictures per simulated second [30]")
@SEED
@click.option(
    "--program",
    type=click.Choice(list(PROGRAMS)),
    default=USUAL_PROGRAM,
    show_default=True,
    help="how the probe is moved",
)
@click.option("--scene", type=click.Choice(list(SCENES)), default="tissue", help="what the probe scans [tissue]")
@click.option("--tissue", default=RIGID, show_default=True, help=f"what is scanned, as in a study: {listed()}")
@click.option(
    "--control", type=click.Path(dir_okay=False, path_type=Path), help="JSON list of faults, read again when it changes"
)
@click.option("--tank", type=click.Path(path_type=Path), help="over a cross-wire in water while this file exists")
@RATE
@ORIGIN
def command(
    socket: Path,
    fps: float,
    seed: int,
    program: str,
    scene: str,
    tissue: str,
    control: Path | None,
    tank: Path | None,
    rate: float,
    origin_ns: int | None,
) -> None:
    """Simulate a scanner until SIGTERM; prints one JSON line with its URL when it is ready, then what changes.

    \b
    Example:
      probewatch simulate scanner --socket /tmp/scanner
    """
    stop = termination()
    cv2.setNumThreads(1)
    world = _world(seed, program, scene, WorldSettings(fps=fps), tissue)
    world.frame(0.0, 0)
    clock = HostClock(rate, time.monotonic_ns() if origin_ns is None else origin_ns)
    # No traceback when the parent no longer reads the events.
    with suppress(BrokenPipeError), VideoPlug(socket) as plug:
        click.echo(json.dumps({"ready": True, "url": f"sim:{socket}"}))
        scanner = Scanner(PlaceOfWork(world, tank), plug, clock, FaultControl(PICTURE_FAULTS, file=control))
        scanner.run(stop)
        click.echo(json.dumps({"account": scanner.account}))


def _world(seed: int, program: str, scene: str, settings: WorldSettings, tissue: str) -> World:
    if tissue == RIGID:
        return World(seed, program, scene, settings)
    if scene != "tissue":
        raise click.BadOptionUsage("--tissue", f"--tissue is of the scene 'tissue', not '{scene}'")
    return Bedside(seed, program, settings, tissue)
