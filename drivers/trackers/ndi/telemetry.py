"""Gathers what is known about an NDI tracker besides the poses of the probe, typed, for checks and for a technician."""

from dataclasses import dataclass

from probewatch.drivers.device_api import Description
from probewatch.drivers.samples import Matrix4, PoseStatus
from probewatch.drivers.trackers.marker_geometry import MarkerGeometry, Points, in_order, marker_geometry
from probewatch.drivers.trackers.ndi.health import Health
from probewatch.drivers.trackers.ndi.identity import Identity, ReplyKind
from probewatch.drivers.trackers.ndi.readings import MarkerReading, Reading
from probewatch.drivers.trackers.ndi.tools import Tool


@dataclass(frozen=True, slots=True, eq=False)
class ToolTelemetry:
    """Holds the latest information about one tool.

    matrix: (4, 4) tool → tracker, mm, None unless status is OK. error: marker fit RMS, mm, or indicator value; None
    without a pose. geometry: markers compared with the definition, None where either is not known.
    """

    tool: Tool
    frame: int | None = None
    status: PoseStatus = PoseStatus.MISSING
    reason: str = "nothing heard of it yet"
    matrix: Matrix4 | None = None
    error: float | None = None
    geometry: MarkerGeometry | None = None


@dataclass(frozen=True, slots=True, eq=False)
class NdiTelemetry:
    """Holds the telemetry of one device. tools: the probe first, then the reference if there is one, then all others of
    the device.

    refused: count of replies dropped as damaged or old. doubted: count of poses that had to be confirmed. warnings:
    those given during the start, and that the tracker or the reference tool was moved.
    """

    identity: Identity
    reply: ReplyKind
    health: Health
    tools: tuple[ToolTelemetry, ...]
    period_ms: float
    refused: int
    doubted: int
    clock_restarts: int
    warnings: tuple[str, ...]


def describe(telemetry: NdiTelemetry) -> Description:
    """Returns the description in words; see drivers.device_api.Identified."""
    identity = telemetry.identity
    return Description(
        model=identity.title or "NDI tracker",
        firmware=f"{identity.freeze_tag or 'unknown'}, answers {telemetry.reply.name}",
        serial_number=identity.serial_number,
        tools=tuple(_tool_words(tool) for tool in telemetry.tools),
        rate_hz=1e3 / telemetry.period_ms,
        remarks=(
            *telemetry.warnings,
            *filter(None, [telemetry.health.warnings]),
            *(words.format(number) for number, words in _counted(telemetry) if number),
        ),
    )


def _counted(telemetry: NdiTelemetry) -> tuple[tuple[int, str], ...]:
    """Returns counts with their meaning for a person; the second is not 0 after any start or loss of sight."""
    return (
        (telemetry.refused, "damaged replies refused: {}; where they go on, see cable and plugs"),
        (telemetry.doubted, "poses read a second time, after a leap or a gap, and then used: {}; this is no fault"),
    )


def _tool_words(telemetry: ToolTelemetry) -> str:
    """Returns name and state of a tool, and how far its markers are from their definition."""
    state = f"{telemetry.status.value}{f' ({telemetry.reason})' if telemetry.reason else ''}"
    if telemetry.geometry is None:
        return f"{telemetry.tool.name}: {state}"
    wrong = ", BENT" if telemetry.geometry.bent else ""
    if telemetry.geometry.loose is not None:
        wrong = f", marker {chr(ord('A') + telemetry.geometry.loose)} LOOSE by {telemetry.geometry.loose_mm:.2f} mm"
    return (
        f"{telemetry.tool.name}: {state}, markers within {telemetry.geometry.worst_mm:.2f} mm of the definition{wrong}"
    )


def tool_telemetry(tool: Tool, reading: Reading | None, detailed: Reading | None) -> ToolTelemetry:
    """Returns the telemetry of one tool. reading: the last one. detailed: the last one with markers."""
    if reading is None:
        return ToolTelemetry(tool)
    status, reason = reading.status_reason
    transform = reading.transform
    markers = None if detailed is None else detailed.markers
    return ToolTelemetry(
        tool=tool,
        frame=reading.frame,
        status=status,
        reason=reason,
        matrix=transform.matrix() if transform is not None and status is PoseStatus.OK else None,
        error=None if transform is None else transform.error,
        geometry=None if detailed is None or markers is None else _geometry(tool, detailed, markers),
    )


def _geometry(tool: Tool, reading: Reading, markers: MarkerReading) -> MarkerGeometry | None:
    if tool.definition is None or len(tool.definition.markers_mm) == 0:
        return None
    definition = tool.definition.markers_mm
    measured = _numbered(markers, definition, reading)
    return None if measured is None else marker_geometry(measured, definition)


def _numbered(markers: MarkerReading, definition: Points, reading: Reading) -> Points | None:
    """Returns positions in the order of the definition, as the tracker numbers them or else by their places."""
    if markers.ordered:
        return markers.positions_mm[: len(definition)]
    if reading.transform is None or len(markers.positions_mm) == 0:
        return None
    return in_order(markers.positions_mm, definition, reading.transform.matrix())
