"""The JSON form of a check, which the status of a service and the report on a recording share."""

from collections.abc import Sequence
from math import isfinite
from typing import Any

from appliance.types import Check, Rival


def check_fields(now_ns: int, check: Check) -> dict[str, Any]:
    """Ready for JSON; shown_age_s: how long before now_ns motion showed it, None where none did."""
    return {
        "name": check.name,
        "fault": check.fault,
        "value": number_or_none(check.value),
        "sigma": number_or_none(check.sigma),
        "unit": check.unit,
        "limit": number_or_none(check.limit),
        "ratio": number_or_none(check.ratio),
        "verdict": check.verdict.value,
        "shown_age_s": None if check.shown_ns is None else (now_ns - check.shown_ns) / 1e9,
    }


def rival_fields(now_ns: int, rivals: Sequence[Rival]) -> list[dict[str, Any]]:
    """Each with the fields of its check, and behind_nats."""
    return [{**check_fields(now_ns, rival.check), "behind_nats": rival.behind_nats} for rival in rivals]


def number_or_none(value: float) -> float | None:
    """JSON knows no NaN and no infinity."""
    return float(value) if isfinite(value) else None
