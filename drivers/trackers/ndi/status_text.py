"""Translates numbers of the Combined API into words: error codes and alerts."""

from collections.abc import Iterable

_ERRORS = {
    0x01: "invalid command",
    0x02: "command too long",
    0x03: "command too short",
    0x04: "bad CRC",
    0x05: "command timed out",
    0x06: "these line settings are not possible",
    0x07: "wrong number of parameters",
    0x08: "no such port handle",
    0x09: "bad tracking priority",
    0x0A: "no such lamp",
    0x0B: "no such lamp state",
    0x0C: "not possible in the present mode",
    0x0D: "no tool is assigned to the handle",
    0x0E: "the handle is not initialised",
    0x0F: "the handle is not enabled",
    0x10: "the system is not initialised",
    0x11: "tracking cannot be stopped",
    0x12: "tracking cannot be started",
    0x13: "the tool cannot be initialised",
    0x14: "the position sensor or field generator is not characterised or absent",
    0x15: "the system cannot be initialised",
    0x16: "diagnostics cannot be started",
    0x17: "diagnostics cannot be stopped",
    0x19: "firmware versions do not match",
    0x1A: "internal error",
    0x1D: "the tool memory cannot be searched",
    0x1E: "the tool memory cannot be read",
    0x1F: "the tool memory cannot be written",
    0x20: "the tool memory cannot be selected",
    0x21: "the electrical test of the tool failed",
    0x22: "no volume for this wavelength",
    0x23: "parameter out of range",
    0x24: "the volume cannot be read or changed",
    0x25: "the features cannot be read",
    0x28: "too many tools for this rate",
    0x29: "the firmware is damaged",
    0x2A: "out of memory",
    0x2B: "the handle is not allocated",
    0x2C: "the tool was unplugged",
    0x2D: "no handle is left",
    0x2E: "firmware versions are incompatible",
    0x2F: "bad port description",
    0x30: "the port is assigned already",
    0x31: "bad input/output state",
    0x32: "not possible on this device",
    0x33: "the device lacks this feature",
    0x34: "no such parameter",
    0x35: "bad type of value",
    0x36: "bad value",
    0x37: "bad index",
    0x38: "bad size of value",
    0x39: "read-only, or another computer holds the tracker",
    0x3B: "file not found",
    0x3C: "file cannot be written",
    0x3D: "file cannot be read",
    0x40: "the tool definition file is damaged",
    0x41: "the tool does not match its definition",
    0x42: "the device is absent",
}
"""Combined API: the number after ERROR."""

BUMPED = 0x200000
"""Combined API, Info.Status.Alerts; so are all single bits below."""

PTP_LOST = 1 << (32 + 14)
"""Alert that the device's clock has lost its master. BX2 alone reports it and other bits from 32 on."""

_BX2_ALERT = 1 << 32
"""Our own mapping: alert n of BX2 that has no bit in Info.Status.Alerts is bit 32 + n, clear of the device's 32."""

_ALERTS = {
    0x1: "fatal parameter fault",
    0x2: "sensor parameter fault",
    0x4: "main voltage fault",
    0x8: "sensor voltage fault",
    0x10: "illuminator voltage fault",
    0x20: "illuminator current fault",
    0x40: "left sensor temperature fault",
    0x80: "right sensor temperature fault",
    0x100: "main board temperature fault",
    0x100000: "low battery",
    0x200: "sensor fault",
    BUMPED: "the position sensor was bumped",
    0x400000: "incompatible cable",
    0x800000: "incompatible firmware",
    0x1000000: "parameter warning",
    0x2000000: "flash memory full",
    0x4000000: "low laser battery",
    0x20000000: "too hot",
    0x40000000: "too cold",
    _BX2_ALERT << 7: "was stored too hot or too cold",
    _BX2_ALERT << 10: "the system control unit is off",
    _BX2_ALERT << 11: "the power supply is off",
    _BX2_ALERT << 12: "the field generator is disconnected",
    _BX2_ALERT << 13: "the hardware changed",
    PTP_LOST: "the clock is not synchronised",
    _BX2_ALERT << 15: "video camera fault",
    _BX2_ALERT << 17: "safe mode",
}
"""Combined API, Info.Status.Alerts; above bit 31 alerts of BX2 alone."""

HARMLESS_ALERTS = 0x100000 | 0x1000000 | 0x2000000 | 0x4000000 | PTP_LOST | _BX2_ALERT << 15
"""Alerts that leave a pose as good as before: batteries, a parameter warning, full memory, clock, video."""

_BX2_BITS = {
    1: 0x100000,
    2: BUMPED,
    3: 0x800000,
    4: 0x1000000,
    5: 0x2000000,
    6: 0x4000000,
    8: 0x20000000,
    9: 0x40000000,
}
_FAULT, _ALERT, _EVENT = 0, 1, 2
_MOST_FAULTS = 10
"""BX2, alert component: code of an alert → its bit in Info.Status.Alerts, where there is one; kinds; highest fault
code, fault n being bit n - 1.
"""

BX2_PORT_EVENTS = frozenset((_EVENT, code) for code in range(1, 6))
"""(kind, code) of events that require a new start: tools or units plugged in or unplugged, hardware changed."""


def error_text(code: int) -> str:
    """Returns the meaning of ERRORxx."""
    return _ERRORS.get(code, "a code that is not documented")


def bx2_alert_mask(alerts: Iterable[tuple[int, int]]) -> int:
    """Converts (kind, code) of the alert component to bits as of Info.Status.Alerts, with further ones from 32 on."""
    mask = 0
    for kind, code in alerts:
        if kind == _FAULT:
            mask |= 1 << (code - 1) if 1 <= code <= _MOST_FAULTS else 1
        elif kind == _ALERT:
            mask |= _BX2_BITS.get(code, _BX2_ALERT << min(code, 31))
    return mask


def alert_text(mask: int) -> str:
    """Returns the alerts set in the value of Info.Status.New Alerts, as one phrase; empty for 0."""
    known = [words for bit, words in _ALERTS.items() if mask & bit]
    unknown = mask & ~sum(_ALERTS)
    return ", ".join([*known, f"unknown alert {unknown:#x}"] if unknown else known)
