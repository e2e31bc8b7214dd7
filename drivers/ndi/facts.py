"""What is known of an NDI tracker besides the poses of the probe, typed, for checks and for a technician."""

from dataclasses import dataclass

from drivers.marker_geometry import MarkerGeometry, Points, in_order, marker_geometry
from drivers.ndi.health import Health
from drivers.ndi.identity import Identity, ReplyKind
from drivers.ndi.readings import MarkerReading, Reading
from drivers.ndi.tools import Tool
from drivers.ports import Description
from drivers.samples import Matrix4, PoseStatus


@dataclass(frozen=True, slots=True, eq=False)
class ToolFacts:
    """The last that was heard of one tool.

    matrix: (4, 4) tool → tracker, mm, None unless status is OK. error: marker fit RMS, mm, or indicator value; None
    without a pose. geometry: markers against the definition, None where either is not known.
    """

    tool: Tool
    frame: int | None = None
    status: PoseStatus = PoseStatus.MISSING
    reason: str = "nothing heard of it yet"
    matrix: Matrix4 | None = None
    error: float | None = None
    geometry: MarkerGeometry | None = None
    markers_outside: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class NdiFacts:
    """tools: the probe first, then the reference if there is one, then all others of the device.

    refused: replies dropped as damaged or old. doubted: poses that had to be confirmed. warnings: said while starting.
    """

    identity: Identity
    reply: ReplyKind
    health: Health
    tools: tuple[ToolFacts, ...]
    period_ms: float
    refused: int
    doubted: int
    clock_restarts: int
    warnings: tuple[str, ...]


def describe(facts: NdiFacts) -> Description:
    """The facts in words; see drivers.ports.Identified."""
    identity = facts.identity
    counted = ((facts.refused, "damaged replies refused"), (facts.doubted, "poses that had to be confirmed"))
    return Description(
        model=identity.title or "NDI tracker",
        firmware=f"{identity.freeze_tag or 'unknown'}, answers {facts.reply.name}",
        serial_number=identity.serial_number,
        tools=tuple(_tool_words(tool) for tool in facts.tools),
        rate_hz=1e3 / facts.period_ms,
        remarks=(
            *facts.warnings,
            *filter(None, [facts.health.warnings]),
            *(f"{words}: {number}" for number, words in counted if number),
        ),
    )


def _tool_words(facts: ToolFacts) -> str:
    """Name and state, and how far the markers are from their definition."""
    state = f"{facts.status.value}{f' ({facts.reason})' if facts.reason else ''}"
    if facts.geometry is None:
        return f"{facts.tool.name}: {state}"
    wrong = ", BENT" if facts.geometry.bent else ""
    if facts.geometry.loose is not None:
        wrong = f", marker {chr(ord('A') + facts.geometry.loose)} LOOSE by {facts.geometry.loose_mm:.2f} mm"
    return f"{facts.tool.name}: {state}, markers within {facts.geometry.worst_mm:.2f} mm of the definition{wrong}"


def tool_facts(tool: Tool, reading: Reading | None, detailed: Reading | None) -> ToolFacts:
    """reading: the last one. detailed: the last one with markers."""
    if reading is None:
        return ToolFacts(tool)
    status, reason = reading.judgement
    transform = reading.transform
    markers = None if detailed is None else detailed.markers
    return ToolFacts(
        tool=tool,
        frame=reading.frame,
        status=status,
        reason=reason,
        matrix=transform.matrix() if transform is not None and status is PoseStatus.OK else None,
        error=None if transform is None else transform.error,
        geometry=None if detailed is None or markers is None else _geometry(tool, detailed, markers),
        markers_outside=0 if markers is None else markers.outside,
    )


def _geometry(tool: Tool, reading: Reading, markers: MarkerReading) -> MarkerGeometry | None:
    if tool.definition is None or len(tool.definition.markers_mm) == 0:
        return None
    definition = tool.definition.markers_mm
    measured = _numbered(markers, definition, reading)
    return None if measured is None else marker_geometry(measured, definition)


def _numbered(markers: MarkerReading, definition: Points, reading: Reading) -> Points | None:
    """Positions in the order of the definition, as the tracker numbers them or else by their places."""
    if markers.ordered:
        return markers.positions_mm[: len(definition)]
    if reading.transform is None or len(markers.positions_mm) == 0:
        return None
    return in_order(markers.positions_mm, definition, reading.transform.matrix())
