"""Builds the JSON form of a check and of the error of a point, which the status of a service and the report share."""

from collections.abc import Sequence
from math import ceil, isfinite
from typing import Any

from probewatch.appliance.limits import Limits, Region
from probewatch.appliance.types import POINT_ACROSS, Check, PointError, Rival


def check_fields(now_ns: int, check: Check) -> dict[str, Any]:
    """Returns the check, ready for JSON. shown_age_s: how long before now_ns motion showed it; None where none did."""
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
    """Returns each rival with the fields of its check, and behind_nats."""
    return [{**check_fields(now_ns, rival.check), "behind_nats": rival.behind_nats} for rival in rivals]


def point_fields(now_ns: int, point: PointError | None, region: Region) -> dict[str, Any] | None:
    """Returns the error of a point, ready for JSON. shown_age_s: how long before now_ns the oldest motion was on which
    it rests. region: that of the limits in force.
    """
    if point is None:
        return None
    bounds = point.region_mm
    return {
        "worst_mm": [*point.worst_mm],
        "median_mm": [*point.median_mm],
        "depth_mm": point.depth_mm,
        "at_depth_mm": None if point.at_depth_mm is None else [*point.at_depth_mm],
        "shown_age_s": (now_ns - point.shown_ns) / 1e9,
        "region": region.model_dump(),
        "region_mm": [[*bounds[at : at + POINT_ACROSS]] for at in range(0, len(bounds), POINT_ACROSS)],
    }


def limits_fields(limits: Limits) -> dict[str, Any]:
    """Returns, ready for JSON, which profile of limits is in force, and which limits differ from that profile."""
    beside = limits.model_dump(mode="json", by_alias=True, include={*limits.beside_profile})
    return {"profile": limits.profile, "beside": beside}


def up_to(bound_mm: float) -> str:
    """Returns a bound in mm, rounded up to a tenth, so that it is never understated."""
    return f"{ceil(round(bound_mm * 10, 6)) / 10:.1f}"


def number_or_none(value: float) -> float | None:
    """Returns the number, or None for NaN and infinity, which JSON does not have."""
    return float(value) if isfinite(value) else None
