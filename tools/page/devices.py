"""Describes the devices in plain words: as they should be, or what is wrong with each and what to do. Pure."""

from collections.abc import Iterator, Mapping
from typing import Any

from probewatch.appliance.supervision.alarms import HAZARDS
from probewatch.appliance.supervision.fault_row import Device
from probewatch.appliance.supervision.faults import of_device
from probewatch.appliance.supervision.languages import translated
from probewatch.appliance.types import Fault, Kind

_ROLES = {Device.SCANNER: "video", Device.TRACKER: "tracker", Device.CONTACT: "output"}
"""Names of the devices in `lost` and `fps` of the status."""

Row = dict[str, Any]


def devices(status: Mapping[str, Any], language: str) -> list[Row]:
    """Returns a row for each: device, kind (good, wait, notice, bad), wrong (text and remedy of each), driver (what the
    driver reports of a lost device, in its own words), rate (samples a second, None where it has none).
    """
    checks = (*status["checks"], *status["devices"])
    found = {one["fault"]: one["verdict"] for one in checks if one["value"] is not None and one["verdict"] != "OK"}
    if status["fault"] is not None:
        found[status["fault"]] = "FAULT"
    return [_row(device, found, status, language) for device in Device]


def _row(device: Device, found: Mapping[str, str], status: Mapping[str, Any], language: str) -> Row:
    faults = [fault for fault in of_device(device) if fault in found]
    if faults and faults[0] is of_device(device)[0]:  # nothing else is known of a device that is gone
        faults = faults[:1]
    lost = list(_lost(device, status))
    rate = status["fps"].get(_ROLES.get(device, ""))
    return {
        "device": device.value,
        "kind": _kind([fault for fault in faults if found[fault] == "FAULT"], bool(faults), bool(lost)),
        "wrong": [_said(fault, language) for fault in faults],
        "driver": lost,
        "rate": None if lost else rate,
    }


def _kind(failed: list[Fault], unknown: bool, lost: bool) -> str:
    """Returns the kind of a row; an advisory is not an alarm, and does not have its colour."""
    if lost or any(fault.kind is not Kind.ADVISORY for fault in failed):
        return "bad"
    return "notice" if failed else "wait" if unknown else "good"


def _said(fault: Fault, language: str) -> dict[str, str]:
    hazard = HAZARDS[fault]
    return {"text": translated(hazard.text, language), "remedy": translated(hazard.remedy, language)}


def _lost(device: Device, status: Mapping[str, Any]) -> Iterator[str]:
    """Yields what is reported of a lost device; `lost` names each by its role and URL."""
    role = _ROLES.get(device)
    return (f"{name.partition(' ')[2]}: {what}" for name, what in status["lost"].items() if name.split(" ")[0] == role)
