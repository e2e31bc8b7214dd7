"""Runs `probewatch simulate ndi`: a simulated Polaris, Vega or Aurora."""

import json
import time
from dataclasses import replace
from pathlib import Path

import click

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.twins.fault_control import FaultControl, parse_fault
from probewatch.drivers.twins.faults import Schedule
from probewatch.drivers.twins.ndi.combined_api import CombinedApi
from probewatch.drivers.twins.ndi.models import MODELS, Model
from probewatch.drivers.twins.ndi.port_handles import WIRED_TOOLS
from probewatch.drivers.twins.ndi.tool_definitions import PROBE, REFERENCE, make_rom
from probewatch.drivers.twins.ndi.tracker import NDI_FAULTS, NdiTwin
from probewatch.drivers.twins.pty_line import PtyLine, TwinLine
from probewatch.drivers.twins.scene.tank import PlaceOfWork
from probewatch.drivers.twins.scene.world import World
from probewatch.drivers.twins.tcp_line import TcpLine
from probewatch.tools.shared.termination import termination
from probewatch.tools.simulators.options import (
    CONTROL,
    FAULTS_AT,
    FILE,
    MOTION_FILES,
    ORIGIN,
    PROGRAM,
    RATE,
    SEED,
    Option,
    motion_of,
    with_options,
)

# The bounds of a port number are TCP's.
_LINES: list[Option] = [
    click.option(
        "--pty", "link", type=click.Path(path_type=Path), metavar="LINK", help="path of the pseudo-terminal to serve"
    ),
    click.option(
        "--tcp", "port", type=click.IntRange(0, 65535), metavar="PORT", help="TCP port to serve; 0: any free one"
    ),
]
# Bounds: clocks of devices are off by tens of ppm.
_OPTIONS: list[Option] = [
    click.option("--model", "model_name", type=click.Choice(sorted(MODELS)), required=True),
    click.option("--track-hz", type=int, help="measurements per second; the model's usual rate if not given"),
    click.option("--wired", type=click.Choice(WIRED_TOOLS), multiple=True, help="tool on a cable; may be repeated"),
    click.option("--rom", type=FILE, help="write the tool definition of a generic probe to this file"),
    click.option("--reference-rom", type=FILE, help="write the tool definition of a generic reference to this file"),
    click.option(
        "--witness-rom", type=FILE, help="write the tool definition of a second body on the probe to this file"
    ),
    *MOTION_FILES,
    SEED,
    PROGRAM,
    click.option("--tank", type=FILE, help="over a cross-wire in water while this file exists"),
    FAULTS_AT,
    CONTROL,
    click.option("--freeze-tag", help="firmware name, such as 'AURORA Rev 009'; decides how clients ask for poses"),
    click.option(
        "--skew-ppm",
        type=click.FloatRange(-500, 500),
        default=0.0,
        help="rate of the device's clock, relative to true time",
    ),
    RATE,
    ORIGIN,
]


line_options = with_options(_LINES)
"""Options for where a simulated tracker is served: --pty as `link`, --tcp as `port`."""


@click.command("ndi", epilog=f"Faults: {', '.join(NDI_FAULTS)}")
@line_options
@with_options(_OPTIONS)
def command(
    model_name: str,
    link: Path | None,
    port: int | None,
    track_hz: int | None,
    wired: tuple[str, ...],
    rom: Path | None,
    reference_rom: Path | None,
    witness_rom: Path | None,
    poses: Path | None,
    recording: Path | None,
    seed: int,
    program: str,
    tank: Path | None,
    faults: tuple[str, ...],
    control: Path | None,
    freeze_tag: str | None,
    skew_ppm: float,
    rate: float,
    origin_ns: int | None,
) -> None:
    """Simulate an NDI tracker until SIGTERM; prints one JSON line with its URL when it is ready.

    \b
    Examples:
      probewatch simulate ndi --model polaris-spectra --pty /tmp/polaris --rom /tmp/probe.rom
      probewatch simulate ndi --model vega --tcp 8765 --rom /tmp/probe.rom --fault lose-tracker@20..30
    """
    model = _model(MODELS[model_name], freeze_tag, network=port is not None)
    _check_rate(model, track_hz)
    clock = HostClock(rate, time.monotonic_ns() if origin_ns is None else origin_ns)
    cables = wired or (("probe", "reference") if model.electromagnetic else ())
    device = CombinedApi(
        motion_of(poses, recording, PlaceOfWork(World(seed, program), tank)), model, track_hz, skew_ppm, cables
    )
    given = Schedule(tuple(parse_fault(text, NDI_FAULTS) for text in faults))
    roms = _write_roms(rom, reference_rom, witness_rom)
    stop = termination()
    with open_line(link, port, clock) as line:
        twin = NdiTwin(line, clock, device, FaultControl(NDI_FAULTS, given, control))
        click.echo(json.dumps({"ready": True, "url": url_of(line, link) + roms}))
        twin.run(stop)


def _model(model: Model, freeze_tag: str | None, network: bool) -> Model:
    return replace(model, network=network, freeze_tag=freeze_tag or model.freeze_tag)


def _check_rate(model: Model, track_hz: int | None) -> None:
    if track_hz is not None and track_hz not in model.track_hz:
        rates = ", ".join(map(str, model.track_hz))
        raise ConfigurationError(f"{model.title} does not track at {track_hz} Hz", "--track-hz", f"Use {rates}")


def _write_roms(probe: Path | None, reference: Path | None, witness: Path | None) -> str:
    """Writes the tool definitions, and returns the options that the URL of the tracker needs."""
    query = []
    for name, path, main_type in (
        ("probe", probe, PROBE),
        ("reference", reference, REFERENCE),
        ("witness", witness, PROBE),
    ):
        if path is not None:
            path.write_bytes(make_rom(main_type, second=name == "witness"))
            query.append(f"{name}={path}")
    return f"?{'&'.join(query)}" if query else ""


def open_line(link: Path | None, port: int | None, clock: HostClock) -> TwinLine:
    """Opens the line. Raises ConfigurationError unless exactly one place is given, and can be served."""
    if (link is None) == (port is None):
        raise ConfigurationError(
            "the simulated tracker needs either a pseudo-terminal or a TCP port", "--pty, --tcp", "Give one of the two"
        )
    try:
        return PtyLine(link, clock) if link is not None else TcpLine(port or 0, clock)
    except OSError as error:
        place = str(link) if link is not None else f"TCP port {port}"
        raise ConfigurationError(f"cannot serve here ({error.strerror})", place, "Choose another place") from None


def url_of(line: TwinLine, link: Path | None) -> str:
    """Returns the URL under which the tracker on this line is opened."""
    return f"ndi:{link}" if not isinstance(line, TcpLine) else f"ndi+tcp://127.0.0.1:{line.port}"
