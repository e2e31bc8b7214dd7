"""The status that the control socket gives: plain numbers and words, NaN as null.

state, text, remedy, fault, reason, energised; since_s and verification_age_s: ages, s; verdict: kind of the line's last
verdict; checks (of the line), devices (of their watchers): [{name, fault, value, sigma, unit, limit, ratio, verdict}];
lost: {device: what is wrong}; remarks: [what the tracker says besides its poses]; fps: {video, tracker}; counters:
{name: count since the start}.
"""

import math
from collections.abc import Mapping
from typing import Any

from appliance.supervision.alarms import operator_text
from appliance.types import AlarmState, Check, Verdict


def status_fields(
    now_ns: int, alarm: AlarmState, verdict: Verdict | None, devices: tuple[Check, ...], counters: Mapping[str, int]
) -> dict[str, Any]:
    """Everything but lost, remarks and fps, which the threads know."""
    text, remedy = operator_text(alarm.state, alarm.fault)
    verified_ns = alarm.verified_ns
    return {
        "state": alarm.state.value,
        "text": text,
        "remedy": remedy,
        "fault": alarm.fault,
        "reason": alarm.reason,
        "energised": alarm.energised,
        "since_s": (now_ns - alarm.since_ns) / 1e9,
        "verification_age_s": None if verified_ns is None else (now_ns - verified_ns) / 1e9,
        "verdict": None if verdict is None else verdict.kind.value,
        "checks": [] if verdict is None else [check_fields(check) for check in verdict.checks],
        "devices": [check_fields(check) for check in devices],
        "counters": dict(counters),
    }


def check_fields(check: Check) -> dict[str, Any]:
    """One check, ready for JSON."""
    return {
        "name": check.name,
        "fault": check.fault,
        "value": _number(check.value),
        "sigma": _number(check.sigma),
        "unit": check.unit,
        "limit": _number(check.limit),
        "ratio": _number(check.ratio),
        "verdict": check.verdict.value,
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
