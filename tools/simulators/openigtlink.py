"""Runs `probewatch simulate openigtlink`: a simulated OpenIGTLink server, for `igtl://host:port`."""

import json
import time
from contextlib import suppress
from pathlib import Path

import click
import cv2

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.registry import check_options, open_tracker, open_video
from probewatch.drivers.twins.fault_control import FaultControl, parse_fault
from probewatch.drivers.twins.faults import Schedule
from probewatch.drivers.twins.openigtlink import FAULTS, IMAGE_NAME, IgtlTwin, Opener
from probewatch.drivers.twins.scene.world import World
from probewatch.drivers.twins.world_sources import WorldTracker, WorldVideo
from probewatch.tools.shared.termination import termination
from probewatch.tools.simulators.options import CONTROL, FAULTS_AT, ORIGIN, PROGRAM, RATE, SEED


# Bounds: those of the other simulators.
@click.command("openigtlink", epilog=f"Faults: {', '.join(FAULTS)}")
@click.option("--tcp", "port", type=click.IntRange(0, 65535), required=True, metavar="PORT", help="0: any free one")
@click.option("--host", default="127.0.0.1", help="address to listen at [127.0.0.1]")
@click.option(
    "--video", "video_url", metavar="URL", help="forward the pictures of this source instead of simulated ones"
)
@click.option(
    "--tracker", "tracker_url", metavar="URL", help="forward the poses of this tracker instead of simulated ones"
)
@SEED
@PROGRAM
@FAULTS_AT
@CONTROL
@RATE
@ORIGIN
def command(
    port: int,
    host: str,
    video_url: str | None,
    tracker_url: str | None,
    seed: int,
    program: str,
    faults: tuple[str, ...],
    control: Path | None,
    rate: float,
    origin_ns: int | None,
) -> None:
    """Simulate an OpenIGTLink server until SIGTERM; prints one JSON line with its URL when it is ready.

    It stands where PLUS would: --video and --tracker name devices, real or simulated, whose pictures and poses it hands
    on. Without them it shows the simulated world.

    \b
    Example:
      probewatch simulate openigtlink --tcp 18944
    """
    stop = termination()
    cv2.setNumThreads(1)
    clock = HostClock(rate, time.monotonic_ns() if origin_ns is None else origin_ns)
    sources = (
        _video(video_url, World(seed, program), clock),
        _tracker(tracker_url, World(seed, program), clock),
    )
    given = FaultControl(FAULTS, Schedule(tuple(parse_fault(text, FAULTS) for text in faults)), control)
    # No traceback when the parent no longer reads the events.
    with suppress(BrokenPipeError), IgtlTwin((host, port), clock, sources, given) as twin:
        place = "{}:{}".format(*twin.address)
        click.echo(json.dumps({"ready": True, "url": f"igtl://{place}?image={IMAGE_NAME}&probe=Probe&simulated=yes"}))
        twin.run(stop)


def _video(url: str | None, world: World, clock: HostClock) -> Opener:
    if url is None:
        world.frame(0.0, 0)
        return lambda: WorldVideo(world, clock)
    check_options(url, "video")
    return lambda: open_video(url, clock)


def _tracker(url: str | None, world: World, clock: HostClock) -> Opener:
    if url is None:
        return lambda: WorldTracker(world, clock)
    check_options(url, "tracker")
    return lambda: open_tracker(url, clock)
