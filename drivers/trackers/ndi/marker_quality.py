"""Rates how well one tool can be measured: by the device's own figure, and by its markers against their definition."""

from collections.abc import Iterable

from probewatch.drivers.samples import MarkerBody
from probewatch.drivers.trackers.ndi.readings import Reading
from probewatch.drivers.trackers.ndi.telemetry import tool_telemetry
from probewatch.drivers.trackers.ndi.tools import Tool


class MarkerQuality:
    """Rates one tool. Its geometry is computed once for each reply with details."""

    def __init__(self, tool: Tool, electromagnetic: bool) -> None:
        self._tool, self._electromagnetic = tool, electromagnetic
        self._detailed: Reading | None = None
        self._shape_mm: float | None = None

    def look(self, reading: Reading | None, detailed: Reading | None) -> MarkerBody:
        """Returns the quality at present. reading: the last one of this tool. detailed: the last one with markers."""
        error = None if reading is None or reading.transform is None else reading.transform.error
        if self._electromagnetic:
            return MarkerBody(indicator=error)
        if detailed is not self._detailed:
            self._detailed = detailed
            geometry = tool_telemetry(self._tool, reading, detailed).geometry
            self._shape_mm = None if geometry is None else geometry.rms_mm
        return MarkerBody(fit_mm=error, shape_mm=self._shape_mm)


def worst(bodies: Iterable[MarkerBody]) -> MarkerBody:
    """Returns, for each figure, that of the body which does worst in it: a bent reference impairs a pose as much as a
    bent probe.
    """
    known = tuple(bodies)
    return MarkerBody(
        fit_mm=_largest(body.fit_mm for body in known),
        shape_mm=_largest(body.shape_mm for body in known),
        indicator=_largest(body.indicator for body in known),
    )


def _largest(figures: Iterable[float | None]) -> float | None:
    return max((figure for figure in figures if figure is not None), default=None)
