"""Decides whether a reported pose may be trusted: maps port status, system status and alerts to status and reason."""

from probewatch.drivers.samples import PoseStatus
from probewatch.drivers.trackers.ndi.bx2 import Tool6D
from probewatch.drivers.trackers.ndi.replies import HandleState, ToolReply
from probewatch.drivers.trackers.ndi.status_text import HARMLESS_ALERTS, alert_text

SYSTEM_ALERTS_PENDING = 0x0100
SYSTEM_PORTS_CHANGED = 0x00C0
SYSTEM_TEMPERATURE = 0x0200
"""Combined API, system status of TX and BX: bit 8; bits 6 and 7, a port newly occupied or unoccupied; bit 9."""

_PORT_OCCUPIED, _PORT_READY = 0x01, 0x30
_PORT_OUTSIDE, _PORT_PARTLY_OUTSIDE = 0x40, 0x80
_PORT_FAULTS = {
    0x0100: "the tool's algorithm limit was reached or its sensor is broken",
    0x0200: "infrared interference or field disturbance",
    0x0400: "the sensor signal is too small",
    0x0800: "the sensor signal is too large",
    0x1000: "processing exception in the tracker",
    0x2000: "port hardware failure",
    0x4000: "the tracker fell behind",
    0x8000: "the tracker's data buffer is full",
}
"""Combined API, port status of TX and BX. Ready is bits 4 and 5, initialised and enabled. Bits 8 and 9 have one meaning
on a Polaris and another on an Aurora, hence one phrase names both; 10, 11 and 13 exist on the Aurora alone.
"""

_SYSTEM_FAULTS = {
    0x0001: "communication synchronisation error",
    0x0002: "too much infrared light",
    0x0004: "check sum error inside the tracker",
    0x0008: "processing exception in the tracker",
    0x0010: "hardware failure of the tracker",
    0x0020: "the tracker's hardware changed",
    SYSTEM_TEMPERATURE: "the tracker is outside its temperature range",
    0x0400: "the tracker's hardware configuration changed",
}
"""Combined API, system status of TX and BX. Bits 1, 2, 4 and 5 are set by old firmware alone."""

StatusReason = tuple[PoseStatus, str]
_ABSENT = {
    HandleState.MISSING: (PoseStatus.MISSING, "the tracker does not see the tool"),
    HandleState.DISABLED: (PoseStatus.DISABLED, "the tool's port is disabled"),
    HandleState.UNOCCUPIED: (PoseStatus.DISABLED, "the tool is unplugged"),
}


_CODES_6D = {
    0: (PoseStatus.OK, ""),
    3: (PoseStatus.PARTIAL, "the tool is partly outside the measurement volume"),
    5: (PoseStatus.FAULT, "the average lacks measurements"),
    9: (PoseStatus.OUT_OF_VOLUME, "the tool is outside the measurement volume"),
    13: (PoseStatus.MISSING, "the tracker sees too few markers"),
    14: (PoseStatus.FAULT, "infrared interference or field disturbance"),
    17: (PoseStatus.FAULT, "the markers do not fit the tool's definition"),
    18: (PoseStatus.FAULT, "the tracker's data buffer is full"),
    19: (PoseStatus.FAULT, "the tool's algorithm limit was reached"),
    20: (PoseStatus.FAULT, "the tracker fell behind"),
    21: (PoseStatus.FAULT, "the position sensors are out of step"),
    22: (PoseStatus.FAULT, "processing exception in the tracker"),
    31: (PoseStatus.MISSING, "the tracker does not see the tool"),
    32: (PoseStatus.DISABLED, "the tool's port is not enabled"),
    33: (PoseStatus.DISABLED, "the tool is unplugged"),
}
"""Combined API, 6D items of BX2: low byte of the status. With 3 and 9 a pose may come as well; it is not trusted."""


def status_of_6d(tool: Tool6D) -> StatusReason:
    """Returns the status of one item of BX2: the code decides whether a pose is trusted, the missing bit whether there
    is one.
    """
    unknown = (PoseStatus.NOT_UNDERSTOOD, f"the tracker gave the unknown status {tool.code}")
    status, reason = _CODES_6D.get(tool.code, unknown)
    if status is PoseStatus.OK and tool.transform is None:
        return PoseStatus.MISSING, "the tracker does not see the tool"
    return status, reason


def status_of_tool(tool: ToolReply) -> StatusReason:
    """Returns the status of one handle on its own; (OK, "") only if nothing at all speaks against its pose."""
    if tool.state in _ABSENT:
        return _ABSENT[tool.state]
    return _status_of_port(tool.port_status or 0)


def _status_of_port(status: int) -> StatusReason:
    if not status & _PORT_OCCUPIED:
        return PoseStatus.DISABLED, "the tool is unplugged"
    if status & _PORT_READY != _PORT_READY:
        return PoseStatus.DISABLED, "the tool's port is not initialised or not enabled"
    if faults := _words(_PORT_FAULTS, status):
        return PoseStatus.FAULT, faults
    if status & _PORT_OUTSIDE:
        return PoseStatus.OUT_OF_VOLUME, "the tool is outside the measurement volume"
    if status & _PORT_PARTLY_OUTSIDE:
        return PoseStatus.PARTIAL, "the tool is partly outside the measurement volume"
    return PoseStatus.OK, ""


def status_of_system(system_status: int, alerts: int) -> StatusReason:
    """Returns the status of the whole device. alerts: Info.Status.New Alerts gathered since the connection was made."""
    if serious := alerts & ~HARMLESS_ALERTS:
        return PoseStatus.FAULT, alert_text(serious)
    if faults := _words(_SYSTEM_FAULTS, system_status):
        return PoseStatus.FAULT, faults
    return PoseStatus.OK, ""


def _words(table: dict[int, str], status: int) -> str:
    return ", ".join(words for bit, words in table.items() if status & bit)
